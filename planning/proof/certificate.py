"""The proof that a gripper's fingers are free for every instant of their motion.

The arm stands still. The way of the fingers is cut into parts; in each part the robot has, in place
of its fingers, solids that hold all that they sweep in it, and this robot is proved free. Parts
that are not are halved, until so little is added to the fingers that they are what is in the way.

The proof that a timed trajectory is free for every instant and inside every limit.

It knows nothing of how the trajectory came about and shares no verdict with the planners. It
sweeps the polynomials themselves, interval of time by interval of time: where some direction parts
a pair in the middle of an interval by more than its margin and more than it can move in the
interval, it is free all over the interval, with at least the difference to spare; others are looked
at again on the halves. Whoever proposed the direction, it is checked here, on the exact geometry
(``sweep``, ``separating_direction``, ``motion_bounds``). What no direction settles, since it
touches or nearly so, FCL decides.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, typed
from kinematics.errors import InvalidOption, InvalidTrajectory
from kinematics.model.chain import Chain, Limits
from kinematics.trajectory.trajectory import Trajectory, stay
from obstacles.robots.allowed_pairs import Overlap, deepest
from obstacles.robots.finger_geometry import swept_cover
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.constraints.constraint_set import ConstraintSet
from planning.proof.collision.collision_proof import CollisionProof, prove_overlaps, unlooked
from planning.proof.constraints.constraint_limits import constrained_efforts, constrained_margin
from planning.proof.constraints.constraints import ConstraintReport, check_motion
from planning.proof.limits.limit_uses import Violation
from planning.proof.limits.limits import QUANTITIES, LimitReport, check_continuity, check_limits
from planning.proof.path_nearness import PathNearness, path_nearness
from planning.proof.premises import Premises
from planning.proof.tool.tool_box import BoxUse, check_tool_boxes
from planning.proof.tool.tool_deviation import PathDeviation, check_tool_motions
from planning.proof.tool.tool_speed_band import SpeedUse, check_speed_bands
from planning.tool_motions.timed_tool_motions import TimedToolMotions
from planning.values.deadline import Deadline
from planning.values.finger_motion import FingerMotion
from planning.values.limits import RATIO_TOLERANCE, MotionLimits


@dataclass(frozen=True, slots=True)
class Proved:
    """Parts of a proof that were carried out and hold.

    Args:
        limits: Limits, continuity, constraints and tool motions hold at every instant; not where a
            jerk limit that is known and was not asked for does not.
        collisions: Nothing collides at any instant.
        reasons: Why a part is not proved, a sentence each; and what was not compared with anything
            though it is there, by name, which leaves the rest proved.
    """

    limits: bool
    collisions: bool
    reasons: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Certificate:
    """Certificate of a trajectory: what was proved about it.

    Args:
        verified: All that was asked for is proved: limits always, but for a jerk that was not
            asked for, collisions unless there is nothing to collide with.
        min_clearance: Holds for every t, margins not taken off [m]; infinite where nothing can
            collide, the distance found where something does.
        clearance_pair: The pair with the least clearance.
        min_obstacle_clearance: Least clearance from obstacles alone [m]. Where a collision was
            found both of these hold up to its time.
        min_self_clearance: Least clearance among the robot's own links and what it holds [m]; no
            margin concerns these.
        method: Method of the proof.
        limits: Limits by quantity.
        continuity: Largest jumps of position and velocity.
        cells: Intervals of time that were looked at.
        violation: The first thing that is wrong; None where it is verified.
        path_deviation: How far the tool is off the motions asked for, where some were.
        path_constraints: How well each constraint of the path is held.
        proved: Parts that were proved, and why others were not.
        obstacle_pair: The pair with the least clearance of those with an obstacle.
        self_pair: Closest pair of the robot's own links and what it holds.
        tool_box: How much the tool uses of the tolerances of its motions, where they have some.
        tool_speed: How well it keeps to its band of speed, where it has one.
        premises: The robot, the scene and the margin that all this holds for.
        allowed_collisions: All pairs that were not kept apart, with who allows them and how deep
            they are at most.
    """

    verified: bool
    min_clearance: float
    clearance_pair: tuple[str, str] | None
    min_obstacle_clearance: float
    min_self_clearance: float
    method: str
    limits: Mapping[str, LimitReport]
    continuity: Mapping[str, float]
    cells: int
    violation: Violation | None = None
    path_deviation: PathDeviation | None = None
    path_constraints: tuple[ConstraintReport, ...] = ()
    proved: Proved = Proved(False, False)
    obstacle_pair: tuple[str, str] | None = None
    self_pair: tuple[str, str] | None = None
    tool_box: BoxUse | None = None
    tool_speed: SpeedUse | None = None
    premises: Premises = field(default_factory=Premises)
    allowed_collisions: tuple[Overlap, ...] = ()
    path: PathNearness | None = None

    def __repr__(self) -> str:
        verdict = "proved" if self.verified else "not proved"
        if not np.isfinite(self.min_clearance):
            return f"Certificate({verdict})"
        return f"Certificate({verdict}, clearance {self.min_clearance:.4f} m)"

    @property
    def path_constraint_residual(self) -> float | None:
        """The worst residual of all hard path constraints over all t [m or rad], 0 where they hold.

        None where there are none.
        """
        hard = [report.residual for report in self.path_constraints if report.hard]
        return max(0.0, *hard) if hard else None


METHOD = (
    "continuous: separating directions checked against motion bounds on cells of time, "
    "exact extrema of polynomials"
)
NOTHING_KNOWN = "nothing is known of collisions"
#: A motion that is refused anyway and goes farther than this [rad or m] is not looked at for
#: collisions, which takes about a millisecond for each.
_MOST_TRAVEL = 1e3
_NOT_LOOKED_AT = (
    f"a joint goes farther than {_MOST_TRAVEL:g} rad or m and limits are broken: {NOTHING_KNOWN}"
)
LIMITS_METHOD = f"exact extrema of polynomials; {NOTHING_KNOWN}"


@typed
def certify(
    trajectory: Trajectory,
    robot: RobotGeometry,
    scene: Scene,
    *,
    margin: float = 0.0,
    limits: MotionLimits | None = None,
    constraints: ConstraintSet | None = None,
    tool_motions: TimedToolMotions | None = None,
    deadline: Deadline | None = None,
) -> Certificate:
    """Prove that a trajectory is free for every instant and inside every limit, or say why not.

    Args:
        trajectory: Trajectory of all joints of the robot, in its order.
        robot: The arm with its geometry.
        scene: The obstacles.
        margin: Distance to keep from obstacles beyond their own margins [m].
        limits: Limits to hold it to in place of the robot's.
        constraints: Constraints that the motion has to hold at every instant, limits of tool speed,
            torque and clearance among them included.
        tool_motions: Lines and arcs that the tool has to keep to.
        deadline: Instant at which the proof is given up (which proves nothing).

    Raises:
        InvalidTrajectory: It is not of the joints of the robot, in its order.
        InvalidOption: Limits, constraints or the margin are none of such a motion, or an argument
            is of another type.
    """
    wanted = limits or MotionLimits()
    _check_question(trajectory, robot.chain, wanted, margin, constraints)
    effort = constrained_efforts(wanted.effort, constraints, robot.chain)
    margin = constrained_margin(margin, constraints)
    if effort is not wanted.effort:
        wanted = replace(wanted, effort=effort)
    reports, wrong, told = check_limits(trajectory, robot.chain.limits, wanted)
    continuity, jumps = check_continuity(trajectory)
    wrong += jumps
    kept, violated = (
        check_motion(constraints, trajectory) if constraints is not None else ((), None)
    )
    wrong += [violated] if violated else []
    deviation, box, speed = None, None, None
    if tool_motions is not None:
        deviation, off = check_tool_motions(robot.chain, trajectory, tool_motions)
        box, outside = check_tool_boxes(robot.chain, trajectory, tool_motions)
        speed, fast = check_speed_bands(robot.chain, trajectory, tool_motions.speeds)
        wrong += [violation for violation in (off, outside, fast) if violation]
    within = not wrong and not told
    proof = CollisionProof(trajectory, robot, scene, margin, deadline)
    looked_at = not wrong or _travel(trajectory) <= _MOST_TRAVEL
    if looked_at:
        proof.run()
    solid = robot.has_solids
    if not solid and scene.obstacles:
        message = f"{_no_solids(robot)} with {len(scene.obstacles)} obstacle(s)"
        wrong.append(Violation("unproved", 0.0, message, {}))
    allowed, deep = prove_overlaps(trajectory, robot, scene, deadline) if looked_at else ((), None)
    unknown = unlooked(robot, scene) if solid else (_no_solids(robot),)
    unknown = unknown if looked_at else (_NOT_LOOKED_AT,)
    touching = [violation for violation in (proof.violation, deep) if violation]
    wrong += touching
    free = solid and looked_at and not touching
    obstacle, own = proof.clearances if looked_at else (-np.inf, -np.inf)
    obstacle_pair, own_pair = proof.closest_pairs
    first = min(wrong, key=lambda violation: violation.time) if wrong else None
    return Certificate(
        verified=first is None,
        min_clearance=min(obstacle, own),
        clearance_pair=obstacle_pair if obstacle <= own else own_pair,
        min_obstacle_clearance=obstacle,
        min_self_clearance=own,
        method=METHOD,
        limits=reports,
        continuity=continuity,
        cells=proof.interval_count,
        violation=first,
        path_deviation=deviation,
        path_constraints=kept,
        proved=Proved(within, free, _reasons(wrong + told, unknown)),
        obstacle_pair=obstacle_pair,
        self_pair=own_pair,
        tool_box=box,
        tool_speed=speed,
        premises=Premises.of_cell(robot, scene, margin),
        allowed_collisions=allowed,
    )


def certify_limits(
    trajectory: Trajectory,
    chain: Chain | None,
    wanted: MotionLimits,
) -> Certificate:
    """Prove that a trajectory keeps its limits; collisions are not part of the proof.

    Args:
        trajectory: The motion.
        chain: The robot, whose limits hold; None where there is none.
        wanted: Limits in place of them.

    Raises:
        InvalidTrajectory: It is not of the joints of the robot, in its order.
        InvalidOption: Limits are none of such a motion.
    """
    if chain is not None:
        _check_question(trajectory, chain, wanted)
    limits = Limits.unlimited(len(trajectory.joint_names)) if chain is None else chain.limits
    reports, wrong, told = check_limits(trajectory, limits, wanted)
    if not (np.isfinite(limits.lower) | np.isfinite(limits.upper)).any():
        del reports["position"]
    continuity, jumps = check_continuity(trajectory)
    wrong += jumps
    first = min(wrong, key=lambda violation: violation.time, default=None)
    return Certificate(
        verified=first is None,
        min_clearance=np.inf,
        clearance_pair=None,
        min_obstacle_clearance=np.inf,
        min_self_clearance=np.inf,
        method=LIMITS_METHOD,
        limits=reports,
        continuity=continuity,
        cells=0,
        violation=first,
        proved=Proved(not wrong + told, False, _reasons(wrong + told, (NOTHING_KNOWN,))),
        premises=Premises.of_limits(chain),
    )


@typed
def with_path(
    certificate: Certificate, motion: Trajectory, waypoints: ArrayLike, tolerance: float
) -> Certificate:
    """The certificate of a motion that is to keep near a path too.

    Args:
        certificate: Its certificate without the path.
        motion: The motion.
        waypoints: Those of the path, shape (k, n), k >= 1 [rad or m].
        tolerance: Largest distance of any joint from the straight lines through them [rad or m].

    Raises:
        InvalidTrajectory: The waypoints are not finite or not of the joints of the motion.
        InvalidOption: An argument is of another type, or the tolerance is not positive.
    """
    near, wrong = path_nearness(motion, waypoints, tolerance)
    if wrong is None:
        return replace(certificate, path=near)
    proved, first = certificate.proved, certificate.violation
    return replace(
        certificate,
        path=near,
        verified=False,
        violation=wrong if first is None or wrong.time < first.time else first,
        proved=replace(proved, limits=False, reasons=(wrong.message, *proved.reasons)),
    )


def _check_question(
    trajectory: Trajectory,
    chain: Chain,
    wanted: MotionLimits,
    margin: float = 0.0,
    constraints: ConstraintSet | None = None,
) -> None:
    """Refuse what is none of a robot's: kernels read as many joints as it has, in its order."""
    if trajectory.joint_names != chain.joint_names:
        raise InvalidTrajectory(
            f"the trajectory is of the joints {', '.join(map(str, trajectory.joint_names))}",
            hint=f"Robot {chain.name!r} has, in this order: {', '.join(chain.joint_names)}.",
            joint_names=list(chain.joint_names),
        )
    wanted.check(chain)
    if not 0.0 <= margin < np.inf:
        raise InvalidOption(f"margin is {margin}", hint="Give 0 or more [m].")
    if constraints is not None and constraints.chain.joint_names != chain.joint_names:
        raise InvalidOption(
            f"the constraints are of robot {constraints.chain.name!r}, not of {chain.name!r}",
            hint="Make a ConstraintSet of this robot's chain.",
        )


