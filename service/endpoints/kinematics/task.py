"""Kinematics of a robot, and conversion of poses, as requests ask for them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from pydantic_core import to_json

from armwright_wire.pose import ConvertPoseRequest, Orientation
from armwright_wire.robots.dynamics import WrenchRequest
from armwright_wire.robots.kinematics import (
    FkRequest,
    JacobianRequest,
    VelocityRequest,
    WithHeldFrames,
)
from kinematics import pose as rotation
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.forward import forward, link_poses
from kinematics.ik.numeric.numeric import AXES, Axis
from kinematics.jacobian import analytic_zyz, geometric
from kinematics.model.chain import Chain, with_frames
from kinematics.pose import (
    compose,
    rpy_branches,
    singular_forms,
    to_axis_angle,
    to_quaternions,
    to_rpy,
    to_zyz,
    zyz_branches,
)
from kinematics.velocity import (
    DAMPED_BELOW,
    JointVelocities,
    SingularDirections,
    rates_of_task,
    singular_directions,
)
from service.translate.poses import rounding_notes, transform
from service.workers.answer import chain_task, frame_transform, in_frame
from service.workers.task import task


@task
def convert_pose(content: bytes) -> bytes:
    """Answer a request to convert or compose poses.

    Raises:
        InvalidPose: An orientation is no rotation.
    """
    body = ConvertPoseRequest.model_validate_json(content)
    answer: dict[str, Any] = {}
    if body.motions is not None:
        poses = compose([(transform(motion), motion.about) for motion in body.motions])
        answer["poses"] = poses.tolist()
        T = poses[-1]
    else:
        assert body.pose is not None
        T = transform(body.pose)
    T = rotation.inverse(T) if body.inverse else T
    omega = body.angular_velocity
    if body.rotation_rate is not None:
        omega = rotation.angular_velocity(T[:3, :3], np.array(body.rotation_rate)).tolist()
    if omega is not None:
        S = rotation.skew(omega)
        rate = (S @ T[:3, :3]).tolist()
        answer |= {"angular_velocity": omega, "skew": S.tolist(), "rotation_rate": rate}
    singular = [asdict(form) for form in singular_forms(T[:3, :3])]
    answer |= {"pose": _forms(T), "inverse": _forms(rotation.inverse(T)), "singular": singular}
    answer["notes"] = rounding_notes(body)
    return to_json(answer)


def _forms(T: Array) -> dict[str, Any]:
    """A transform (4, 4) in every form."""
    R = T[:3, :3]
    axis, angle = rotation.to_axis_angle(R)
    zyz, rpy = zyz_branches(R).tolist(), rpy_branches(R).tolist()
    return {
        "position": T[:3, 3].tolist(),
        "quaternion_xyzw": rotation.to_quaternion(R).tolist(),
        "rotation_matrix": R.tolist(),
        "euler_zyz": zyz[0],
        "rpy": rpy[0],
        "axis_angle": [*axis.tolist(), angle],
        "transform": T.tolist(),
        "euler_zyz_branches": zyz,
        "rpy_branches": rpy,
    }


def fk(chain: Chain, body: FkRequest) -> bytes:
    """Answer a request for forward kinematics.

    Raises:
        InvalidRobotState: Wrong length.
        InvalidLinkName: No such link.
    """
    chain = with_held(chain, body)
    return to_json(fk_document(chain, body, link_poses(chain, body.joints)))


def with_held(chain: Chain, body: WithHeldFrames) -> Chain:
    """Chain with the frames of a request's attached objects as links.

    Raises:
        InvalidLinkName: There is no link that holds one, or its id is a link's.
        InvalidOption: One is attached by grasp_joints.
    """
    frames = []
    for item in body.attached or ():
        if item.pose is None:
            raise InvalidOption(
                f"attached object {item.id!r} has grasp_joints: where it is would need the scene",
                hint="Give its pose in the frame of the link that holds it.",
            )
        frames.append((item.id, item.link, transform(item.pose)))
    return with_frames(chain, frames)


def fk_document(chain: Chain, body: FkRequest, poses: Array) -> dict[str, Any]:
    """The answer to a request for forward kinematics.

    Args:
        chain: The robot.
        body: The request.
        poses: Poses of all links in the root frame, shape (..., links, 4, 4).

    Raises:
        InvalidLinkName: No such link.
    """
    wanted = chain.link(body.link or chain.tip_link).name
    T = frame_transform(chain, body.joints, body.frame)
    if T is not None:
        poses = _inverse(T)[..., None, :, :] @ poses
    answers = _poses(poses, body.orientation)
    links = {
        link.name: answers[i] if poses.ndim == 3 else [row[i] for row in answers]
        for i, link in enumerate(chain.links)
    }
    return {"pose": links[wanted], "links": links, **in_frame(chain, body.frame)}


def _inverse(T: Array) -> Array:
    """Inverse rigid motions, shape (..., 4, 4)."""
    result = np.zeros_like(T)
    R = np.swapaxes(T[..., :3, :3], -1, -2)
    result[..., :3, :3], result[..., 3, 3] = R, 1.0
    result[..., :3, 3] = -(R @ T[..., :3, 3, None])[..., 0]
    return result


def _turn(T: Array, twists: Array) -> Array:
    """Columns of twists (..., 6, m) of the root frame, seen in the frame T_root_frame."""
    R = np.swapaxes(T[..., :3, :3], -1, -2)
    return np.concatenate([R @ twists[..., :3, :], R @ twists[..., 3:, :]], axis=-2)


def _poses(poses: Array, form: Orientation) -> Any:
    positions = poses[..., :3, 3].tolist()
    turns = _orientations(poses[..., :3, :3], form).tolist()
    if poses.ndim == 3:
        return _pose_documents(positions, turns, form)
    return [_pose_documents(*row, form) for row in zip(positions, turns, strict=True)]


def _axis_and_angle(rotation: Array) -> Array:
    axis, angle = to_axis_angle(rotation)
    return np.append(axis, angle)


#: Of one rotation matrix, for forms that there is no batch of.
_CONVERSIONS: Mapping[str, Callable[[Array], Array]] = {
    "euler_zyz": to_zyz,
    "rpy": to_rpy,
    "axis_angle": _axis_and_angle,
}


def _orientations(rotations: Array, form: Orientation) -> Array:
    if form == "quaternion_xyzw":
        return to_quaternions(rotations)
    if form == "rotation_matrix":
        return rotations
    convert = _CONVERSIONS[form]
    turns = np.array([convert(R) for R in rotations.reshape(-1, 3, 3)])
    return turns.reshape(*rotations.shape[:-2], -1)


def _pose_documents(positions: Any, turns: Any, form: Orientation) -> list[dict[str, Any]]:
    return [{"position": p, form: turn} for p, turn in zip(positions, turns, strict=True)]


def jacobian(chain: Chain, body: JacobianRequest) -> bytes:
    """Answer a request for Jacobians.

    Raises:
        InvalidRobotState: Wrong length.
        InvalidLinkName: No such link.
        InvalidOption: The zyz rates do not exist at a configuration.
    """
    chain = with_held(chain, body)
    J = geometric(chain, body.joints, body.link, body.point)
    T = frame_transform(chain, body.joints, body.frame)
    if T is not None:
        J = _turn(T, J)
    if body.kind == "analytic_zyz":
        flat = J.reshape(-1, 6, chain.n)
        turns = forward(chain, body.joints, body.link)[..., :3, :3]
        if T is not None:
            turns = np.swapaxes(T[..., :3, :3], -1, -2) @ turns
        turns = turns.reshape(-1, 3, 3)
        J = np.array([analytic_zyz(*pair) for pair in zip(flat, turns, strict=True)]).reshape(
            J.shape
        )
    J = _rows(J, body.axes)
    found = singular_directions(J)
    answer = {
        "jacobian": J.tolist(),
        "rank": found.rank.tolist(),
        "singular_values": found.values.tolist(),
        "manipulability": found.values.prod(axis=-1).tolist(),
    }
    return to_json(answer | in_frame(chain, body.frame))


def task_jacobian(chain: Chain, body: JacobianRequest | VelocityRequest | WrenchRequest) -> Array:
    """The rows of a request's Jacobian that count, in its frame, shape (..., m, n)."""
    chain = with_held(chain, body)
    J = geometric(chain, body.joints, body.link, body.point)
    T = frame_transform(chain, body.joints, body.frame)
    if T is not None:
        J = _turn(T, J)
    return _rows(J, body.axes)


