"""Signed distances and their gradients against Qhull, coal and differences; what margins lack."""

import itertools
from itertools import pairwise

import numpy as np
import pytest

from compiled.kernel import kernel
from kinematics.arrays import Array
from kinematics.pose import transform
from kinematics.robots import builtin_names
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.collision.model.collision_model import ModelArrays
from obstacles.collision.model.kernel_work import workspace
from obstacles.collision.proximity import line_deficit
from obstacles.convex.piece import Piece, PieceKind
from obstacles.distance.epa import contact
from obstacles.distance.piece_set import CENTER, PieceSet
from obstacles.distance.signed_distance import signed_distance
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import HalfSpace
from tests.obstacles.arms import builtin
from tests.obstacles.collision.test_edge_check import few_solids
from tests.obstacles.solids import KINDS, random_solid, random_transform
from tests.planning.scenes import box


def found(a: Piece, b: Piece) -> tuple[float, Array, Array]:
    rows, corners, tables, _ = PieceSet.of([a, b])
    axis = rows[0, CENTER : CENTER + 3] - rows[1, CENTER : CENTER + 3]
    distance, normal, point = contact(rows, 0, rows, 1, corners, tables, axis)
    return distance, np.array(normal), np.array(point)


@pytest.mark.parametrize("kinds", list(itertools.combinations_with_replacement(KINDS, 2)))
def test_signed_distance_is_that_of_an_independent_expansion(kinds: tuple[str, str]) -> None:
    random = np.random.default_rng(31)
    apart = overlapping = 0
    for k in range(24):
        spread = 0.4 if k % 3 else 0.1
        Ts = random_transform(random, spread), random_transform(random, spread)
        (a, _), (b, _) = (random_solid(random, kind, T) for kind, T in zip(kinds, Ts, strict=True))
        lower, upper = signed_distance(a, Ts[0], b, Ts[1])
        distance, normal, _ = found(a, b)
        assert distance <= upper + 1e-9
        assert distance >= lower - 5e-6
        assert np.linalg.norm(normal) == pytest.approx(1.0)
        apart += distance > 0.0
        overlapping += distance <= 0.0
    assert apart > 2
    assert overlapping > 2


def test_the_point_lies_on_the_second_piece_and_as_far_from_the_first() -> None:
    random = np.random.default_rng(32)
    for kinds in itertools.product(KINDS, repeat=2):
        for _ in range(6):
            Ts = random_transform(random, 0.5), random_transform(random, 0.5)
            (a, _), (b, _) = (
                random_solid(random, kind, T) for kind, T in zip(kinds, Ts, strict=True)
            )
            distance, normal, point = found(a, b)
            assert abs(off(point, b)) < 1e-5
            if distance > 1e-6:
                assert abs(off(point + distance * normal, a)) < 1e-5


def off(point: Array, piece: Piece) -> float:
    """Signed distance of a point from a piece, by an independent expansion."""
    tiny = Piece(PieceKind.POLYTOPE, transform(None, point), np.zeros((1, 3)))
    return signed_distance(tiny, tiny.T_owner_piece, piece, piece.T_owner_piece)[0]