def _travel(trajectory: Trajectory) -> float:
    """How far a joint goes at most, pieces one by one [rad or m]."""
    lower, upper = trajectory.piece_extrema()
    return float((upper - lower).sum(axis=0).max())


def _no_solids(robot: RobotGeometry) -> str:
    return f"no solids of robot {robot.chain.name!r} are looked at: {NOTHING_KNOWN}"


def _reasons(wrong: Sequence[Violation], unknown: Sequence[str]) -> tuple[str, ...]:
    """Why parts of a proof do not hold: violations, and what nothing is known of.

    Premises are among them that leave a proof as it is: what was not looked at, by name.
    """
    reasons = [violation.message for violation in wrong if violation.kind != "unproved"]
    return (*reasons, *unknown)


#: Parts in which solids are grown by less are not halved any more [m].
_LEAST_GROWTH = 1e-4
_METHOD = "fingers grown by all that they sweep, part by part of their way"


def certify_gripper(
    motion: FingerMotion,
    robot: RobotGeometry,
    scene: Scene,
    q: Array,
    *,
    margin: float = 0.0,
    constraints: ConstraintSet | None = None,
    deadline: Deadline | None = None,
) -> Certificate:
    """Prove that nothing collides while the fingers move and the arm stands still.

    Args:
        motion: Motion of the fingers.
        robot: The arm with its geometry and what it holds, its fingers anywhere.
        scene: The obstacles.
        q: Configuration of the arm, shape (n,) [rad or m].
        margin: Distance to keep from obstacles beyond their own margins [m].
        constraints: Constraints that the arm has to hold.
        deadline: Instant at which the proof is given up (which proves nothing).
    """
    still = stay(robot.chain.joint_names, q, motion.duration)
    parts, proved = [(0.0, 1.0)], list[Certificate]()
    while parts:
        share = parts.pop()
        cover, growth = swept_cover(robot, motion.first, motion.last, share)
        part = certify(
            still, cover, scene, margin=margin, constraints=constraints, deadline=deadline
        )
        if part.violation is None:
            proved.append(part)
            continue
        middle = 0.5 * (share[0] + share[1])
        if part.violation.kind not in ("collision", "undecided") or growth < _LEAST_GROWTH:
            wrong = _in_part(part.violation, motion, share)
            proved.append(replace(part, violation=wrong))
            break
        parts += [(middle, share[1]), (share[0], middle)]
    # The parts are proved of covers of the robot.
    premises = Premises.of_cell(robot, scene, proved[-1].premises.margin)
    whole = replace(reduce(_worst, proved), violation=proved[-1].violation, premises=premises)
    return _with_limits(whole, motion)


