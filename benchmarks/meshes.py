"""Robots whose links are not convex, against their very meshes: ``python -m benchmarks.meshes``.

A UR5 with the collision meshes of the package example-robot-data is put into configurations that
nearly touch something or just collide, in shelves and on tables of our own and among the obstacles
of MotionBenchMaker's problems where a folder of them is named. What Armwright says is compared with
FCL's answer on the triangles themselves: a configuration that is free by its triangles and refused
by Armwright is a false collision; one that collides by its triangles and is taken is a miss. How it
would be with one hull a link is counted too.
"""

import argparse
import io
import sysconfig
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import fcl
import numpy as np
import trimesh
from numpy.typing import NDArray

from kinematics.forward import link_poses
from kinematics.pose import from_rpy, transform
from kinematics.serial import serial_chain
from kinematics.srdf import parse_srdf
from kinematics.urdf import parse_urdf
from obstacles.checker import Checker
from obstacles.moveit import scene_from_moveit
from obstacles.robot_geometry import RobotGeometry, hulled, robot_geometry
from obstacles.scene import Obstacle, Scene
from obstacles.shapes import Box, Cylinder, Sphere

Array = NDArray[np.float64]

#: How near a configuration must be to count [m], by its triangles; the range that
#: MotionBenchMaker's tightest starts and goals have is the middle of it.
NEAREST, FARTHEST = 0.0, 0.03
BEYOND = -0.015
#: Units of a metre in FCL, whose tolerances are fixed numbers.
UNITS = 1e3
BINS = (0.0, 1e-3, 2.5e-3, 5e-3, 1e-2, 3e-2)


def package() -> Path:
    """Folder of the robots of example-robot-data.

    Raises:
        SystemExit: It is not installed.
    """
    folder = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix/share/example-robot-data/robots"
    if not folder.is_dir():
        raise SystemExit("example-robot-data is not installed: pip install example-robot-data")
    return folder


def arm(name: str = "ur5") -> RobotGeometry:
    """A UR with its true meshes, as Armwright has it."""
    folder = package() / "ur_description"
    text = (folder / f"urdf/{name}_robot.urdf").read_text()
    description = parse_urdf(text)
    semantics = parse_srdf((folder / f"srdf/{name}.srdf").read_text())
    chain = serial_chain(description, tip_link="tool0", semantics=semantics)
    return robot_geometry(chain, description, _mesh, semantics)


def _mesh(uri: str) -> bytes:
    return (package() / uri.removeprefix("package://example-robot-data/robots/")).read_bytes()


@dataclass(frozen=True)
class Triangles:
    """The same arm as triangles, in FCL."""

    robot: RobotGeometry
    links: list[tuple[str, Array, Any]]
    allowed: set[frozenset[str]]

    @classmethod
    def of(cls, robot: RobotGeometry, name: str = "ur5") -> "Triangles":
        """Read the meshes anew, by trimesh, from the URDF's own text."""
        text = (package() / f"ur_description/urdf/{name}_robot.urdf").read_text()
        links = []
        for link in ElementTree.fromstring(text).findall("link"):
            for collision in link.findall("collision"):
                mesh, box = collision.find("geometry/mesh"), collision.find("geometry/box")
                if link.attrib["name"] not in robot.chain.index:
                    continue
                origin = collision.find("origin")
                T = np.eye(4)
                if origin is not None:
                    numbers = [
                        [float(x) for x in origin.attrib.get(key, "0 0 0").split()]
                        for key in ("rpy", "xyz")
                    ]
                    T = transform(from_rpy(numbers[0]), numbers[1])
                if mesh is not None:
                    solid = trimesh.load(
                        io.BytesIO(_mesh(mesh.attrib["filename"])), file_type="stl", force="mesh"
                    )
                else:
                    assert box is not None
                    solid = trimesh.creation.box([float(x) for x in box.attrib["size"].split()])
                links.append((link.attrib["name"], T, _bvh(solid)))
        return cls(robot, links, {frozenset(pair) for pair in robot.allowed})

    def clearance(self, q: Array, scenery: list[Any]) -> float:
        """Least distance to the scene and of the arm to itself [m], 0 where something touches."""
        poses = link_poses(self.robot.chain, q, [name for name, _, _ in self.links])
        placed = []
        for (name, T, bvh), pose in zip(self.links, poses, strict=True):
            M = pose @ T
            moved = fcl.Transform(M[:3, :3], UNITS * M[:3, 3])
            placed.append((name, fcl.CollisionObject(bvh, moved)))
        least = np.inf
        still = {link.name for link in self.robot.chain.links if link.joint < 0}
        for i, (name, body) in enumerate(placed):
            others = [] if name in still else list(scenery)
            others += [
                other
                for mate, other in placed[:i]
                if frozenset((name, mate)) not in self.allowed and not {name, mate} <= still
            ]
            for other in others:
                least = min(least, _apart(body, other))
                if least == 0.0:
                    return 0.0
        return least / UNITS