@pytest.mark.parametrize("name", builtin_names())
def test_gradients_are_those_of_differences(name: str) -> None:
    robot = builtin(name)
    random = np.random.default_rng(33)
    lower, upper = robot.chain.sampling_bounds()
    step, compared, jumps, negative = 1e-6, 0, 0, 0
    for _ in range(12):
        checker = Checker.of(robot, few_solids(random), 0.01)
        q = random.uniform(lower, upper)
        near = checker.gradient(q, 0.2)
        clearance, least = checker.clearance(q)[0], near.distances.min(initial=np.inf)
        if 0.0 < clearance < 0.2:
            assert least == pytest.approx(clearance, abs=1e-9)
        else:
            assert least <= 0.0 if clearance <= 0.0 else least > 0.2
        before = dict(zip(near.pairs.tolist(), near.distances, strict=True))
        for j in range(robot.chain.n):
            e = step * np.eye(robot.chain.n)[j]
            ahead, behind = (
                dict(zip(near.pairs.tolist(), near.distances, strict=True))
                for near in (checker.gradient(q + e, 0.21), checker.gradient(q - e, 0.21))
            )
            for row, pair in enumerate(near.pairs.tolist()):
                slope = (ahead[pair] - behind[pair]) / (2.0 * step)
                compared += 1
                negative += before[pair] < 0.0
                jumps += abs(slope - near.gradients[row, j]) > 1e-3
    # Where the nearest feature changes inside the step, or is not unique, there is no gradient.
    assert jumps <= 0.02 * compared
    assert compared > 20 or name in ("planar_rr", "cart_pendulum", "scara")
    assert negative > 0 or name in ("planar_rr", "cart_pendulum", "scara", "elbow_wrist")


def test_only_what_is_near_is_answered() -> None:
    robot = builtin("ur5e")
    floor = Scene((Obstacle("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), -0.1), margin=0.02),))
    checker = Checker(Checker.of(robot, floor).model, slack=0.01)
    q = np.zeros(6)
    everything = checker.gradient(q, 10.0)
    some = checker.gradient(q, float(np.median(everything.distances)))
    assert len(some.pairs) < len(everything.pairs)
    assert set(some.pairs) <= set(everything.pairs)
    names = {checker.model.pair_name(int(pair)) for pair in everything.pairs}
    assert any("floor" in pair for pair in names)
    assert everything.gradients.shape == (len(everything.pairs), 6)


PREFERRED, SPACING = 0.3, 0.2
SCENE = Scene(
    (box("bar", (0.1, 1.0, 0.1), (1.3, 0.0, 0.4)), box("post", (0.1, 0.1, 0.6), (-1.2, 0.0, 0.3)))
)


@kernel
def shortfall_on(model: ModelArrays, a: Array, b: Array, spacing: float, most: float) -> float:
    return line_deficit(model, workspace(model), a, b, spacing, most)


def lines(count: int) -> Array:
    return np.random.default_rng(3).uniform(-2.5, 2.5, (count + 1, 2))


def test_it_is_the_mean_of_what_the_distances_lack() -> None:
    robot = builtin("planar_rr")
    model = Checker.of(robot, SCENE, PREFERRED).model.with_margins(PREFERRED, 0.0).arrays
    world, told, expected = FclWorld(robot, SCENE), [], []
    for a, b in pairwise(lines(40)):
        parts = max(1, int(np.ceil(np.linalg.norm(b - a) / SPACING)))
        states = a + ((np.arange(parts) + 0.5) / parts)[:, None] * (b - a)
        nearest = np.array([max(world.clearance(q).distance, 0.0) for q in states])
        if not (nearest > 0.0).all():
            continue  # how deep things overlap is not told exactly
        expected.append(np.maximum(PREFERRED - nearest, 0.0).mean())
        told.append(shortfall_on(model, a, b, SPACING, np.inf))
    assert len(told) > 10
    assert max(told) > 0.05
    np.testing.assert_allclose(told, expected, atol=1e-6)


@pytest.mark.parametrize("share", [0.5, 0.99])
def test_more_than_asked_for_is_infinite(share: float) -> None:
    model = Checker.of(builtin("planar_rr"), SCENE, PREFERRED).model.arrays
    for a, b in pairwise(lines(20)):
        lacks = shortfall_on(model, a, b, SPACING, np.inf)
        if lacks > 0.0:
            assert shortfall_on(model, a, b, SPACING, share * lacks) == np.inf
            assert shortfall_on(model, a, b, SPACING, lacks / share) == lacks


def test_a_spacious_motion_lacks_nothing() -> None:
    model = Checker.of(builtin("planar_rr"), Scene(), PREFERRED).model.arrays
    a, b = lines(1)
    assert shortfall_on(model, a, b, SPACING, 0.0) == 0.0
