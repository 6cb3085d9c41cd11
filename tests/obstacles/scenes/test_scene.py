"""Scenes: immutable, named, hashed by content."""

import math
import pickle
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics.errors import InvalidObjectName, InvalidScene
from kinematics.pose import from_matrix, transform
from obstacles.scenes.scene import AllowedContact, Obstacle, Scene
from obstacles.shapes.shape import Box, PointCloud, Sphere
from tests.obstacles.solids import random_transform

UNIT = Box(np.array([1.0, 1.0, 1.0]))


def test_an_empty_scene_has_no_pieces() -> None:
    arrays, owners, margins = Scene().pieces()
    assert len(arrays) == len(owners) == len(margins) == 0


def test_pieces_are_in_the_world_and_know_their_obstacle() -> None:
    T = random_transform(np.random.default_rng(0))
    cloud = PointCloud(np.array([[1.0, 0, 0], [0, 1, 0]]), 0.1)
    scene = Scene((Obstacle("a", UNIT, margin=0.02), Obstacle("b", cloud, T)))
    arrays, owners, margins = scene.pieces()
    assert owners.tolist() == [0, 1, 1]
    assert margins.tolist() == [0.02, 0.0, 0.0]
    np.testing.assert_allclose(arrays.centers[1:], cloud.points @ T[:3, :3].T + T[:3, 3])


def test_an_id_may_occur_once() -> None:
    with pytest.raises(InvalidScene, match="'a'"):
        Scene((Obstacle("a", UNIT), Obstacle("b", UNIT), Obstacle("a", Sphere(1.0))))


@pytest.mark.parametrize("name", ["", "x" * 300, 3, None])
def test_refuses_a_name(name: Any) -> None:
    with pytest.raises(InvalidScene, match="obstacle id"):
        Obstacle(name, UNIT)


SKEWED = np.diag([1.0, 1.0, 1.1, 1.0])
MIRRORED = np.diag([1.0, 1.0, -1.0, 1.0])
FAR = transform(None, [1e9, 0.0, 0.0])
LOST = transform(None, [np.nan, 0.0, 0.0])


@pytest.mark.parametrize("T", [np.eye(3), SKEWED, MIRRORED, FAR, LOST, 2.0 * np.eye(4), "pose"])
def test_refuses_a_pose(T: Any) -> None:
    with pytest.raises(InvalidScene, match="'a'"):
        Obstacle("a", UNIT, T)


@pytest.mark.parametrize("margin", [-0.1, np.nan, np.inf])
def test_refuses_a_margin(margin: float) -> None:
    with pytest.raises(InvalidScene, match="margin"):
        Obstacle("a", UNIT, margin=margin)


def test_an_unknown_obstacle_is_told_with_those_there_are() -> None:
    scene = Scene((Obstacle("table", UNIT),))
    assert scene.obstacle("table").id == "table"
    with pytest.raises(InvalidObjectName) as error:
        scene.obstacle("tabel")
    assert "table" in str(error.value.hint)


def test_allowed_pairs_have_no_order() -> None:
    scene = Scene((), frozenset({("b", "a")}))
    assert scene.allows("a", "b")
    assert scene.allows("b", "a")
    assert not scene.allows("a", "c")
    assert scene == Scene((), frozenset({("a", "b")}))
    with pytest.raises(InvalidScene):
        Scene((), frozenset({("a",)}))


def test_the_hash_follows_the_content() -> None:
    base = Scene((Obstacle("a", UNIT), Obstacle("b", Sphere(1.0))))
    same = Scene((Obstacle("a", Box(np.ones(3)), np.eye(4)), Obstacle("b", Sphere(1.0))))
    assert base == same
    assert hash(base) == hash(same)
    assert pickle.loads(pickle.dumps(base)) == base
    others = [
        Scene((Obstacle("a", UNIT), Obstacle("c", Sphere(1.0)))),
        Scene((Obstacle("a", UNIT), Obstacle("b", Sphere(1.5)))),
        Scene((Obstacle("a", UNIT), Obstacle("b", Sphere(1.0), np.eye(4), 0.1))),
        Scene((Obstacle("a", UNIT, transform(None, [0, 0, 1e-9])), Obstacle("b", Sphere(1.0)))),
        Scene(base.obstacles, frozenset({("a", "b")})),
    ]
    assert len({scene.content_hash for scene in [base, *others]}) == len(others) + 1


@pytest.mark.parametrize("place", [(0, 0), (1, 2), (0, 3), (2, 3)])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e308, 2e4])
def test_poses_that_are_no_rigid_motions_are_refused(place: tuple[int, int], value: float) -> None:
    T = np.eye(4)
    T[place] = value
    with pytest.raises(InvalidScene):
        Obstacle("a", Sphere(0.1), T)


def test_mirrors_are_refused_and_rotations_keep_their_bits() -> None:
    with pytest.raises(InvalidScene):
        Obstacle("a", Sphere(0.1), np.diag([1.0, 1.0, -1.0, 1.0]))
    for R in Rotation.random(200, random_state=2).as_matrix():
        T = transform(from_matrix(R), [0.1, 0.2, 0.3])
        placed = Obstacle("a", Sphere(0.1), T).T_world_obstacle
        assert placed.tobytes() == T.tobytes()
        assert not placed.flags.writeable


@pytest.mark.parametrize("depth", [-1e-9, -1.0, float("nan"), float("-inf")])
def test_a_depth_of_contact_is_a_number_from_zero_on(depth: float) -> None:
    with pytest.raises(InvalidScene, match="touch_depth"):
        Scene(contacts={("a", "b"): AllowedContact("request", depth)})
