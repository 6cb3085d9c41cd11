"""The pieces of a scene packed for the distance iteration, once for all who ask it."""

import numpy as np

from compiled.kernel import directly, kernel
from kinematics.arrays import Array, Indices
from kinematics.caches.bounded_cache import array_bytes, bounded_cache
from obstacles.convex.piece import Piece
from obstacles.distance.piece_set import (
    CENTER,
    GROUP,
    GROUP_STOP,
    HALF,
    KIND,
    MIDDLE,
    POSE,
    RADIUS,
    ROUNDING,
    SIZE,
    WIDTH,
    CoreKind,
    PieceSet,
    ball_rows,
)
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.primitives import Primitive, Primitives, write_core

_CORE_KINDS = np.array(
    [CoreKind.BOX, CoreKind.POINT, CoreKind.CYLINDER, CoreKind.CONE, CoreKind.HALFSPACE],
    dtype=np.int64,
)
_CORE_KINDS.setflags(write=False)
_BOX, _BALL = int(Primitive.BOX), int(Primitive.BALL)
_HALFSPACE = int(Primitive.HALFSPACE)
_NOTHING = PieceSet.of(())


@bounded_cache(maxsize=16, weigh=array_bytes)
def scene_set(scene: Scene) -> PieceSet:
    """A scene's pieces in the order of its obstacles, clouds as balls; read-only.

    Args:
        scene: Scene around the robot. Its rows name no obstacle and no margin.
    """
    if len(scene.primitives.kinds) == len(scene.obstacles):
        packed = _NOTHING._replace(rows=primitive_rows(scene.primitives))
    else:
        packed = pack(scene, [shaped_pieces(obstacle) for obstacle in scene.obstacles])
    for array in packed:
        array.setflags(write=False)
    return packed


def shaped_pieces(obstacle: Obstacle) -> tuple[Piece, ...]:
    """Pieces of an obstacle that is neither a primitive nor a cloud, none of others."""
    return () if obstacle.is_primitive or obstacle.is_cloud else obstacle.pieces()


def pack(scene: Scene, shaped: list[tuple[Piece, ...]]) -> PieceSet:
    """Pack the ``shaped_pieces`` of each obstacle, and between them primitives and clouds."""
    primitives = primitive_rows(scene.primitives)
    packed = PieceSet.of([piece for own in shaped for piece in own])
    blocks, first, before, primitive = [packed.rows[:0]], 0, 0, 0
    for obstacle, own in zip(scene.obstacles, shaped, strict=True):
        rows = packed.rows[first : first + len(own)]
        if obstacle.is_primitive:
            rows = primitives[primitive : primitive + 1]
            primitive += 1
        elif obstacle.is_cloud:
            balls = obstacle.balls()
            rows = ball_rows(balls.centers, balls.radii[0])
        else:
            grouped = rows[:, GROUP_STOP] > 0.0
            rows[grouped, GROUP : GROUP_STOP + 1] += before - first
        first, before = first + len(own), before + len(rows)
        blocks.append(rows)
    return packed._replace(rows=np.vstack(blocks))


def primitive_rows(primitives: Primitives) -> Array:
    """Rows of primitives, one each, shape (k, WIDTH)."""
    rows = np.zeros((len(primitives.kinds), WIDTH))
    directly(primitive_rows_kernel, primitives, _CORE_KINDS, rows)
    return rows


@kernel(allocates=False, unlocks=False)
def primitive_rows_kernel(primitives: Primitives, cores: Indices, rows: Array) -> None:
    """Write ``primitive_rows``, which hold zeros; ``cores`` has the kind of each one's core."""
    kinds, measures, poses = primitives.kinds, primitives.measures, primitives.poses
    for k in range(kinds.shape[0]):
        kind, row = kinds[k], rows[k]
        row[KIND] = cores[kind]
        height, row[RADIUS] = write_core(kind, measures[k], row[MIDDLE : MIDDLE + 6])
        for axis in range(3):
            row[CENTER + axis] = poses[k, axis, 2] * height + poses[k, axis, 3]
            for column in range(4):
                row[POSE + 4 * axis + column] = poses[k, axis, column]
            if kind == _BOX:
                row[SIZE + axis] = row[HALF + axis]
        if kind == _BALL:
            # It has no turn of its own.
            row[ROUNDING] = measures[k, 0]
            for axis in range(3):
                for column in range(3):
                    row[POSE + 4 * axis + column] = 1.0 if axis == column else 0.0
        elif kind not in (_BOX, _HALFSPACE):
            row[SIZE], row[SIZE + 1] = measures[k, 0], 0.5 * measures[k, 1]
