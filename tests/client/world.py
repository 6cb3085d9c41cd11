"""A table, a post and configurations beside them."""

from collections.abc import Sequence

import armwright_client as ours
from armwright_client import Pose

READY = (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785)


AWAY = (1.2, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785)


def box(name: str, size: Sequence[float], position: Sequence[float]) -> ours.Obstacle:
    return ours.Obstacle(id=name, shape=ours.Box(size=size), pose=Pose(position=position))


TABLE = box("table_top", (0.6, 0.8, 0.04), (0.7, 0.0, -0.1))


POST = box("post", (0.04, 0.04, 0.6), (0.42, 0.22, 0.5))


def planar(name: str) -> ours.RobotUpload:
    row = ours.DhRow(
        type="revolute", a=0.5, alpha=0, d=0, theta=0, lower=-3, upper=3, velocity=2, acceleration=5
    )
    return ours.RobotUpload.from_dh(name, ours.DhTable(convention="standard", rows=[row, row]))
