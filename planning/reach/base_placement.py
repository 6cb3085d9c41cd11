"""Placement of an arm's base: candidates by the task poses that they reach, and how well."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, as_numbers, typed
from kinematics.errors import InvalidOption, InvalidPose
from kinematics.pose import inverse
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Obstacle, Scene
from planning.reach.evaluation import Reach, ReachOptions, reach
from planning.values.deadline import Deadline


@dataclass(frozen=True, slots=True, eq=False)
class BasePlacement:
    """One candidate for the base, and the reach from there.

    Args:
        index: Number of the candidate.
        T_world_base: Pose of the base, shape (4, 4).
        reach: Reach of the task poses.
    """

    index: int
    T_world_base: Array
    reach: Reach

    @property
    def worst(self) -> tuple[float, float, float]:
        """Least clearance [m], manipulability and limit distance of the poses reached."""
        figures = (self.reach.clearance, self.reach.manipulability, self.reach.limit_distance)
        if not self.reach.is_reached.any():
            return np.nan, np.nan, np.nan
        clearance, manipulability, limits = (
            float(figure[self.reach.is_reached].min()) for figure in figures
        )
        return clearance, manipulability, limits

    @property
    def score(self) -> tuple[float, ...]:
        """Number of poses reached, then the worst clearance, manipulability and limit distance."""
        return float(self.reach.is_reached.sum()), *np.nan_to_num(self.worst, posinf=np.inf)


@typed
def place_base(
    robot: RobotGeometry,
    scene: Scene,
    poses: ArrayLike,
    bases: ArrayLike,
    options: ReachOptions | None = None,
    *,
    link: str | None = None,
    deadline: Deadline | None = None,
    report: Callable[[float], None] = lambda _: None,
) -> list[BasePlacement]:
    """Candidates for the base, best first: those that reach most, then those with most room.

    The candidates and the poses stand in one frame, that of the scene. Obstacles stay where they
    are, so each candidate is judged in its own surroundings.

    Args:
        robot: The arm with its solids.
        scene: The obstacles, in the world frame.
        poses: T_world_link of the tasks, shape (m, 4, 4).
        bases: T_world_base of the candidates, shape (b, 4, 4).
        options: How to judge.
        link: The link to bring to the poses; the tip where none is named.
        deadline: Time at which to stop; candidates that were not finished are left out.
        report: Called with the share of the candidates that is done.

    Raises:
        InvalidPose: The poses or candidates are not finite 4x4 matrices.
        InvalidOption: There is no candidate.
    """
    T_world_link = as_numbers(poses, "poses")
    if T_world_link.ndim != 3:
        raise InvalidPose(f"the poses have the shape {T_world_link.shape}, not (m, 4, 4)")
    candidates = np.asarray(bases, dtype=np.float64)
    if candidates.ndim != 3 or candidates.shape[1:] != (4, 4) or not np.isfinite(candidates).all():
        raise InvalidPose("the bases must be finite 4x4 transforms, shape (b, 4, 4)")
    if not len(candidates):
        raise InvalidOption("there is no candidate for the base")
    placements = []
    for index, T_world_base in enumerate(candidates):
        T_base_world = inverse(T_world_base)
        found = reach(
            robot, moved(scene, T_base_world), T_base_world @ T_world_link, options,
            link=link, deadline=deadline,
        )  # fmt: skip
        if found.completed < len(T_world_link):
            break
        placements.append(BasePlacement(index, T_world_base, found))
        report((index + 1) / len(candidates))
    return sorted(placements, key=lambda item: item.score, reverse=True)


def moved(scene: Scene, T: Array) -> Scene:
    """The scene with every obstacle moved by T, shape (4, 4)."""
    return Scene(
        [
            Obstacle(item.id, item.shape, T @ item.T_world_obstacle, item.margin)
            for item in scene.obstacles
        ],
        scene.allowed_collisions,
    )
