"""Proposed directions: they part what is apart, and rows are those of the pieces themselves."""

import itertools

import numpy as np
import pytest

from kinematics.arrays import Array
from obstacles.convex.piece import PieceKind
from obstacles.distance.piece_set import GROUP, GROUP_STOP, POSE, PieceSet
from obstacles.distance.signed_distance import signed_distance
from obstacles.distance.triangles.distance import touching
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import HalfSpace, PointCloud
from planning.proof.collision.interval_check import check_interval
from planning.proof.collision.pair_table import HOLDER, PairTable
from planning.proof.collision.proposals import (
    FIRST_NODE,
    STOP_NODE,
    empty_proposal,
    packed_pieces,
    propose,
)
from planning.proof.collision.separating_direction import gap
from planning.proof.collision.sweep_state import Sweep, pop_interval
from tests.obstacles.arms import cup, mesh_shape
from tests.obstacles.outline import convex_shapes
from tests.obstacles.solids import random_transform
from tests.planning.proof.sweeping import start_sweep, through
from tests.planning.slider import slider


def scattered(seed: int) -> Scene:
    """Every convex shape, a cloud and a mesh around the ball, in random order."""
    random = np.random.default_rng(seed)
    shapes = [
        *convex_shapes(random),
        PointCloud(random.normal(size=(6, 3)), 0.05),
        mesh_shape(cup()),
    ]
    order = random.permutation(len(shapes))
    return Scene(Obstacle(f"o{k}", shapes[k], random_transform(random, 0.6)) for k in order)


def placed(scene: Scene) -> tuple[PairTable, Sweep]:
    """All elements where they are at the start of a motion."""
    trajectory = through([0.2, -0.1], [0.3, 0.0])
    table = PairTable.of(slider(), scene, 0.0)
    sweep = start_sweep(trajectory, table.arrays)
    pop_interval(trajectory.breaks, trajectory.coefficients, sweep)
    check_interval(table.arrays, sweep)
    arrays = table.arrays
    # The check places what it looks at: here all are wanted.
    for k in range(len(arrays.kinds)):
        T = np.eye(4) if arrays.joints[k] < 0 else sweep.frames[arrays.joints[k]]
        sweep.poses[k] = T @ arrays.poses[k]
        sweep.centers[k] = T[:3, :3] @ arrays.centers[k] + T[:3, 3]
    return table, sweep


def proposed(table: PairTable, sweep: Sweep, i: int, j: int) -> tuple[float, Array]:
    """What is proposed for elements i and j: their distance about, and the direction."""
    proposal = empty_proposal()
    proposal.axis[:] = sweep.centers[i] - sweep.centers[j] + [1e-3, 2e-3, 3e-3]
    upper = propose(table.arrays.proposals, i, j, sweep.poses, sweep.centers, np.inf, proposal)
    return float(upper), proposal.axis / np.linalg.norm(proposal.axis)


@pytest.mark.parametrize("seed", range(4))
def test_what_is_apart_is_parted_by_the_proposal(seed: int) -> None:
    table, sweep = placed(scattered(seed))
    arrays, parted = table.arrays, 0
    for i in range(arrays.moving, len(arrays.kinds)):
        if arrays.kinds[i] == HOLDER:
            continue
        solid, ball = table.solid(i), table.solid(0)
        lower, upper = signed_distance(solid, sweep.poses[i], ball, sweep.poses[0])
        told, axis = proposed(table, sweep, i, 0)
        if lower < 1e-6:
            assert told <= max(upper, 0.0) + 1e-6
            continue
        # From the ball towards the solid: the proof checks it from the solid towards the ball.
        assert told == pytest.approx(upper, abs=1e-5)
        u = (float(-axis[0]), float(-axis[1]), float(-axis[2]))
        apart, _ = gap(
            arrays.kinds, arrays.sizes, arrays.columns, arrays.starts, sweep.poses, i, 0, u
        )
        assert apart == pytest.approx(lower, abs=1e-5)
        parted += 1
    assert parted > 5


@pytest.mark.parametrize("seed", [5, 6, 7])
def test_rows_are_those_of_the_pieces_and_of_nothing_else(seed: int) -> None:
    """In the order of robot and scene: each two touch that touch when packed by themselves."""
    robot, scene = slider(), scattered(seed)
    count = len(scene.pieces()[1])
    packed = packed_pieces(robot, scene)
    alone = PieceSet.of([*robot.pieces, *(scene.piece(k) for k in range(count))])
    assert len(packed.rows) == len(robot.pieces) + count
    np.testing.assert_allclose(packed.rows[:, POSE : POSE + 12], alone.rows[:, POSE : POSE + 12])
    groups = slice(GROUP, GROUP_STOP + 1)
    np.testing.assert_array_equal(packed.rows[:, groups], alone.rows[:, groups])
    verdicts = [
        (touching(packed, i, j), touching(alone, i, j))
        for i, j in itertools.combinations(range(len(alone.rows)), 2)
    ]
    assert all(one == other for one, other in verdicts)
    assert 0 < sum(one for one, _ in verdicts) < len(verdicts)


def test_covers_are_told_by_their_nodes() -> None:
    robot, scene = slider(), scattered(6)
    packed = packed_pieces(robot, scene)
    for k in range(len(scene.pieces()[1])):
        row = packed.rows[len(robot.pieces) + k]
        surface = scene.piece(k).surface
        nodes = int(row[STOP_NODE] - row[FIRST_NODE])
        # A tree of t leaves has 2 t - 1 nodes.
        assert nodes == (0 if surface is None else 2 * len(surface.triangles) - 1)


def test_packing_twice_gives_rows_that_can_be_changed_without_harm() -> None:
    robot, scene = slider(), scattered(7)
    first = packed_pieces(robot, scene)
    before = first.rows.copy()
    first.rows[:] = 0.0
    np.testing.assert_array_equal(packed_pieces(robot, scene).rows, before)


def test_halfspaces_are_packed_as_such() -> None:
    floor = Scene((Obstacle("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), -0.4)),))
    table, sweep = placed(floor)
    last = len(table.arrays.kinds) - 1
    assert table.solid(last).kind == PieceKind.HALFSPACE
    assert proposed(table, sweep, last, 0)[0] == pytest.approx(0.35, abs=1e-6)
