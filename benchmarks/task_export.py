"""Tasks of a UR5 with a hand as a file, for peers in environments of their own."""

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from benchmarks.example_arms import ARMS, package
from benchmarks.task_problems import Arm, TaskProblem, hand_mesh
from obstacles.shapes import Box, Cylinder
from planning.sequence.stage import Grasp, Place


def export(path: Path, used: Arm, tasks: list[TaskProblem], folder: Path) -> None:
    """Write the robot's files and the solids, grasps and places of each task.

    Args:
        path: The file.
        used: The UR5; its hand is a mesh on its flange.
        tasks: Of it.
        folder: Of the Panda's files.
    """
    ur5 = ARMS["ur5"]
    assert ur5.srdf is not None
    pairs = ElementTree.parse(package() / ur5.srdf).getroot().iter("disable_collisions")
    case = {
        "urdf": str(package() / ur5.urdf),
        "packages": str(package().parents[1]),
        "folder": str(path.parent.resolve()),
        "disabled": [[pair.attrib["link1"], pair.attrib["link2"]] for pair in pairs],
        "joints": list(used.robot.chain.joint_names),
        "mount": "tool0",
        "hand": str(hand_mesh(folder).resolve()),
        "turn": -np.pi / 4.0,
        "tasks": [_task(problem) for problem in tasks],
    }
    path.write_text(json.dumps(case))


def _task(problem: TaskProblem) -> dict[str, object]:
    grasp, place = problem.task.stages[2], problem.task.stages[8]
    assert isinstance(grasp, Grasp)
    assert isinstance(place, Place)
    solids = []
    for obstacle in problem.task.world.scene.obstacles:
        shape = obstacle.shape
        if isinstance(shape, Box):
            kind, size = "box", list(shape.size)
        else:
            assert isinstance(shape, Cylinder)
            kind, size = "cylinder", [shape.height, shape.radius]
        T = obstacle.T_world_obstacle.tolist()
        solids.append({"id": obstacle.id, "type": kind, "size": size, "T": T})
    return {
        "name": problem.name,
        "start": problem.task.start.tolist(),
        "object": problem.object,
        "mount": "tool0",
        "solids": solids,
        "grips": grasp.frames.tolist(),
        "places": place.poses.tolist(),
    }
