"""Optimisation as a stage of planning: from a problem and a motion that was found for it.

Of a start that moves, the first contact is reported that no braking avoids.
"""

from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from dynamics.model.payload import with_payload
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from planning.optimize.task import End, Obstruction, Task
from planning.options import Options
from planning.problem import JointGoal, Problem
from planning.proof.certificate import Certificate, certify
from planning.proof.limits.limit_uses import Violation
from planning.result import Failure
from planning.stops.braking import BrakingLimits
from planning.stops.stop_family import joint_stop
from planning.timing.options import TimingOptions
from planning.timing.parametrization import TimeParametrization
from planning.values.deadline import Deadline
from planning.values.optimize_options import OPTIMIZE, RefineOptions

if TYPE_CHECKING:
    from planning.optimize.scp import RefinedMotion, Refinement

#: Violations that are kept away from once it is known where they are.
_PLACED = frozenset({"collision", "path_constraint"})
#: Motions offered for proof, at most.
MOST_OFFERS = 3


def refinement_options(options: Options, problem: Problem) -> Options:
    """The options with what the planner "optimize" stands for: the ladder, and its motion refined.

    Raises:
        InvalidOption: The ends are to move, but nothing is to be optimised; or ``refine`` is given
            beside the planner that has it in its options; or the path or the times of the motion
            are given.
    """
    if options.planner == OPTIMIZE:
        if options.refine is not None:
            raise InvalidOption(
                "refine is given twice: the planner optimize has it in planner_options",
                hint="Leave refine out, or name another planner.",
            )
        chosen = RefineOptions.of(options.planner_options)
        options = replace(
            options, planner="auto", planner_options=MappingProxyType({}), refine=chosen
        )
    if options.refine is None:
        if problem.moving:
            raise InvalidOption(
                "only an optimised motion begins or ends with a velocity or acceleration",
                hint='Ask for planner "optimize" or for refine, or leave velocities out.',
            )
        return options
    if options.planner == "cartesian":
        raise InvalidOption(
            "a motion led along lines and arcs can't be optimised: it would leave them",
            hint="Leave refine out, or name another planner.",
        )
    if options.path_tolerance is not None and options.planner_options.get("keep_path"):
        raise InvalidOption(
            "keep_path and path.tolerance hold the motion to the descent's own path, which refine "
            "leaves",
            hint="Leave refine out, or keep_path.",
        )
    if options.timing.times is not None:
        raise InvalidOption(
            "a motion whose times are given can't be optimised",
            hint="Leave timing.times out, or do not ask for refine.",
        )
    if options.timing.solver is not None:
        raise InvalidOption(
            "the optimiser times its motions itself: timing.solver does not apply",
            hint="Leave timing.solver out, or do not ask for refine.",
        )
    return options