def _worst(one: Certificate, other: Certificate) -> Certificate:
    """The certificate of two parts together."""
    nearer = one if one.min_clearance <= other.min_clearance else other
    obstacle = one if one.min_obstacle_clearance <= other.min_obstacle_clearance else other
    own = one if one.min_self_clearance <= other.min_self_clearance else other
    return replace(
        one,
        verified=one.verified and other.verified,
        min_clearance=nearer.min_clearance,
        clearance_pair=nearer.clearance_pair,
        min_obstacle_clearance=obstacle.min_obstacle_clearance,
        obstacle_pair=obstacle.obstacle_pair,
        min_self_clearance=own.min_self_clearance,
        self_pair=own.self_pair,
        cells=one.cells + other.cells,
        allowed_collisions=deepest(one.allowed_collisions, other.allowed_collisions),
        proved=one.proved if not one.proved.collisions else other.proved,
    )


def _in_part(violation: Violation, motion: FingerMotion, share: tuple[float, float]) -> Violation:
    """The violation of a part of the way, with its time."""
    time = motion.time_of(share[0])
    pair = violation.details.get("pair")
    if pair is None:
        return replace(violation, time=time)
    middle = 0.5 * (share[0] + share[1])
    limit, what = violation.details.get("touch_depth"), "touch"
    if limit is not None:
        what = f"overlap deeper than touch_depth allows ({limit:.4g} m)"
    message = f"{pair[0]!r} and {pair[1]!r} {what} while the gripper moves, {middle:.0%} of its way"
    details = {key: value for key, value in violation.details.items() if key != "at"}
    return replace(violation, time=time, message=message, details=details)


