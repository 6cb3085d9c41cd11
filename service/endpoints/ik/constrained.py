"""Inverse kinematics under constraints as requests ask for it, in workers."""

import time
from typing import Any

import numpy as np

from armwright_wire.pose import Pose
from armwright_wire.robots.kinematics import IkRequest
from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.ik.numeric.numeric import AXES
from kinematics.model.chain import Chain
from kinematics.pose import rotation_error
from obstacles.robots.robot_geometry import RobotGeometry
from planning.constrained.ik import (
    HELD,
    ConstrainedIk,
    ConstrainedSolution,
    IkOptions,
    constrained_ik,
)
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import RelativePoseConstraint
from planning.constraints.solvers.conflict import conflict
from planning.values.deadline import Deadline
from service.endpoints.attached_objects import RobotInScene
from service.translate import constraints, poses
from service.workers import current
from service.workers.result import TaskProblem

#: Solutions where all are wanted but no number is given.
_ALL = 16
#: Time where the request names none [s].
_TIMEOUT = 5.0
#: Overlap that is told as touching, not as a length [m].
_TOUCHING = 1e-6
#: An answer may be this much later than a request that waited long for a worker wants it [s].
_LATE = 0.05
#: Share of it for the search; the rest is kept for saying why nothing was found, and the last of
#: that for the answer.
_SHARE = 0.5
_SAYING_SHARE = 0.6


def answer(
    geometry: RobotGeometry, cell: RobotInScene | None, body: IkRequest, pose: Pose | None
) -> dict[str, Any] | TaskProblem:
    """The answer for one pose, or for none where the constraints define the goal alone.

    Args:
        geometry: The robot alone.
        cell: The robot in its surroundings, where solutions must be free of collisions.
        body: The request.
        pose: The pose, if there is one.

    Raises:
        InvalidGoal: A constraint is malformed, or bounds a motion.
        InvalidRobotState: Seed or posture have the wrong length.
        InvalidLinkName: No such link.
    """
    robot = geometry if cell is None else cell.robot
    chain = robot.chain if cell is None else cell.chain
    T = None if pose is None else poses.transform(pose)
    pose_constraints = () if T is None else (_pose_constraint(T, body),)
    wanted = constraints.constraint_set(body.constraints, chain, *pose_constraints)
    assert wanted is not None
    end = _end(body.timeout or _TIMEOUT)
    many = _ALL if body.all_solutions else 1
    options = IkOptions(
        objective=body.choice,
        posture=None if body.posture is None else np.array(body.posture),
        seed_joints=None if body.seed_joints is None else np.array(body.seed_joints),
        most=body.max_solutions or many,
        seed=body.seed,
        deadline=end.within(_SHARE * end.remaining),
    )
    solved = constrained_ik(robot, wanted, None if cell is None else cell.scene, options)
    if not solved.solutions:
        return _refusal(wanted, solved, cell, body.seed, end)
    content: dict[str, Any] = {
        "solutions": [_solution(chain, body.link, T, wanted, s) for s in solved.solutions],
        "deterministic": solved.deterministic,
    }
    if cell is not None:
        content["allowed_collisions"] = cell.overlaps(s.joints for s in solved.solutions)
    return content


def _end(seconds: float) -> Deadline:
    """Deadline of an answer; a request may have waited for its worker."""
    return Deadline(min(time.monotonic() + seconds, current.deadline().at + _LATE))


def _pose_constraint(T: Array, body: IkRequest) -> RelativePoseConstraint:
    """The pose as a constraint, free where its axes do not count."""
    axes = AXES if body.axes is None else body.axes
    return RelativePoseConstraint(
        T,
        body.link,
        position_tolerances=[0.0 if axis in axes else np.inf for axis in ("x", "y", "z")],
        orientation_tolerances=[0.0 if axis in axes else np.pi for axis in ("rx", "ry", "rz")],
    )


def _solution(
    chain: Chain,
    link: str | None,
    T: Array | None,
    wanted: ConstraintSet,
    solution: ConstrainedSolution,
) -> dict[str, Any]:
    position = orientation = None
    if T is not None:
        reached = forward(chain, solution.joints, link)
        position = float(np.linalg.norm(reached[:3, 3] - T[:3, 3]))
        orientation = float(np.linalg.norm(rotation_error(reached[:3, :3], T[:3, :3])))
    return {
        "joints": solution.joints.tolist(),
        "position_error": position,
        "orientation_error": orientation,
        "within_limits": True,
        "collision_free": None if solution.pair is None else solution.clearance > 0.0,
        "clearance": None if solution.pair is None else solution.clearance,
        "constraints": constraints.uses(wanted, solution.residuals),
    }


def _refusal(
    wanted: ConstraintSet,
    solved: ConstrainedIk,
    cell: RobotInScene | None,
    seed: int,
    end: Deadline,
) -> TaskProblem:
    """The refusal: constraints in conflict, or the one that the nearest attempt violates."""
    details: dict[str, Any] = {
        "stage": "ik",
        "nearest_joints": solved.nearest.joints.tolist(),
        "constraints": constraints.uses(wanted, solved.nearest.residuals),
        "starts": solved.starts,
    }
    clash = conflict(wanted, None, seed, end.within(_SAYING_SHARE * end.remaining))
    details["deterministic"] = solved.deterministic and not end.interruptions.occurred
    if clash is not None:
        details |= {
            "conflict": list(clash.constraints),
            "relaxations": [r if np.isfinite(r) else None for r in clash.relaxations],
        }
        return TaskProblem("INVALID_GOAL_CONSTRAINTS", clash.message, clash.hint, details)
    worst = max(details["constraints"], key=lambda use: use["residual"], default=None)
    if worst is not None and worst["residual"] > HELD:
        what = f"violates constraint {worst['constraint']} ({worst['name']}) by "
        what += f"{worst['residual']:.4g} {worst['unit']}"
        hint = "Widen it by that much, allow more time, or try another seed."
    elif solved.nearest.pair is not None:
        details |= {"pair": list(solved.nearest.pair), "clearance": solved.nearest.clearance}
        what, hint = _too_near(wanted, solved.nearest, cell)
    else:
        what, hint = "is in collision", "Widen the constraints, or try another seed."
    return TaskProblem(
        "NO_IK_SOLUTION",
        f"no configuration was found that holds all constraints: the nearest attempt {what}",
        hint,
        details,
    )


def _too_near(
    wanted: ConstraintSet, nearest: ConstrainedSolution, cell: RobotInScene | None
) -> tuple[str, str]:
    """Words for the pair that the nearest attempt has too near, and for what would help."""
    assert nearest.pair is not None
    a, b = nearest.pair
    short, obstacles = -nearest.clearance, () if cell is None else cell.scene.obstacles
    is_obstacle = any(obstacle.id in (a, b) for obstacle in obstacles)
    ways = ["widen the constraints", "try another seed"]
    if is_obstacle:
        ways.insert(1, "move the obstacle")
    if short < _TOUCHING:
        what = f"has {a!r} and {b!r} touching"
    else:
        what = f"has {a!r} and {b!r} closer than they may be by {short:.4g} m"
        if is_obstacle and short < wanted.margin:
            ways.insert(0, f"lower the margin by {short:.4g} m")
    hint = f"{', '.join(ways[:-1])}, or {ways[-1]}."
    return what, hint[0].upper() + hint[1:]
