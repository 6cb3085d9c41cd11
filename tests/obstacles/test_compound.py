"""Objects of several solids: one name, and no other verdict than their solids have apart."""

import pickle

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from kinematics.arrays import Array
from kinematics.errors import InvalidScene
from kinematics.pose import transform
from obstacles.projection.projection import Projector
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import (
    Box,
    Compound,
    Cylinder,
    HalfSpace,
    Mesh,
    PointCloud,
    Shape,
    Sphere,
)
from planning.configuration_check import configuration_checker
from tests.planning.scenes import builtin

ROBOT = builtin("panda")
RING = trimesh.creation.annulus(0.05, 0.12, 0.2)


def drawn(random: np.random.Generator) -> tuple[Shape, trimesh.Trimesh]:
    """A solid, and the same of trimesh."""
    kind = random.integers(4)
    x, y, z = random.uniform(0.05, 0.3, 3)
    if kind == 0:
        return Box([x, y, z]), trimesh.creation.box([x, y, z])
    if kind == 1:
        return Sphere(x), trimesh.creation.icosphere(3, x)
    if kind == 2:
        return Cylinder(x, y), trimesh.creation.cylinder(x, y, sections=100)
    return Mesh(RING.vertices, RING.faces), RING.copy()


def drawn_object(seed: int) -> tuple[Obstacle, list[trimesh.Trimesh]]:
    """An object called mug, and its solids of trimesh in the root frame."""
    random = np.random.default_rng(seed)
    solids = [drawn(random) for _ in range(random.integers(2, 5))]
    turns = Rotation.random(len(solids) + 1, random_state=seed).as_matrix()
    poses = [transform(R, random.uniform(-0.2, 0.2, 3)) for R in turns[1:]]
    T = transform(turns[0], random.uniform([-0.6, -0.6, 0.1], [0.6, 0.6, 0.9]))
    for (_, mesh), pose in zip(solids, poses, strict=True):
        mesh.apply_transform(T @ pose)
    shape = Compound(tuple(solid for solid, _ in solids), tuple(poses))
    return Obstacle("mug", shape, T, 0.01), [mesh for _, mesh in solids]


@pytest.mark.parametrize("seed", range(12))
def test_its_distance_is_that_of_the_nearest_solid(seed: int) -> None:
    mug, meshes = drawn_object(seed)
    points = np.random.default_rng(seed).uniform(-1.0, 1.0, (20, 3))
    distances = Projector([mug])(points)[1][:, 0]
    nearest = np.min([distance(mesh, points) for mesh in meshes], axis=0)
    inside = np.max([winding(mesh, points) for mesh in meshes], axis=0) > 0.5
    # Trimesh's balls and cylinders have corners on the surface, so they are a little too small.
    clear = nearest > 2e-3
    np.testing.assert_allclose(distances[clear & ~inside], nearest[clear & ~inside], atol=2e-3)
    assert ((distances < 0.0) == inside)[clear].all()


def distance(mesh: trimesh.Trimesh, points: Array) -> Array:
    """Distances of points (m, 3) to the surface, (m,)."""
    triangles = np.tile(mesh.triangles, (len(points), 1, 1))
    repeated = np.repeat(points, len(mesh.triangles), axis=0)
    ways: Array = trimesh.triangles.closest_point(triangles, repeated) - repeated
    return np.asarray(np.linalg.norm(ways, axis=1).reshape(len(points), -1).min(axis=1))


def winding(mesh: trimesh.Trimesh, points: Array) -> Array:
    """How often the surface goes round points (m, 3): the sum of solid angles over 4 pi, (m,)."""
    a, b, c = (corner - points[:, None] for corner in np.moveaxis(mesh.triangles, 1, 0))
    la, lb, lc = (np.linalg.norm(side, axis=-1) for side in (a, b, c))
    top = np.einsum("mfi,mfi->mf", a, np.cross(b, c))
    dots = [np.einsum("mfi,mfi->mf", x, y) for x, y in ((a, b), (b, c), (c, a))]
    low = la * lb * lc + dots[0] * lc + dots[1] * la + dots[2] * lb
    return np.asarray(np.arctan2(top, low).sum(axis=1) / (2.0 * np.pi))


@pytest.mark.parametrize("seed", range(6))
def test_a_configuration_is_free_of_it_where_it_is_free_of_its_solids(seed: int) -> None:
    mug, _ = drawn_object(seed)
    whole, apart = Scene([mug]), Scene(mug.solids())
    assert apart.ids == tuple(f"mug/{k}" for k in range(len(apart.ids)))
    limits = ROBOT.chain.limits
    checks = [configuration_checker(ROBOT, scene, 0.0) for scene in (whole, apart)]
    for q in np.random.default_rng(seed).uniform(limits.lower, limits.upper, (4, 7)):
        one, many = (check.check(q) for check in checks)
        assert one.valid == many.valid
        pairs = {tuple(name.split("/")[0] for name in c.pair) for c in many.collisions}
        assert {tuple(c.pair) for c in one.collisions} == pairs
        if one.clearance > 0.0:
            assert one.clearance == pytest.approx(many.clearance, abs=1e-9)


def test_it_is_told_from_others_by_all_that_it_is_made_of() -> None:
    solids, poses = (Box([0.1, 0.1, 0.1]), Sphere(0.1)), (np.eye(4), transform(None, [0, 0, 0.2]))
    scenes = [
        Scene([Obstacle("mug", shape)])
        for shape in (
            Compound(solids, poses),
            Compound(solids, poses[::-1]),
            Compound(solids[::-1], poses),
            Compound((Box([0.1, 0.1, 0.2]), solids[1]), poses),
        )
    ]
    assert len({scene.content_hash for scene in scenes}) == len(scenes)
    for scene in scenes:
        assert pickle.loads(pickle.dumps(scene)) == scene


def test_it_has_solids_with_a_pose_each_and_no_clouds() -> None:
    cloud, here = PointCloud([[0.0, 0.0, 0.0]], 0.1), np.eye(4)
    cases: list[tuple[tuple[Shape, ...], tuple[Array, ...]]] = [
        ((), ()),
        ((Sphere(0.1),), ()),
        ((cloud,), (here,)),
        ((Compound((Sphere(0.1),), (here,)),), (here,)),
    ]
    for solids, poses in cases:
        with pytest.raises(InvalidScene, match="compound"):
            Compound(solids, poses)
    ground = Compound((HalfSpace([0, 0, 1], 0.0), Box([1, 1, 1])), (here, here))
    _, distances = Projector([Obstacle("ground", ground)])(np.array([[5.0, 0.0, 2.0]]))
    assert distances[0, 0] == pytest.approx(2.0)