def task_vectors(values: Any, axes: Sequence[Axis] | None) -> Array:
    """The numbers of vectors (..., m) or (..., 6) for the axes that count, in their order."""
    array = np.array(values, dtype=np.float64)
    if axes is None or array.shape[-1] == len(axes):
        return array
    return array[..., [AXES.index(axis) for axis in axes]]


def _rows(J: Array, axes: Sequence[Axis] | None) -> Array:
    return J if axes is None else J[..., [AXES.index(axis) for axis in axes], :]


def velocity(chain: Chain, body: VelocityRequest) -> bytes:
    """Answer a request for velocity kinematics, forward or inverse.

    Raises:
        InvalidRobotState: Wrong length.
        InvalidLinkName: No such link.
        InvalidOption: Lists of different lengths.
    """
    joints = chain.configuration(body.joints)
    J = task_jacobian(chain, body)
    if body.twist is None:
        assert body.joint_velocities is not None
        rates = chain.configuration(body.joint_velocities, "joint_velocities")
        _check_rows(joints, rates, "joint_velocities")
        twist = (J @ rates[..., None])[..., 0]
        found = singular_directions(J)
        rates = np.broadcast_to(rates, (*twist.shape[:-1], chain.n))
        gains = np.ones_like(found.values)
        solved = JointVelocities(rates, np.zeros_like(twist), gains, found)
    else:
        asked = task_vectors(body.twist, body.axes)
        _check_rows(joints, asked, "twist")
        nullspace = None
        if body.nullspace is not None:
            nullspace = chain.configuration(body.nullspace, "nullspace")
            _check_rows(joints, nullspace, "nullspace")
        below = DAMPED_BELOW if body.damped_below is None else body.damped_below
        solved = rates_of_task(J, asked, nullspace=nullspace, damped_below=below)
        twist = asked - solved.residual
    return to_json(
        {
            "twist": twist.tolist(),
            "joint_velocities": solved.joint_velocities.tolist(),
            "residual": solved.residual.tolist(),
            "rank": solved.directions.rank.tolist(),
            "singular_values": solved.directions.values.tolist(),
            "damped": _damped_directions(solved),
            **in_frame(chain, body.frame),
        }
    )