def _bvh(solid: trimesh.Trimesh) -> Any:
    bvh = fcl.BVHModel()
    bvh.beginModel(len(solid.vertices), len(solid.faces))
    bvh.addSubModel(UNITS * np.array(solid.vertices), np.array(solid.faces))
    bvh.endModel()
    return bvh


def _apart(a: Any, b: Any) -> float:
    if fcl.collide(a, b, fcl.CollisionRequest(), fcl.CollisionResult()):
        return 0.0
    return max(float(fcl.distance(a, b, fcl.DistanceRequest(), fcl.DistanceResult())), 0.0)


def scenery(scene: Scene) -> list[Any]:
    """A scene's boxes, cylinders and spheres as triangles and solids of FCL."""
    bodies = []
    for obstacle in scene.obstacles:
        shape, T = obstacle.shape, obstacle.T_world_obstacle
        if isinstance(shape, Box):
            solid = trimesh.creation.box(np.array(shape.size))
        elif isinstance(shape, Cylinder):
            solid = trimesh.creation.cylinder(shape.radius, shape.height, sections=128)
        elif isinstance(shape, Sphere):
            solid = trimesh.creation.icosphere(4, shape.radius)
        else:
            raise TypeError(f"no triangles for {type(shape).__name__}")
        place = fcl.Transform(T[:3, :3], UNITS * T[:3, 3])
        bodies.append(fcl.CollisionObject(_bvh(solid), place))
    return bodies


def own_scenes(count: int, seed: int = 0) -> Iterator[Scene]:
    """Shelves and tables of our own, with things on them."""
    random = np.random.default_rng(seed)
    for k in range(count):
        yield _shelf(random) if k % 2 else _table(random)


def _block(name: str, size: list[float], at: list[float], yaw: float = 0.0) -> Obstacle:
    return Obstacle(name, Box(np.array(size)), transform(from_rpy([0.0, 0.0, yaw]), at))


def _shelf(random: np.random.Generator) -> Scene:
    x, yaw = float(random.uniform(0.45, 0.6)), float(random.uniform(-0.2, 0.2))
    boards = [
        _block(f"board{i}", [0.3, 0.8, 0.02], [x, 0.0, float(z)], yaw)
        for i, z in enumerate((0.1, 0.1 + random.uniform(0.25, 0.4), 0.9))
    ]
    sides = [_block(f"side{y:+.0f}", [0.3, 0.02, 0.8], [x, 0.4 * y, 0.5], yaw) for y in (-1.0, 1.0)]
    return Scene((*boards, *sides))


def _table(random: np.random.Generator) -> Scene:
    top = _block("top", [0.6, 1.0, 0.04], [0.55, 0.0, float(random.uniform(-0.1, 0.15))])
    cans = []
    for k in range(6):
        place = [float(v) for v in random.uniform([0.3, -0.45, 0.15], [0.8, 0.45, 0.35])]
        cans.append(Obstacle(f"can{k}", Cylinder(0.04, 0.15), transform(None, place)))
    return Scene((top, *cans))


