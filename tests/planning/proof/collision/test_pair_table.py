"""Pairs that the proof compares: every one that may not touch, whatever the planner has chosen."""

import numpy as np
import pytest

from kinematics.pose import transform
from kinematics.trajectory.trajectory import stay
from obstacles.collision.fcl_distance import FclWorld
from obstacles.collision.model import collision_model
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, HalfSpace, PointCloud, Sphere
from planning.proof.certificate import certify
from planning.proof.collision.pair_table import HOLDER, PairTable, any_pairs
from planning.proof.violation import Violation
from tests.obstacles.arms import mesh_shape
from tests.obstacles.collision.model.test_collision_model import mixed
from tests.obstacles.shapes.test_primitives import random_scene
from tests.planning.proof.collision.test_proposals import scattered
from tests.planning.proof.test_certificate_meshes import fork
from tests.planning.scenes import HOME, builtin

PANDA = builtin("panda")


def scene_of_each(allowed: frozenset[tuple[str, str]] = frozenset()) -> Scene:
    return Scene(
        (
            Obstacle("box", Box(np.array([0.1, 0.1, 0.1])), transform(None, [0.8, 0.0, 0.3]), 0.02),
            Obstacle("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), -0.3), np.eye(4)),
            Obstacle(
                "cloud",
                PointCloud(np.random.default_rng(0).normal(size=(40, 3)), 0.01),
                transform(None, [0.0, 2.0, 0.0]),
            ),
            Obstacle("mesh", mesh_shape(fork()), transform(None, [0.0, -1.0, 0.4])),
            Obstacle("ball", Sphere(0.1), transform(None, [-0.7, 0.0, 0.5])),
        ),
        allowed,
    )


def compared(table: PairTable) -> set[tuple[str, str]]:
    """Names of all pairs that hang below the roots, holders opened."""
    arrays, pairs = table.arrays, set()
    stack = [(int(i), int(j)) for i, j in arrays.roots]
    while stack:
        i, j = stack.pop()
        if arrays.kinds[i] == HOLDER:
            stack += [(int(k), j) for k in arrays.kids[arrays.below[i] : arrays.below[i + 1]]]
        elif i < arrays.moving or not arrays.skipped[arrays.parts[j], arrays.parts[i]]:
            a, b = table.names(i, j)
            pairs.add((min(a, b), max(a, b)))
    return pairs


def expected(scene: Scene) -> set[tuple[str, str]]:
    """Links that move against obstacles, and the robot's own pairs, but for what may touch."""
    moving = {
        name for name, joint in zip(PANDA.links, PANDA.joints, strict=True) if int(joint) >= 0
    }
    pairs = {(link, name) for link in moving for name in scene.ids}
    pairs |= {(PANDA.links[i], PANDA.links[j]) for i, j in PANDA.self_pairs}
    return {(min(p), max(p)) for p in pairs if not scene.allows(*p)}


@pytest.mark.parametrize(
    "allowed",
    [frozenset(), frozenset({("box", "panda_hand"), ("panda_link5", "panda_link7")})],
    ids=["none", "some"],
)
def test_every_pair_that_may_not_touch_is_compared(allowed: frozenset[tuple[str, str]]) -> None:
    scene = scene_of_each(allowed)
    assert compared(PairTable.of(PANDA, scene, 0.0)) == expected(scene)


def test_every_piece_and_triangle_hangs_below_the_roots() -> None:
    scene = scene_of_each()
    arrays = PairTable.of(PANDA, scene, 0.0).arrays
    seen, stack = set(), [int(i) for i, _ in arrays.roots]
    while stack:
        k = stack.pop()
        if k not in seen:
            seen.add(k)
            stack += arrays.kids[arrays.below[k] : arrays.below[k + 1]].tolist()
    around = {k for k in range(arrays.moving, len(arrays.kinds)) if arrays.kinds[k] != HOLDER}
    assert around <= seen
    triangles = [k for k in around if arrays.proposals.first[k] >= 0]
    pieces = scene.obstacle("mesh").pieces()
    corners = np.concatenate([p.surface.triangles for p in pieces if p.surface is not None])
    assert len(triangles) == len(corners)
    packed = {
        tuple(
            np.sort(arrays.columns[:, arrays.starts[k] : arrays.starts[k + 1]].T.ravel()).round(9)
        )
        for k in triangles
    }
    assert packed == {tuple(np.sort(triangle.ravel()).round(9)) for triangle in corners}


def test_balls_and_boxes_hold_what_is_below_them() -> None:
    arrays = PairTable.of(PANDA, scene_of_each(), 0.0).arrays
    for i in range(arrays.moving, len(arrays.kinds)):
        for k in arrays.kids[arrays.below[i] : arrays.below[i + 1]]:
            if np.isfinite(arrays.radii[i]):
                for v in arrays.columns[:, arrays.starts[k] : arrays.starts[k + 1]].T:
                    p = arrays.poses[k, :3, :3] @ v + arrays.poses[k, :3, 3]
                    distance = float(np.linalg.norm(p - arrays.centers[i]))
                    assert distance <= arrays.radii[i] + 1e-12
                    local = arrays.poses[i, :3, :3].T @ (p - arrays.poses[i, :3, 3])
                    out = np.abs(local - arrays.boxes[i, :3]) - arrays.boxes[i, 3:]
                    assert out.max() <= 1e-12
            assert arrays.margins[i] >= arrays.margins[k]


def test_pairs_that_the_planner_drops_are_compared_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A motion at rest in a box: refused, though the planner's own model skips the pair."""
    real = collision_model.skipped_pairs
    monkeypatch.setattr(
        collision_model, "skipped_pairs", lambda robot, scene: np.ones_like(real(robot, scene))
    )
    hand = 0.3
    scene = Scene((Obstacle("block", Box(np.full(3, hand)), transform(None, [0.35, 0.0, 0.5])),))
    still = stay(PANDA.chain.joint_names, HOME)
    assert FclWorld(PANDA, scene).collisions(HOME)
    violation = certify(still, PANDA, scene).violation
    assert isinstance(violation, Violation)
    assert violation.kind == "collision"
    assert "block" in violation.details["pair"]


@pytest.mark.parametrize("name", ["panda", "ur5e", "planar_rr"])
def test_pairs_of_any_robot_have_the_types_that_kernels_are_looked_up_by(name: str) -> None:
    """The sweep is called without a look at its arguments: arrays must be laid out as expected."""

    def kinds(values: object) -> object:
        if isinstance(values, tuple):
            return [kinds(value) for value in values]
        if isinstance(values, np.ndarray):
            return values.dtype, values.ndim, values.flags.c_contiguous
        return type(values)

    expected = kinds(any_pairs())
    for scene in (Scene(), mixed(0), scattered(1), random_scene(3, 7)):
        for opened in (frozenset[int](), None):
            assert kinds(PairTable.of(builtin(name), scene, 0.01, opened).arrays) == expected