@dataclass(slots=True)
class OptimizeStage:
    """The optimisation of a motion that was found for a problem.

    Args:
        problem: What is to be solved.
        checker: The robot in its scene, as the planner saw it.
        options: With ``refine``.
        parametrization: The limits.
        known: The motion, at rest at its ends.
    """

    problem: Problem
    checker: Checker
    options: Options
    parametrization: TimeParametrization
    known: Trajectory
    _work: "Refinement | None" = field(default=None, init=False)
    _skip_reason: str = field(default="", init=False)

    def offer(self, deadline: Deadline) -> "RefinedMotion | None":
        """Optimise; the best motion if it is better than the known one.

        Raises:
            MissingInertia: Torques count and some link's inertia is not known.
        """
        self._skip_reason = (
            "The robot stays where it is." if self._stays else "There is too little time."
        )
        # Nothing is begun with less than this left [s].
        if self._stays or deadline.sooner_than(0.05):
            return None
        self._skip_reason = ""
        if self._work is None:
            self._work = self._begin(deadline)
        return self._work.offer(deadline)

    def report(self, offer: "RefinedMotion | None") -> tuple[bool, str]:
        """Sentence for the stage's report."""
        if self._skip_reason or self._work is None:
            return False, self._skip_reason
        rounds = f"{self._work.rounds} rounds"
        if offer is None:
            return False, f"{self._work.obstruction.message}, {rounds}."
        detail = f"{self.known.duration:.3f} s became {offer.trajectory.duration:.3f} s, {rounds}"
        if not self._refine.fastest or self._has_soft_constraints:
            detail += f"; objective {self._work.value:.4g} became {offer.value:.4g}"
        return True, f"{detail}."

    def reject(self, offer: "RefinedMotion", certificate: Certificate) -> bool:
        """An offer was not proved; whether another one may be."""
        violation = certificate.violation
        if self._work is None or violation is None or violation.kind not in _PLACED:
            return False
        self._work.reject(offer, violation.time)
        return True

    def failure(self, deadline: Deadline) -> Failure | None:
        """Why there is no motion, where the known one will not do."""
        longest = self._refine.duration
        short = longest is None or self.known.duration <= longest
        if short and not self.problem.moving:
            return None
        late = Obstruction("time was up before it began", "Allow more time.")
        reason, hint = late if self._work is None else self._work.obstruction
        asked = "the velocities at its ends" if self.problem.moving else f"at most {longest:g} s"
        details: dict[str, object] = {"duration_at_rest": self.known.duration}
        met = self._braking_meets()
        if met is not None:
            reason, hint, braking = met
            details["braking"] = braking
        return Failure(
            code="TIMED_OUT" if deadline.passed else "INVALID_MOTION_PLAN",
            message=f"no motion with {asked} was found: {reason}",
            hint=hint,
            stage=OPTIMIZE,
            details={"reason": reason, **details},
        )

    def _braking_meets(self) -> tuple[str, str, dict[str, object]] | None:
        """Sentence, hint and details about what the start meets however hard it brakes."""
        velocity = self.problem.start_velocity
        if velocity is None or not velocity.any():
            return None
        jerk = self.parametrization.jerk
        unlimited = np.full_like(velocity, np.inf)
        limits = BrakingLimits(
            self.parametrization.acceleration, unlimited if jerk is None else jerk
        )
        touch = first_touch(self.problem, self.known.start, limits)
        if touch is None:
            return None
        link, other = touch.pair
        reason = (
            f"the start can't stop before {other!r}: with all joints braking {link!r} meets it "
            f"after {touch.time:.3g} s, {touch.distance:.3g} m away at the start"
        )
        cure = "Start at rest"
        if touch.share > 0.0:
            cure = f"Give at most {touch.share:.2g} of this velocity at the start"
        hint = f"{cure}, start farther from {other!r}, or raise the acceleration limits."
        details = {"pair": [link, other], "time": touch.time, "distance": touch.distance}
        return reason, hint, {**details, "velocity_share": touch.share}

    @property
    def _stays(self) -> bool:
        """Whether there is no motion to be optimised."""
        return not self.problem.moving and not self.known.coefficients[:, :, 1:].any()

    @property
    def _has_soft_constraints(self) -> bool:
        given = self.problem.constraints
        return given is not None and bool(given.soft.rows)

    @property
    def _refine(self) -> RefineOptions:
        assert self.options.refine is not None
        return self.options.refine

    def _begin(self, deadline: Deadline) -> "Refinement":
        from planning.optimize.scp import Refinement  # noqa: PLC0415  with CasADi

        problem, known = self.problem, self.known
        smooth = self.parametrization.jerk is not None or "jerk" in self._refine.weights
        start = _end(known.start, problem.start_velocity, problem.start_acceleration, smooth=smooth)
        goal = _joint_goal_at(problem, known.end)
        rates = (None, None) if goal is None else (goal.velocity, goal.acceleration)
        end = _end(known.end, *rates, smooth=smooth)
        loaded_chain = _loaded_chain(problem.robot.chain, self.options.timing, self.parametrization)
        bounds, loads = self.parametrization.bounds, self.parametrization.loads
        given = problem.constraints
        hard = None if given is None else given.hard
        soft = given.soft if given is not None and self._has_soft_constraints else None
        task = Task(self.checker, start, end, bounds, loads, hard, loaded_chain, soft)
        return Refinement(
            task, self._refine, self.parametrization, known, deadline, binding=not problem.moving
        )


def check_ends(problem: Problem, parametrization: TimeParametrization) -> Failure | None:
    """Whether velocities and accelerations at the ends are within their limits, or which is not."""
    given = [("start", problem.start_velocity, problem.start_acceleration)]
    goals = [goal for goal in problem.goals if isinstance(goal, JointGoal)]
    given += [("goal", goal.velocity, goal.acceleration) for goal in goals]
    for which, *rates in given:
        for quantity, values in zip(("velocity", "acceleration"), rates, strict=True):
            if values is None:
                continue
            limits = parametrization.bounds[quantity]
            j = int(np.argmax(np.abs(values) / limits))
            if abs(values[j]) > limits[j]:
                return _too_fast(problem, which, quantity, j, float(values[j]), float(limits[j]))
    return _unstoppable(problem, parametrization)


