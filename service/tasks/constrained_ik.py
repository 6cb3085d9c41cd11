"""Inverse kinematics under constraints as requests ask for it, in workers."""

from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.chain import Chain
from kinematics.forward import forward
from kinematics.ik.numeric import AXES
from kinematics.pose import rotation_error
from obstacles.robot_geometry import RobotGeometry
from planning.constrained.ik import ConstrainedIk, ConstrainedSolution, IkOptions, constrained_ik
from planning.constraints.conflict import conflict
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.relative_pose import RelativePoseConstraint
from planning.deadline import Deadline
from service.schemas.kinematics import IkRequest
from service.schemas.pose import Pose
from service.tasks.attached_objects import RobotInScene
from service.tasks.result import TaskProblem
from service.translate import constraints, poses

#: Solutions where all are wanted but no number is given.
_ALL = 16
#: Time where the request names none [s].
_TIMEOUT = 5.0
#: Overlap that is told as touching, not as a length [m].
_TOUCHING = 1e-6
#: Share of it for the search; the rest is kept for saying why nothing was found.
_SHARE = 0.5


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
    chain = robot.chain
    T = None if pose is None else poses.transform(pose)
    pose_constraints = () if T is None else (_pose_constraint(T, body),)
    wanted = constraints.constraint_set(body.constraints, chain, *pose_constraints)
    assert wanted is not None
    many = _ALL if body.all_solutions else 1
    options = IkOptions(
        objective=body.choice,
        posture=None if body.posture is None else np.array(body.posture),
        seed_joints=None if body.seed_joints is None else np.array(body.seed_joints),
        most=body.max_solutions or many,
        seed=body.seed,
        deadline=Deadline.after(_SHARE * (body.timeout or _TIMEOUT)),
    )
    solved = constrained_ik(robot, wanted, None if cell is None else cell.scene, options)
    if not solved.solutions:
        return _refusal(wanted, solved, body)
    content: dict[str, Any] = {
        "solutions": [_solution(chain, body.link, T, wanted, s) for s in solved.solutions],
        "deterministic": solved.deterministic,
    }
    if cell is None:
        # Own links are apart; of obstacles nothing is known.
        unknown = {"collision_free": None, "clearance": None}
        content["solutions"] = [solution | unknown for solution in content["solutions"]]
    if cell is not None and cell.allowed:
        content["allowed_collisions"] = cell.allowed
    return content


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


def _refusal(wanted: ConstraintSet, solved: ConstrainedIk, body: IkRequest) -> TaskProblem:
    """The refusal: constraints in conflict, or the one that the nearest attempt violates."""
    details: dict[str, Any] = {
        "stage": "ik",
        "nearest_joints": solved.nearest.joints.tolist(),
        "constraints": constraints.uses(wanted, solved.nearest.residuals),
        "starts": solved.starts,
        "deterministic": solved.deterministic,
    }
    clash = conflict(wanted, None, body.seed)
    if clash is not None:
        details |= {
            "conflict": list(clash.constraints),
            "relaxations": [r if np.isfinite(r) else None for r in clash.relaxations],
        }
        return TaskProblem("INVALID_GOAL_CONSTRAINTS", clash.message, clash.hint, details)
    worst = max(details["constraints"], key=lambda use: use["residual"], default=None)
    if worst is not None and worst["residual"] > 0.0:
        what = f"violates constraint {worst['constraint']} ({worst['name']}) by "
        what += f"{worst['residual']:.4g} {worst['unit']}"
        hint = "Widen it by that much, allow more time, or try another seed."
    elif solved.nearest.pair is not None:
        a, b = solved.nearest.pair
        short = -solved.nearest.clearance
        what = f"has {a!r} and {b!r} closer than they may be by {short:.4g} m"
        details |= {"pair": [a, b], "clearance": solved.nearest.clearance}
        hint = f"Lower the margin by {short:.4g} m, widen the constraints, or move the obstacle."
        if short < _TOUCHING:
            what, hint = f"has {a!r} and {b!r} touching", "Widen the constraints."
    else:
        what, hint = "is in collision", "Lower the margin, or widen the constraints."
    return TaskProblem(
        "NO_IK_SOLUTION",
        f"no configuration was found that holds all constraints: the nearest attempt {what}",
        hint,
        details,
    )
