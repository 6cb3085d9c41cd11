"""Witnesses as answers give them."""

import base64
from collections.abc import Mapping
from typing import Any

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.proof.certificate import Certificate
from planning.values.deadline import Deadline
from planning.values.limits import MotionLimits
from planning.witness.compact import Witness
from planning.witness.witness import witness


def witness_answer(found: Witness) -> dict[str, Any]:
    """A witness as answers give it: its compact form, and what it does not show."""
    told = found.document_of("unwitnessed")
    return {"compact": base64.b64encode(found.compact).decode(), "unwitnessed": told}


def part_witness(
    motion: Trajectory, cell: tuple[RobotGeometry, Scene], proof: Certificate,
    bounds: Mapping[str, Array], deadline: Deadline, fingers: int = 0,
) -> dict[str, Any]:  # fmt: skip
    """Witness of the motion of one stage or leg.

    Args:
        motion: The motion.
        cell: Robot with what it holds, and its surroundings.
        proof: Its certificate.
        bounds: Limits in place of the robot's.
        deadline: Instant from which on no more directions are looked for.
        fingers: Motions of the gripper in it.
    """
    untold = {
        "constraints": len(proof.path_constraints),
        "tool_motions": int(proof.path_deviation is not None),
        "torque": int("torque" in proof.limits),
        "tool_speed": int("tool_speed" in proof.limits),
        "fingers": fingers,
    }
    return witness_answer(
        witness(
            motion, *cell, margin=proof.premises.margin, limits=MotionLimits(bounds),
            untold=untold, deadline=deadline,
        )
    )  # fmt: skip
