"""Planning by descent on an artificial potential.

    q^{k+1} = q^k + alpha_k sum_i J_i^T (F_att,i + F_rep,i)

from the start until |q - q_goal| < epsilon, with a cap on the steps. Every step is proved free
before it is taken, with a smaller alpha_k where it has to be; unless given, alpha_k is also small
enough for the potential to get lower. A potential has local minima; the
descent notices that it no longer gets lower and gives up, or, where escapes are allowed, walks some
random steps across the force and goes on from there. Source: "Real-time obstacle avoidance for
manipulators and mobile robots", International Journal of Robotics Research, 1986; random walks out
of minima: "Robot motion planning: a distributed representation approach", International Journal of
Robotics Research, 1991.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from obstacles.checker import Checker
from obstacles.projection import Projector
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Scene
from planning.constrained.checker import ConstrainedChecker
from planning.constraints.row import WIDTH
from planning.deadline import Deadline
from planning.field.control_points import along_links, frame_origins
from planning.field.gradient_descent import (
    ARRIVED,
    FLAT,
    GOING,
    ITERATIONS,
    STALE,
    VISITED,
    Proof,
    Rules,
    Track,
    descend_kernel,
    keep_kernel,
)
from planning.field.number import positive, whole
from planning.field.potential import Field, value_kernel
from planning.field.weights import FieldWeights

CONTROL_POINTS = ("origins", "links")
MOST_ITERATIONS = 100_000
_MOST_STEP_SIZES = 10_000
#: Steps between two looks at the clock, and configurations there is room for at first.
_STEPS_A_LOOK = 8
_ROOM = 64
#: What is left across the force counts as no direction below this.
_NO_FORCE = 1e-9
#: So large an alpha_k makes every step the longest: cheaper than looking for a lower potential, and
#: strides over small ridges of it.
_ALWAYS_LONGEST = 1e6


@dataclass(frozen=True, slots=True, eq=False)
class FieldOptions:
    """Parameters of the field and of the descent.

    Args:
        attractive_weights: c_i [N/m]: one each, or one number for each of the origins, which the
            links' points share among them.
        attractive_cap: d, distance beyond which the pull no longer grows [m].
        repulsive_weights: eta_i [N m^3], likewise.
        influence_distance: rho_0, distance within which an obstacle is felt [m].
        least_distance: rho_m, nearer than this an obstacle pushes as it does here [m].
        control_points: "origins" of the joints' frames, or points along the "links".
        joint_weight: Pull in joint space beside that on the control points [N m].
        step_sizes: alpha_k: one for all steps, or a sequence whose last one is kept; None for the
            longest steps that are proved and lower the potential.
        longest_step: alpha_k is cut so that no joint moves farther in a step [rad or m].
        halvings: How often a step that can't be taken is halved before the descent counts as
            blocked.
        tolerance: epsilon, it has arrived this near to the goal in joint space [rad or m].
        connect: It has also arrived where the straight motion to the goal is proved.
        max_iterations: Steps before it gives up.
        patience: Steps without a lower potential that make a local minimum.
        escapes: Random walks out of local minima before it gives up.
        escape_steps: Steps of each.

    Raises:
        InvalidOption: A value is out of its range.
    """

    attractive_weights: float | Sequence[float] = 1.0
    attractive_cap: float = 0.2
    repulsive_weights: float | Sequence[float] = 2e-4
    influence_distance: float = 0.1
    least_distance: float = 1e-3
    control_points: str = "origins"
    joint_weight: float = 0.0
    step_sizes: float | Sequence[float] | None = None
    longest_step: float = 0.05
    halvings: int = 6
    tolerance: float = 1e-2
    connect: bool = True
    max_iterations: int = 1000
    patience: int = 50
    escapes: int = 0
    escape_steps: int = 6
    weights: FieldWeights = field(init=False, repr=False)

    def __post_init__(self) -> None:
        names = [item.name for item in fields(FieldWeights)]
        weights = FieldWeights(**{name: getattr(self, name) for name in names})
        object.__setattr__(self, "weights", weights)
        for name in ("longest_step", "tolerance"):
            positive(name, getattr(self, name))
        for name, least, most in (
            ("halvings", 0, 30),
            ("max_iterations", 1, MOST_ITERATIONS),
            ("patience", 1, MOST_ITERATIONS),
            ("escapes", 0, 1000),
            ("escape_steps", 1, 1000),
        ):
            whole(name, getattr(self, name), least, most)
        if self.control_points not in CONTROL_POINTS:
            raise InvalidOption(
                f"control_points can't be {self.control_points!r}",
                hint=f"Choose one of: {', '.join(CONTROL_POINTS)}.",
            )
        if not isinstance(self.connect, bool):
            raise InvalidOption(f"connect must be true or false, not {self.connect!r}")
        if self.joint_weight != 0.0:
            positive("joint_weight", self.joint_weight)
        self._check_step_sizes()

    def _check_step_sizes(self) -> None:
        sizes = self.step_sizes
        if sizes is None:
            return
        several = isinstance(sizes, Sequence) and not isinstance(sizes, str)
        for size in sizes if several else [sizes]:  # type: ignore[union-attr]
            positive("step_sizes", size)
        if several and not 0 < len(sizes) <= _MOST_STEP_SIZES:  # type: ignore[arg-type]
            raise InvalidOption(f"step_sizes must be 1 to {_MOST_STEP_SIZES} numbers")

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> "FieldOptions":
        """The parameters named in ``options``, the others as the ``preset`` among them has them.

        Raises:
            InvalidOption: A name is unknown, or a value out of its range.
        """
        given = dict(options)
        preset = given.pop("preset", "notes")
        base = PRESETS.get(preset) if isinstance(preset, str) else None
        if base is None:
            raise InvalidOption(
                f"planner_options.preset: there is no {preset!r}",
                hint=f"Choose one of: {', '.join(PRESETS)}.",
            )
        known = {item.name: getattr(base, item.name) for item in fields(cls) if item.init}
        listed = ", ".join(f"{name} ({default!r})" for name, default in known.items())
        hint = f"Its options, with their defaults: preset ('notes'), {listed}."
        unknown = sorted(set(given) - set(known))
        if unknown:
            message = f"planner 'potential_field' has no option {unknown[0]!r}"
            raise InvalidOption(message, hint=hint, options=["preset", *known])
        try:
            return replace(base, **given)
        except InvalidOption as error:
            raise InvalidOption(
                f"planner_options.{error.message}", hint=error.hint or hint, **error.details
            ) from None

    def rules(self, lower: Array, upper: Array) -> Rules:
        """What of them is for the kernel, with the joint limits, both (n,)."""
        return Rules(
            lower=lower,
            upper=upper,
            sizes=np.array([] if self.step_sizes is None else self.step_sizes, float).reshape(-1),
            longest=float(self.longest_step),
            halvings=self.halvings,
            tolerance=float(self.tolerance),
            connect=self.connect,
            patience=self.patience,
        )


#: What the ladder tries before it samples: the bodies of the links, pulled in joint space too, with
#: long steps and soon given up. It finds every other way among MotionBenchMaker's that are not
#: straight, and the ways that it finds are shorter than those of random trees.
QUICK = FieldOptions(
    attractive_weights=2.75,
    repulsive_weights=2.2e-4,
    control_points="links",
    joint_weight=0.1,
    step_sizes=_ALWAYS_LONGEST,
    longest_step=0.25,
    max_iterations=16,
    patience=5,
)
PRESETS: Mapping[str, FieldOptions] = {
    "notes": FieldOptions(),
    "quick": QUICK,
    "thorough": replace(QUICK, max_iterations=1000, patience=10, escapes=20),
}


@dataclass(frozen=True, slots=True, eq=False)
class FieldResult:
    """Where the descent went.

    Args:
        waypoints: Shape (k, n), every leg proved free; None where it got stuck.
        visited: Configurations it was in, shape (k, n), whether it arrived or not.
        potentials: U at each of them, shape (k,) [J].
        iterations: Steps taken.
        detail: How it ended, for a person.
    """

    waypoints: Array | None
    visited: Array
    potentials: Array
    iterations: int
    detail: str


def potential_field(
    robot: RobotGeometry,
    checker: Checker,
    scene: Scene,
    start: Array,
    goals: Sequence[Array],
    options: FieldOptions,
    seed: int,
    deadline: Deadline,
) -> FieldResult:
    """Descend from ``start`` (n,) to the first of ``goals``, each (n,), that can be reached so.

    Raises:
        InvalidOption: Weights are given for another number of control points.
    """
    for goal in goals:
        field = _field(robot, scene, goal, options)
        descent = _Descent(field, robot, checker, start, goal, options, seed)
        detail = descent.run(deadline)
        if descent.reached or deadline.passed:
            break
    if not descent.reached and len(goals) > 1:
        detail = f"{detail} None of {len(goals)} goals was reached; this is the last."
    return FieldResult(
        waypoints=descent.visited if descent.reached else None,
        visited=descent.visited,
        potentials=descent.potentials,
        iterations=descent.iterations,
        detail=detail,
    )


def _field(robot: RobotGeometry, scene: Scene, goal: Array, options: FieldOptions) -> Field:
    """The field that the options ask for."""
    if options.control_points == "links":
        where = along_links(robot)
        weights = options.weights.shared(1.0 / len(where))
    else:
        where, weights = frame_origins(robot.chain), options.weights
    return Field(robot.chain, where, _projector(scene), goal, weights, options.joint_weight)


@lru_cache(maxsize=16)
def _projector(scene: Scene) -> Projector:
    return Projector(scene)


class _Descent:
    """One descent, from its first step to its last."""

    def __init__(
        self,
        field: Field,
        robot: RobotGeometry,
        checker: Checker,
        start: Array,
        goal: Array,
        options: FieldOptions,
        seed: int,
    ) -> None:
        limits, n = robot.chain.limits, len(start)
        held = checker.rows if isinstance(checker, ConstrainedChecker) else np.zeros((0, WIDTH))
        self._proof = Proof(checker.model.arrays, float(checker.slack), np.array(held))
        self._field = field.model
        self._goal = goal
        self._options = options
        self._rules = options.rules(limits.lower, limits.upper)
        self._random = np.random.default_rng(seed)
        self._track = Track(
            visited=np.empty((_ROOM, n)),
            potentials=np.empty(_ROOM),
            force=np.empty(n),
            gauges=np.array([options.longest_step, 0.0, np.inf, -1.0]),
            counts=np.zeros(4, dtype=np.int64),
        )
        q, force = np.array(start, dtype=np.float64), np.empty(n)
        keep_kernel(self._track, q, value_kernel(self._field, q, force), force)

    @property
    def visited(self) -> Array:
        """Where it was, shape (k, n)."""
        return np.array(self._track.visited[: self._track.counts[VISITED]])

    @property
    def potentials(self) -> Array:
        """U there, shape (k,) [J]."""
        return np.array(self._track.potentials[: self._track.counts[VISITED]])

    @property
    def iterations(self) -> int:
        """Steps that were taken."""
        return int(self._track.counts[ITERATIONS])

    @property
    def reached(self) -> bool:
        """Whether it ended at the goal."""
        return np.array_equal(self.visited[-1], self._goal)

    def run(self, deadline: Deadline) -> str:
        """Go on until it has arrived or has to give up; how it ended."""
        escapes, across, walk = 0, np.zeros(len(self._goal)), 0
        while True:
            outcome = self._go_on(deadline, across, walk)
            if outcome is None:
                return "The time was up."
            if outcome == ARRIVED:
                return f"Reached the goal in {self.iterations} steps."
            if outcome == GOING:
                return f"The {self._options.max_iterations} steps were used up."
            if escapes == self._options.escapes:
                return self._stuck()
            escapes += 1
            across, walk = self._across()

    def _go_on(self, deadline: Deadline, across: Array, walk: int) -> int | None:
        """Walk, then descend until that ends; None where the time does."""
        most = self._options.max_iterations
        while not deadline.passed:
            self._make_room(_STEPS_A_LOOK + walk)
            until = min(self.iterations + _STEPS_A_LOOK, most)
            outcome = int(
                descend_kernel(
                    self._proof, self._rules, self._field, self._track, until, across, walk
                )
            )
            if outcome != GOING or self.iterations >= most:
                return outcome
            walk = 0
        return None

    def _make_room(self, steps: int) -> None:
        """Room for so many steps, and the goal."""
        track = self._track
        room, needed = len(track.potentials), int(track.counts[VISITED]) + steps + 1
        if needed > room:
            more = max(needed, 2 * room)
            visited, potentials = np.empty((more, len(track.force))), np.empty(more)
            visited[:room], potentials[:room] = track.visited, track.potentials
            self._track = track._replace(visited=visited, potentials=potentials)

    def _stuck(self) -> str:
        counts, visited = self._track.counts, self.visited
        left = float(np.linalg.norm(visited[-1] - self._goal))
        minimum = counts[FLAT] or counts[STALE] >= self._options.patience
        what = "A local minimum" if minimum else "Blocked"
        return (
            f"{what} at potential {self.potentials[-1]:.4g} after {self.iterations} steps, "
            f"{left:.3g} from the goal in joint space."
        )

    def _across(self) -> tuple[Array, int]:
        """A random direction across the force, and how many steps to take in it."""
        force = self._track.force
        across = self._random.normal(size=len(force))
        along = force / max(float(np.linalg.norm(force)), 1e-300)
        across -= (across @ along) * along
        widest = float(np.abs(across).max())
        if widest < _NO_FORCE:
            return across, 0  # a single joint has nowhere to step aside
        return across / widest, self._options.escape_steps
