"""Options of the planner by a potential field, and presets of them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from planning.field.gradient_descent import Rules
from planning.field.weights import FieldWeights, positive, share, whole

#: Choices of control points.
CONTROL_POINTS = ("origins", "links")
#: What projects onto obstacles: closed forms in kernels, or FCL from Python.
ENGINES = ("exact", "fcl")
#: Largest number of steps, and of steps without progress.
MAX_ITERATIONS = 100_000
#: Fields of a control point of one's own.
_PARTS = {"link", "point"}
#: Control points of one's own at most.
_MAX_POINTS = 64
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
        control_points: "origins" O_i of the DH frames, points along the "links", or points of one's
            own, {"link": name, "point": [x, y, z] in its frame [m]} each.
        point_radii: Radius of the arm about origins or own points [m]: one for all, or one each;
            None for bare points. Obstacles push from where they are felt by balls of these radii.
            Points along links have those of the links.
        joint_weight: Pull in joint space beside that on the control points [N m].
        step_sizes: alpha_k: one for all steps, or a sequence whose last one is kept; None for the
            longest steps that are proved and lower the potential.
        longest_step: alpha_k is cut so that no joint moves farther in a step [rad or m].
        halvings: How often a step that can't be taken is halved before the descent counts as
            blocked.
        tolerance: epsilon, it has arrived this near to the goal in joint space [rad or m].
        connect: It has also arrived where the straight motion to the goal is proved.
        keep_path: Time and prove the descent's own path: no straight connection, no shortcut.
        max_iterations: Steps before it gives up.
        patience: Steps in a row without progress after which it gives up.
        progress: Share of the lowest potential by which a step has to lower it to be progress.
        force_tolerance: A local minimum is where no joint force is more than this share of the
            largest sum of the attractive and repulsive terms, by their sizes, that it consists of.
        escapes: Random walks out of local minima before it gives up.
        escape_steps: Steps of each.
        engine: "exact" projects onto obstacles in closed form, "fcl" by FCL's distance query.
        fallback: OMPL's planner that plans where the descent does not arrive or its motion is not
            proved; None for none.

    Raises:
        InvalidOption: A value is out of its range.
    """

    attractive_weights: float | Sequence[float] = 1.0
    attractive_cap: float = 0.2
    repulsive_weights: float | Sequence[float] = 2e-4
    influence_distance: float = 0.1
    least_distance: float = 1e-3
    control_points: str | Sequence[Mapping[str, Any]] = "origins"
    point_radii: float | Sequence[float] | None = None
    joint_weight: float = 0.0
    step_sizes: float | Sequence[float] | None = None
    longest_step: float = 0.05
    halvings: int = 6
    tolerance: float = 1e-2
    connect: bool = True
    keep_path: bool = False
    max_iterations: int = 1000
    patience: int = 50
    progress: float = 0.0
    force_tolerance: float = 1e-3
    escapes: int = 0
    escape_steps: int = 6
    engine: str = "exact"
    fallback: str | None = "rrt_connect"
    weights: FieldWeights = field(init=False, repr=False)

    def __post_init__(self) -> None:
        names = [item.name for item in fields(FieldWeights)]
        weights = FieldWeights(**{name: getattr(self, name) for name in names})
        object.__setattr__(self, "weights", weights)
        for name in ("longest_step", "tolerance"):
            positive(name, getattr(self, name))
        for name, least, most in (
            ("halvings", 0, 30),
            ("max_iterations", 1, MAX_ITERATIONS),
            ("patience", 1, MAX_ITERATIONS),
            ("escapes", 0, 1000),
            ("escape_steps", 1, 1000),
        ):
            whole(name, getattr(self, name), least, most)
        for name in ("progress", "force_tolerance"):
            share(name, getattr(self, name))
        if self.engine not in ENGINES:
            raise InvalidOption(
                f"engine can't be {self.engine!r}", hint=f"Choose one of: {', '.join(ENGINES)}."
            )
        if self.control_points not in CONTROL_POINTS:
            self.named_points  # noqa: B018 - refuses what is neither
        for name in ("connect", "keep_path"):
            if not isinstance(getattr(self, name), bool):
                raise InvalidOption(f"{name} must be true or false, not {getattr(self, name)!r}")
        if not isinstance(self.fallback, str | None):
            raise InvalidOption(f"fallback must be a name or null, not {self.fallback!r}")
        self._check_radii()
        if self.joint_weight != 0.0:
            positive("joint_weight", self.joint_weight)
        self._check_step_sizes()

    @property
    def named_points(self) -> tuple[tuple[str, Array], ...]:
        """Names of links, and positions in their frames, of control points of one's own.

        Raises:
            InvalidOption: They are none.
        """
        given: Any = self.control_points
        points = []
        items = given if isinstance(given, Sequence) and not isinstance(given, str) else [None]
        for item in items:
            parts: Any = item if isinstance(item, Mapping) and set(item) == _PARTS else {}
            link, point = parts.get("link"), parts.get("point")
            try:
                place = np.array(point, dtype=np.float64)
            except (TypeError, ValueError):
                place = np.zeros(0)
            if not isinstance(link, str) or place.shape != (3,) or not np.isfinite(place).all():
                raise InvalidOption(
                    f"control_points can't be {given!r:.80}",
                    hint=f"Choose {' or '.join(CONTROL_POINTS)}, or give a list of "
                    '{"link": name, "point": [x, y, z]}.',
                )
            points.append((link, place))
        if not 0 < len(points) <= _MAX_POINTS:
            raise InvalidOption(f"control_points must be 1 to {_MAX_POINTS} points")
        return tuple(points)

    def _check_radii(self) -> None:
        if self.point_radii is None:
            return
        if self.control_points == "links":
            raise InvalidOption(
                "point_radii are those of origins and own points; points along links have the "
                "links' own",
                hint='Take control_points "origins", or leave point_radii out.',
            )
        several = isinstance(self.point_radii, Sequence) and not isinstance(self.point_radii, str)
        radii: Any = self.point_radii if several else [self.point_radii]
        if not radii or not all(
            isinstance(r, int | float) and not isinstance(r, bool) and 0.0 <= r < math.inf
            for r in radii
        ):
            raise InvalidOption("point_radii must be numbers from 0 on, one for all or one each")

    def _check_step_sizes(self) -> None:
        sizes = self.step_sizes
        if sizes is None:
            return
        several = isinstance(sizes, Sequence) and not isinstance(sizes, str)
        for size in sizes if several else [sizes]:  # type: ignore[union-attr]
            positive("step_sizes", size)
        # Longest sequence of step sizes.
        max_step_sizes = 10_000
        if several and not 0 < len(sizes) <= max_step_sizes:  # type: ignore[arg-type]
            raise InvalidOption(f"step_sizes must be 1 to {max_step_sizes} numbers")

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> "FieldOptions":
        """Return the parameters named in ``options``, the others as their ``preset`` has them.

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
        if given.get("keep_path") is True and given.setdefault("fallback", None) is not None:
            raise InvalidOption(
                "planner_options.keep_path asks for the descent's own path, and fallback for "
                "another one where it fails",
                hint="Leave one of them out.",
            )
        try:
            return replace(base, **given)
        except InvalidOption as error:
            raise InvalidOption(
                f"planner_options.{error.message}", hint=error.hint or hint, **error.details
            ) from None

    def rules(self, lower: Array, upper: Array) -> Rules:
        """The parameters of the descent for the kernel, with the joint limits, both (n,)."""
        return Rules(
            lower=lower,
            upper=upper,
            sizes=np.array([] if self.step_sizes is None else self.step_sizes, float).reshape(-1),
            longest=float(self.longest_step),
            halvings=self.halvings,
            tolerance=float(self.tolerance),
            connect=self.connect and not self.keep_path,
            patience=self.patience,
            progress=float(self.progress),
            force_tolerance=float(self.force_tolerance),
        )


#: Options of short descents: control points along the links, a pull in joint space too, long steps,
#: and soon given up. They find every third path among MotionBenchMaker's.
QUICK = FieldOptions(
    attractive_weights=2.75,
    repulsive_weights=2.2e-4,
    control_points="links",
    joint_weight=0.1,
    step_sizes=_ALWAYS_LONGEST,
    longest_step=0.25,
    max_iterations=16,
    patience=5,
    progress=0.01,
)
PRESETS: Mapping[str, FieldOptions] = {
    "notes": FieldOptions(),
    "quick": QUICK,
    "thorough": replace(QUICK, max_iterations=1000, patience=10, escapes=20),
}