def _unstoppable(problem: Problem, parametrization: TimeParametrization) -> Failure | None:
    """The joint that passes its limit however hard it brakes: v^2 / 2a is more than its room."""
    velocity, chain = problem.start_velocity, problem.robot.chain
    if velocity is None:
        return None
    braking = 0.5 * velocity**2 / parametrization.bounds["acceleration"]
    above, below = chain.limits.upper - problem.start, problem.start - chain.limits.lower
    excess = braking - np.where(velocity > 0.0, above, below)
    j = int(np.argmax(np.where(velocity == 0.0, -np.inf, excess)))
    # What braking may take beyond a joint's room for rounding [rad or m].
    if velocity[j] == 0.0 or excess[j] <= 1e-9:
        return None
    name, v, room = chain.joint_names[j], float(velocity[j]), float(braking[j] - excess[j])
    return Failure(
        code="START_STATE_INVALID",
        message=f"the start can't stop in time: joint {name!r} at velocity {v:.6g} needs "
        f"{braking[j]:.4g} to brake and has {room:.4g} to its limit",
        hint="Give a lower velocity at the start, or raise the acceleration limit or its scaling.",
        stage="start",
        details={"joint": name, "velocity": v, "needs": float(braking[j]), "room": room},
    )


def _too_fast(
    problem: Problem, which: str, quantity: str, joint: int, value: float, limit: float
) -> Failure:
    name = problem.robot.chain.joint_names[joint]
    return Failure(
        code=f"{which.upper()}_STATE_INVALID",
        message=(
            f"the {which} has joint {name!r} at {quantity} {value:.6g}, its limit is {limit:.6g}"
        ),
        hint=f"Give a lower {quantity}, or raise the limit or its scaling.",
        stage=which,
        details={"joint": name, "quantity": quantity, "value": value, "limit": limit},
    )


def _end(q: Array, velocity: Array | None, acceleration: Array | None, *, smooth: bool) -> End:
    if acceleration is None and smooth:
        acceleration = np.zeros_like(q)
    return End(q, np.zeros_like(q) if velocity is None else velocity, acceleration)


def _joint_goal_at(problem: Problem, q: Array) -> JointGoal | None:
    """The goal that a motion ends at, where it is one of joints."""
    goals = [goal for goal in problem.goals if isinstance(goal, JointGoal)]
    return min(goals, key=lambda goal: float(np.abs(goal.joints - q).max()), default=None)


def _loaded_chain(
    chain: Chain, timing: TimingOptions, parametrization: TimeParametrization
) -> Chain:
    """The robot with its payload."""
    if parametrization.loads is not None:
        return parametrization.loads.chain
    load = timing.payload
    if load is None:
        return chain
    return with_payload(chain, load.mass, load.center_of_mass, load.inertia, link=load.link)


@dataclass(frozen=True, slots=True)
class Touch:
    """A contact while all joints brake as hard as they can.

    Args:
        pair: The link and what it meets.
        time: When, from the start on [s].
        distance: Between the two at the start, margins taken off [m].
        share: With this share of the velocity braking meets nothing; 0 where none was found.
    """

    pair: tuple[str, str]
    time: float
    distance: float
    share: float


def first_touch(problem: Problem, start: Array, limits: BrakingLimits) -> Touch | None:
    """First contact of a start that moves while all joints brake as hard as they can, if any.

    Joints keep to their own ways: another motion may get around what is met.

    Args:
        problem: The robot in its scene, with velocity and acceleration of its start.
        start: Shape (n,).
        limits: Limits that the joints brake at.
    """
    velocity = problem.start_velocity
    assert velocity is not None
    given = problem.start_acceleration
    acceleration = np.zeros_like(velocity) if given is None else given

    def violation(share: float) -> Violation | None:
        state = np.stack([start, share * velocity, 0.5 * share * acceleration], axis=1)[None]
        begun = Trajectory(problem.robot.chain.joint_names, np.array([0.0, 1.0]), state)
        stop = joint_stop(begun, 0.0, limits)
        proof = certify(stop, problem.robot, problem.scene, margin=problem.margin)
        met = proof.violation
        return met if met is not None and not proof.proved.collisions else None

    met = violation(1.0)
    if met is None or "pair" not in met.details:
        return None
    link, other = met.details["pair"]
    checker = Checker.of(problem.robot, problem.scene, problem.margin)
    near = checker.gradient(start, np.inf)
    names = [checker.model.pair_name(int(k)) for k in near.pairs]
    apart = [d for d, name in zip(near.distances.tolist(), names, strict=True)
             if set(name) == {link, other}]  # fmt: skip
    low, high = 0.0, 1.0
    # Halvings that find the share of the velocity with which braking is in time.
    for _ in range(8):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if violation(middle) is None else (low, middle)
    # Hundredths are enough to tell a person.
    share = np.floor(100.0 * low) / 100.0
    return Touch((link, other), met.time, max(min(apart, default=0.0), 0.0), float(share))