def near(
    truth: Triangles, scene: Scene, wanted: int, random: np.random.Generator
) -> Iterator[tuple[Array, float]]:
    """Configurations that nearly touch something, with their clearance by triangles [m].

    From a free configuration towards one that is not, to where a bisection by a clearance drawn at
    random ends.
    """
    low, high = truth.robot.chain.sampling_bounds()
    low, high = np.maximum(low, -np.pi), np.minimum(high, np.pi)
    bodies = scenery(scene)
    found, tries = 0, 0
    while found < wanted and tries < 60 * wanted:
        tries += 1
        a, b = random.uniform(low, high, (2, truth.robot.chain.n))
        # A third are led up to contact, and one beyond it is taken from both sides.
        aim = max(float(random.uniform(BEYOND, FARTHEST)), NEAREST)
        if truth.clearance(a, bodies) <= aim or truth.clearance(b, bodies) > aim:
            continue
        sure, maybe = 0.0, 1.0
        for _ in range(14):
            middle = 0.5 * (sure + maybe)
            if truth.clearance(a + middle * (b - a), bodies) > aim:
                sure = middle
            else:
                maybe = middle
        for at in (sure, maybe, 1.0) if aim == NEAREST else (sure, maybe):
            q = a + at * (b - a)
            clearance = truth.clearance(q, bodies)
            if clearance <= FARTHEST:
                found += 1
                yield q, clearance


def main() -> None:
    """Count and tell."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=700, help="configurations of our own scenes")
    parser.add_argument("--problems", type=Path, help="MotionBenchMaker's folder of problems")
    parser.add_argument("--robot", default="ur5", choices=("ur3", "ur5", "ur10"))
    given = parser.parse_args()
    robot = arm(given.robot)
    print("\n".join(robot.lint))
    truth = Triangles.of(robot, given.robot)
    scenes = list(own_scenes(14))
    _compare("scenes of our own", robot, truth, scenes, given.count)
    if given.problems is not None:
        files = sorted(given.problems.glob("*/scene*.yaml"))[:: max(1, 350 // 70)]
        _compare(
            "MotionBenchMaker's obstacles", robot, truth,
            [scene_from_moveit(file.read_text()) for file in files], given.count,
        )  # fmt: skip


def _compare(
    what: str, robot: RobotGeometry, truth: Triangles, scenes: list[Scene], count: int
) -> None:
    random = np.random.default_rng(1)
    rows = []
    for scene in scenes:
        exact = Checker.of(robot, scene)
        rough = Checker.of(hulled(robot), scene)
        each = -(-count // len(scenes))
        for q, clearance in near(truth, scene, each, random):
            rows.append((clearance, exact.clearance(q)[0], rough.clearance(q)[0]))
    table = np.array(rows)
    free = table[:, 0] > 0.0
    told = f"{free.sum()} of them free and {(~free).sum()} colliding by their triangles"
    print(f"{what}: {len(table)} configurations, {told}")
    print(f"  misses: {int((~free & (table[:, 1] > 0.0)).sum())}")
    print("  clearance by triangles   free   false collisions   with one hull a link")
    for low, high in pairwise(BINS):
        own = (table[:, 0] > low) & (table[:, 0] <= high)
        false, hull = ((table[own, k] <= 0.0).sum() for k in (1, 2))
        bin_ = f"{1e3 * low:5.1f} to {1e3 * high:4.1f} mm"
        print(f"  {bin_} {own.sum():12d} {false:12d} {hull:18d}")
    lost = table[free, 0] - table[free, 1]
    middle, most = np.quantile(lost, [0.5, 0.95])
    worst = float(np.abs(lost).max())
    told = f"median {1e3 * middle:.2g} mm, 95 % {1e3 * most:.2g} mm, worst {1e3 * worst:.2g} mm"
    print(f"  clearance lost: {told}")


if __name__ == "__main__":
    main()
