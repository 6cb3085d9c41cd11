"""The proof that a gripper's fingers are free for every instant of their motion.

The arm stands still. The way of the fingers is cut into parts; in each part the robot has, in place
of its fingers, solids that hold all that they sweep in it, and this robot is proved free. Parts
that are not are halved, until so little is added to the fingers that they are what is in the way.
"""

from dataclasses import replace
from functools import reduce

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import stay
from obstacles.robots.allowed_pairs import deepest
from obstacles.robots.finger_geometry import swept_cover
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.constraints.constraint_set import ConstraintSet
from planning.proof.certificate import Certificate, certify
from planning.proof.limits.limits import QUANTITIES
from planning.proof.premises import Premises
from planning.proof.violation import Violation
from planning.values.deadline import Deadline
from planning.values.finger_motion import FingerMotion
from planning.values.limits import RATIO_TOLERANCE

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
