"""Drawing of the bodies that collide where a plan fails: coloured, and named by labels."""

from collections.abc import Mapping, Sequence

import numpy as np
import viser

from armwright_client import Pose
from studio.page.obstacle_drawing import ObstacleDrawing
from studio.page.robot_drawing import RobotDrawing


class PairDrawing:
    """Marks on the bodies of a failure.

    Args:
        scene: Scene of viser to draw in.
    """

    def __init__(self, scene: viser.SceneApi) -> None:
        self._scene = scene
        self._labels: list[viser.SceneNodeHandle] = []

    def show(
        self,
        pairs: Sequence[tuple[str, str]],
        robot: RobotDrawing,
        links: Mapping[str, Pose],
        obstacles: Mapping[str, ObstacleDrawing],
    ) -> None:
        """Mark the bodies of pairs in place of those before.

        Args:
            pairs: Names of links and obstacles.
            robot: Drawing of the robot.
            links: Poses of the links at the configuration that is drawn.
            obstacles: Drawings of the obstacles, by id.
        """
        self.clear()
        names = {name for pair in pairs for name in pair}
        robot.mark(names)
        for name, drawing in obstacles.items():
            drawing.mark(name in names)
        for number, (a, b) in enumerate(pairs):
            place = [links[name].position for name in (a, b) if name in links]
            place += [
                obstacles[name].obstacle.pose.position for name in (a, b) if name in obstacles
            ]
            if place:
                position = np.mean(np.array(place, dtype=float), axis=0)
                text = f"✗ {a} and {b}"
                self._labels.append(
                    self._scene.add_label(f"/failure/{number}", text, position=position)
                )

    def clear(self) -> None:
        """Remove the labels; the marks go with the next drawing of the bodies."""
        for label in self._labels:
            label.remove()
        self._labels = []
