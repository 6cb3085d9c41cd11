"""Conversion and composition of poses, as requests ask for it, in workers."""

from dataclasses import asdict
from typing import Any

from pydantic_core import to_json

from armwright_wire.pose import ConvertPoseRequest
from kinematics import pose as rotation
from kinematics.arrays import Array
from kinematics.pose import (
    compose,
    rpy_branches,
    singular_forms,
    zyz_branches,
)
from service.translate.poses import rounding_notes, transform
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
    if body.angular_velocity is not None:
        S = rotation.skew(body.angular_velocity)
        answer |= {"skew": S.tolist(), "rotation_rate": (S @ T[:3, :3]).tolist()}
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