def _check_rows(joints: Array, others: Array, name: str) -> None:
    """Check that rows go with as many configurations; one row goes with any number.

    Raises:
        InvalidOption: They do not.
    """
    count = 1 if joints.ndim == 1 else len(joints)
    if others.ndim == 2 and (joints.ndim == 1 or len(others) != count):
        raise InvalidOption(
            f"{name} holds {len(others)} rows for {count} configuration(s) in joints",
            hint=f"Give as many rows of {name} as of joints, or one row for all.",
        )


def _damped_directions(solved: JointVelocities) -> Any:
    found = solved.directions
    if solved.gains.ndim == 1:
        return [
            {
                "singular_value": found.values[i],
                "gain": solved.gains[i],
                "twist": found.twists[:, i].tolist(),
                "joint_velocities": found.motions[i].tolist(),
            }
            for i in np.flatnonzero(solved.gains < 1.0)
        ]
    return [
        _damped_directions(
            JointVelocities(
                rates, residual, gains, SingularDirections(values, twists, motions, rank)
            )
        )
        for rates, residual, gains, values, twists, motions, rank in zip(
            solved.joint_velocities,
            solved.residual,
            solved.gains,
            found.values,
            found.twists,
            found.motions,
            found.rank,
            strict=True,
        )
    ]


fk_task = chain_task(fk, FkRequest)
jacobian_task = chain_task(jacobian, JacobianRequest)
velocity_task = chain_task(velocity, VelocityRequest)
