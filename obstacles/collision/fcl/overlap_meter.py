"""How deep pairs that may touch overlap in single configurations, by FCL."""

from collections.abc import Iterable

from kinematics.arrays import Array, Indices
from kinematics.caches.bounded_cache import bounded_cache
from obstacles.collision.fcl.fcl_distance import FclWorld
from obstacles.robots.allowed_pairs import (
    DEPTH_TOLERANCE,
    AllowedPair,
    Overlap,
    allowed_pairs,
    piece_pairs,
)
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Pair, Scene


class OverlapMeter:
    """Measures how deep allowed pairs are in single configurations, by FCL.

    Args:
        robot: Robot with the pieces of what it holds.
        scene: Scene around the robot.
    """

    def __init__(self, robot: RobotGeometry, scene: Scene) -> None:
        self.pairs = allowed_pairs(robot, scene)
        self._measured = [pair for pair in self.pairs if pair.measured]
        self.limited = any(item.limited for item in self._measured)
        self._world = FclWorld(robot, scene) if self._measured else None
        self._pieces = [piece_pairs(robot, scene, item.pair) for item in self._measured]

    def depths(self, q: Array) -> dict[Pair, float]:
        """How deep each measured pair is in a configuration (n,), 0 where it is apart [m]."""
        if self._world is None:
            return {}
        self._world.set_configuration(q)
        return {
            item.pair: self._deepest(self._world, pieces)
            for item, pieces in zip(self._measured, self._pieces, strict=True)
        }

    def too_deep(self, q: Array) -> list[tuple[AllowedPair, float]]:
        """Pairs deeper than they may be in a configuration (n,), each with its depth [m]."""
        if not self.limited:
            return []
        depths = self.depths(q)
        beyond = [(item, depths[item.pair]) for item in self._measured]
        return [(i, depth) for i, depth in beyond if depth > i.touch_depth + DEPTH_TOLERANCE]

    def told(self, configurations: Iterable[Array]) -> list[Overlap]:
        """All pairs, measured ones with how deep they are in the deepest of configurations (n,)."""
        deepest: dict[Pair, float] = {}
        for q in configurations:
            for pair, depth in self.depths(q).items():
                deepest[pair] = max(depth, deepest.get(pair, 0.0))
        return [Overlap(item.pair, item.reason, deepest.get(item.pair)) for item in self.pairs]

    @staticmethod
    def _deepest(world: FclWorld, pieces: Indices) -> float:
        i, j = pieces.T
        near = pieces[world.ball_bounds(i, j) < 0.0].tolist()
        return max((0.0, *(-world.between(a, b) for a, b in near)))


@bounded_cache(maxsize=4)
def overlap_meter(robot: RobotGeometry, scene: Scene) -> OverlapMeter:
    """Meter of a robot in a scene; the last few are kept."""
    return OverlapMeter(robot, scene)
