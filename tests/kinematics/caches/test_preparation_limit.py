"""Preparation of meshes is given up when time is up, and goes on where it was."""

import math
from collections.abc import Iterator
from itertools import count

import numpy as np
import pytest
import trimesh

from kinematics.caches import preparation_limit as limit_module
from kinematics.caches.preparation_limit import (
    PreparationTimedOut,
    check_preparation_time,
    limit_preparation,
    preparation_limit,
)
from obstacles.collision.model import brackets as brackets_module
from obstacles.convex.sphere_set import SphereSet
from obstacles.distance.piece_set import PieceSet
from obstacles.meshes.decomposition import convex_pieces
from obstacles.shapes.shape import Mesh
from tests.planning.scenes import builtin


class Clock:
    """A clock that goes on by one second each time that it is looked at."""

    def __init__(self) -> None:
        self.ticks = count()

    def monotonic(self) -> float:
        return float(next(self.ticks))


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Iterator[Clock]:
    made = Clock()
    monkeypatch.setattr(limit_module, "time", made)
    yield made
    limit_preparation(math.inf)


def ring(size: float) -> tuple[np.ndarray, np.ndarray]:
    body = trimesh.creation.torus(size, 0.3 * size, major_sections=12, minor_sections=8)
    return np.asarray(body.vertices), np.asarray(body.faces, dtype=np.int64)


def test_the_nearest_limit_counts_and_ends_with_its_block(clock: Clock) -> None:
    check_preparation_time()
    with preparation_limit(10.0), preparation_limit(100.0):
        while next(clock.ticks) < 9:
            pass
        with pytest.raises(PreparationTimedOut, match="meshes were being prepared") as told:
            check_preparation_time()
        assert told.value.code == "TIMED_OUT"
        assert told.value.details["stage"] == "preparation"
    check_preparation_time()
    limit_preparation(5.0)
    with pytest.raises(PreparationTimedOut):
        check_preparation_time()
    limit_preparation(math.inf)
    check_preparation_time()


def test_spheres_are_made_piece_by_piece_until_time_is_up(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, made = builtin("ur5e"), list[SphereSet]()
    whole = brackets_module.brackets(robot)

    def keep(piece: object, most: int) -> SphereSet:
        made.append(whole.sets[len(made)])
        return made[-1]

    monkeypatch.setattr(brackets_module, "sphere_set", keep)
    make, clock.ticks = brackets_module.brackets.__wrapped__, count()
    with preparation_limit(4.0), pytest.raises(PreparationTimedOut):
        make(robot)
    assert len(made) == 4
    made.clear()
    assert np.array_equal(make(robot).spheres, whole.spheres)


def test_cuts_and_trees_of_meshes_are_given_up_too(clock: Clock) -> None:
    vertices, faces = ring(0.123)
    parts = convex_pieces(vertices, faces)
    looks = clock.monotonic()
    # Whenever time is up, it is noticed; nothing half done is kept.
    for until in np.linspace(1.0, looks - 2.0, 7):
        other = vertices * (1.0 + 1e-3 * until)
        clock.ticks = count()
        with preparation_limit(float(until)), pytest.raises(PreparationTimedOut):
            convex_pieces(other, faces)
        assert len(convex_pieces(other, faces)) == len(parts)
    pieces = Mesh(vertices, faces).pieces()
    assert sum(piece.surface is not None for piece in pieces) > 2
    clock.ticks = count()
    with preparation_limit(2.0), pytest.raises(PreparationTimedOut):
        PieceSet.of(pieces)
    assert len(PieceSet.of(pieces).rows) == len(pieces)
