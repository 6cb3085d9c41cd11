"""An arm of example-robot-data in the studio, by the commands that its page has.

The arm is packed into a .zip as it lies, uploaded, drawn, moved, planned for and played: no file is
edited.
"""

from typing import NamedTuple

import numpy as np

from benchmarks.arms import UPLOADS
from benchmarks.problems.example_arms import archive, package
from kinematics.urdf.visuals import read_visuals
from studio.motion_frames import motion_frames
from studio.page.studio_page import StudioPage
from studio.state import Failure, Planned, Verdict
from studio.workbench import Workbench

#: Goals tried for one that is free and can be planned to, drawn with this seed.
TRIES, SEED = 20, 0
#: Part of each joint's range that goals are drawn from, about the start.
SPREAD = 0.25


class Shown(NamedTuple):
    """One arm in the studio.

    Attributes:
        joints: number of joints of its chain.
        triangles: number of triangles of its collision geometry.
        looks: number of links that are drawn by their visual meshes.
        branches: numbers of configurations that reach the goal, valid and all.
        outcome: the motion, or why there is none.
        frames: number of frames that play the motion.
    """

    joints: int
    triangles: int
    looks: int
    branches: tuple[int, int]
    outcome: Planned | Failure | None
    frames: int


def show(page: StudioPage, name: str) -> Shown:
    """Upload, draw, plan and play one arm.

    Args:
        page: Of the studio, in no browser.
        name: Of the arm.

    Raises:
        ApiError: The upload is refused.
    """
    workbench = page.workbench
    file_name = f"example_{name.lower().replace(' ', '_').replace(',', '')}.zip"
    urdf, fields = UPLOADS[name]
    workbench.upload_robot(file_name, archive(urdf), fields)
    page.rebuild()
    triangles = sum(len(body.triangles()) for body in workbench.geometry().bodies)
    looks = len({body.link for body in workbench.geometry("visual").bodies} & _seen(name))
    branches, outcome = _plan(workbench)
    frames = 0
    if isinstance(outcome, Planned):
        page.show_outcome()
        frames = len(motion_frames(workbench, outcome).times)
    joints = len(workbench.model.joint_names)
    return Shown(joints, triangles, looks, branches, outcome, frames)


def _seen(name: str) -> set[str]:
    """Links with visual geometry in the description."""
    return set(read_visuals((package() / UPLOADS[name][0]).read_bytes()).links)


def _plan(workbench: Workbench) -> tuple[tuple[int, int], Planned | Failure | None]:
    """Goals about the start until one can be planned to: the branches of its pose, and the plan."""
    rng = np.random.default_rng(SEED)
    low, high = np.array(workbench.joint_ranges()).T
    counts, outcome = (0, 0), None
    for _ in range(TRIES):
        start, goal = (_draw(rng, low, high, workbench) for _ in range(2))
        if start is None or goal is None:
            continue
        workbench.set_start(start)
        workbench.set_goal_joints(goal)
        branches = workbench.move_goal(workbench.goal_tip())
        valid = [branch for branch in branches if branch.verdict is Verdict.VALID]
        counts = (len(valid), len(branches))
        found = workbench.plan()
        outcome = found if isinstance(found, Planned | Failure) else None
        if isinstance(outcome, Planned):
            break
    return counts, outcome


def _draw(
    rng: np.random.Generator,
    low: np.ndarray[tuple[int], np.dtype[np.float64]],
    high: np.ndarray[tuple[int], np.dtype[np.float64]],
    workbench: Workbench,
) -> list[float] | None:
    """A configuration that is free, if one of some draws is."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    for _ in range(TRIES):
        q = middle + SPREAD * 2.0 * half * rng.uniform(-1.0, 1.0, len(middle))
        joints = [float(value) for value in q]
        if workbench.client.check(workbench.state.robot, joints, depth=False).valid:
            return joints
    return None
