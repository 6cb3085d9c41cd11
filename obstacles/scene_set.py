"""The pieces of a scene packed for the distance iteration, once for all who ask it."""

import numpy as np

from kinematics.bounded_cache import array_bytes, bounded_cache
from obstacles.piece import Piece
from obstacles.piece_set import GROUP, GROUP_STOP, PieceSet, ball_rows
from obstacles.scene import Scene


@bounded_cache(maxsize=16, weigh=array_bytes)
def scene_set(scene: Scene) -> PieceSet:
    """A scene's pieces in the order of its obstacles, clouds as balls; read-only.

    Args:
        scene: What stands around. Its rows name no obstacle and no margin.
    """
    shaped = [() if obstacle.is_cloud else obstacle.pieces() for obstacle in scene.obstacles]
    packed = pack(scene, shaped)
    for array in packed:
        array.setflags(write=False)
    return packed


def pack(scene: Scene, shaped: list[tuple[Piece, ...]]) -> PieceSet:
    """Pack the pieces of each obstacle, none of a cloud, and between them the balls of clouds."""
    packed = PieceSet.of([piece for own in shaped for piece in own])
    if not any(obstacle.is_cloud for obstacle in scene.obstacles):
        return packed
    blocks, first, before = [packed.rows[:0]], 0, 0
    for obstacle, own in zip(scene.obstacles, shaped, strict=True):
        rows = packed.rows[first : first + len(own)]
        if obstacle.is_cloud:
            balls = obstacle.balls()
            rows = ball_rows(balls.centers, balls.radii[0])
        else:
            grouped = rows[:, GROUP_STOP] > 0.0
            rows[grouped, GROUP : GROUP_STOP + 1] += before - first
        first, before = first + len(own), before + len(rows)
        blocks.append(rows)
    return packed._replace(rows=np.vstack(blocks))