def _with_limits(certificate: Certificate, motion: FingerMotion) -> Certificate:
    """The certificate with the limits of the fingers' own positions and speeds checked."""
    certificate = replace(certificate, method=f"{certificate.method}; {_METHOD}")
    wrong = _limit_violation(motion)
    if wrong is None:
        return certificate
    proved = replace(
        certificate.proved, limits=False, reasons=(*certificate.proved.reasons, wrong.message)
    )
    first = certificate.violation or wrong
    return replace(certificate, verified=False, violation=first, proved=proved)


def _limit_violation(motion: FingerMotion) -> Violation | None:
    """The first joint that leads and is beyond its limits or those of joints that follow it."""
    found = [motion.trajectory.extrema(order) for order in range(len(QUANTITIES))]
    for i, name in enumerate(motion.names):
        if name not in motion.leaders:
            continue
        lower, upper, *rates = motion.fingers.limits(name)
        ranges = [(lower, upper), *((-rate, rate) for rate in rates)]
        for quantity, ends, (low, high) in zip(QUANTITIES, found, ranges, strict=True):
            spare = RATIO_TOLERANCE * (1.0 if quantity == "position" else high)
            least, most = float(ends.minimum[i]), float(ends.maximum[i])
            # Not a number where there is no such limit: then neither is so.
            if least < low - spare or most > high + spare:
                below = low - least > most - high
                time = float((ends.time_of_minimum if below else ends.time_of_maximum)[i])
                return _beyond(quantity, name, time, (least, most), (low, high))
    return None


def _beyond(
    kind: str, joint: str, time: float, values: tuple[float, float], limits: tuple[float, float]
) -> Violation:
    message = (
        f"{kind} of joint {joint!r} of the gripper is from {values[0]:.6g} to {values[1]:.6g}, "
        f"its limits and those of joints that follow it leave {limits[0]:.6g} to {limits[1]:.6g}"
    )
    details = {"joint": joint, "values": list(values), "limits": list(limits)}
    return Violation(kind, time, message, details)
