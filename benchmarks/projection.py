"""Projections by FCL beside the closed forms: how far apart they are, and what a point costs."""

import argparse
import time
from collections.abc import Callable

import numpy as np

from kinematics.arrays import Array
from kinematics.pose import from_axis_angle, transform
from obstacles.fcl_projection import FclProjector
from obstacles.projection import Projector
from obstacles.scene import Obstacle
from obstacles.shapes import (
    Box,
    Capsule,
    Cone,
    Convex,
    Cylinder,
    HalfSpace,
    PointCloud,
    Shape,
    Sphere,
)

#: Random solids of 5 cm to a metre.
SHAPES: dict[str, Callable[[np.random.Generator], Shape]] = {
    "box": lambda random: Box(random.uniform(0.05, 1.0, 3)),
    "sphere": lambda random: Sphere(random.uniform(0.05, 0.5)),
    "cylinder": lambda random: Cylinder(*random.uniform(0.05, 0.5, 2)),
    "capsule": lambda random: Capsule(*random.uniform(0.05, 0.5, 2)),
    "cone": lambda random: Cone(*random.uniform(0.05, 0.5, 2)),
    "halfspace": lambda random: HalfSpace(random.normal(size=3), random.normal()),
    "convex": lambda random: Convex(0.3 * random.normal(size=(random.integers(4, 60), 3))),
    "point_cloud": lambda random: PointCloud(random.uniform(-0.5, 0.5, (100, 3)), 0.02),
}
SOLIDS = 20


def main() -> None:
    """Print a row for each kind of shape."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=500, help="about each of the solids")
    count = parser.parse_args().points
    print("              outside | distance differs by [m] | projection by [m]   | us a point")
    print("shape          points |     median      largest |    median   largest |  exact    fcl")
    for name, shape in SHAPES.items():
        print(f"{name:12} {row(shape, count)}", flush=True)


def row(shape: Callable[[np.random.Generator], Shape], count: int) -> str:
    """Compare on random solids of one kind."""
    random = np.random.default_rng(0)
    differences, spent = [], np.zeros(2)
    for _ in range(SOLIDS):
        rotation = from_axis_angle(random.normal(size=3), random.uniform(0.0, np.pi))
        T = transform(rotation, random.uniform(-0.5, 0.5, 3))
        obstacle = Obstacle("it", shape(random), T)
        points = random.uniform(-1.5, 1.5, (count, 3))
        answers = []
        projectors: list[Projector | FclProjector]
        projectors = [Projector([obstacle]), FclProjector([obstacle])]
        for engine, projector in enumerate(projectors):
            projector(points[:1])
            began = time.perf_counter()
            answers.append(projector(points))
            spent[engine] += time.perf_counter() - began
        differences.append(differences_outside(*answers))
    distance, position = np.hstack(differences)
    us = 1e6 * spent / (SOLIDS * count)
    return (
        f"{len(distance):10d} | {np.median(distance):10.1e} {distance.max():12.1e} | "
        f"{np.median(position):9.1e} {position.max():9.1e} | {us[0]:6.2f} {us[1]:6.1f}"
    )


def differences_outside(exact: tuple[Array, Array], other: tuple[Array, Array]) -> Array:
    """Differences of distances and of projections where a point is outside, shape (2, k) [m]."""
    is_out = exact[1] > 0.0
    positions = np.linalg.norm(exact[0] - other[0], axis=2)
    return np.array([np.abs(exact[1] - other[1])[is_out], positions[is_out]])


if __name__ == "__main__":
    main()
