"""Robots whose links are not convex, against their very meshes: ``python -m benchmarks.meshes``.

Arms of the package example-robot-data are put into configurations that nearly touch something or
just collide, in shelves, on tables, among hollow things and with nothing but themselves, and among
the obstacles of MotionBenchMaker's problems where a folder of them is named. What Armwright says is
compared with FCL's answer on the triangles themselves: a configuration that is free by its
triangles and refused by Armwright is a false collision; one that collides by its triangles and is
taken is a miss, be it by the planner's verdict or by the certificate. How it would be with one hull
a link is counted too.
"""

import argparse
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.example_arms import ARMS
from benchmarks.mbm_problems import scene_at_root
from benchmarks.mesh_scenes import own_scenes, reach_of
from benchmarks.triangles import Triangles, scenery
from kinematics.forward import link_poses
from kinematics.trajectory import Trajectory
from obstacles.checker import Checker
from obstacles.robot_geometry import RobotGeometry, hulled
from obstacles.scene import Scene
from planning.proof.certificate import certify

Array = NDArray[np.float64]

#: How near a configuration must be to count [m], by its triangles; the range that
#: MotionBenchMaker's tightest starts and goals have is the middle of it.
NEAREST, FARTHEST = 0.0, 0.03
BEYOND = -0.015
BINS = (0.0, 1e-3, 2.5e-3, 5e-3, 1e-2, 3e-2)
#: Scenes of our own.
SCENES = 16
#: A verdict may differ so near to contact [m].
BAND = 1e-6


def near_contacts(
    truth: Triangles, robot: RobotGeometry, scene: Scene, wanted: int, random: np.random.Generator
) -> Iterator[tuple[Array, float]]:
    """Configurations that nearly touch something, with their clearance by triangles [m].

    From a free configuration towards one that is not, to where a bisection by a clearance drawn at
    random ends.
    """
    low, high = robot.chain.sampling_bounds()
    low, high = np.maximum(low, -np.pi), np.minimum(high, np.pi)
    bodies = scenery(scene)
    found, tries = 0, 0
    while found < wanted and tries < 60 * wanted:
        tries += 1
        a, b = random.uniform(low, high, (2, robot.chain.n))
        # A third are led up to contact, and one beyond it is taken from both sides.
        aim = max(float(random.uniform(BEYOND, FARTHEST)), NEAREST)
        most = aim + 1e-6
        if truth.clearance(a, bodies, most) <= aim or truth.clearance(b, bodies, most) > aim:
            continue
        sure, maybe = 0.0, 1.0
        for _ in range(14):
            middle = 0.5 * (sure + maybe)
            if truth.clearance(a + middle * (b - a), bodies, most) > aim:
                sure = middle
            else:
                maybe = middle
        for at in (sure, maybe, 1.0) if aim == NEAREST else (sure, maybe):
            q = a + at * (b - a)
            clearance = truth.clearance(q, bodies, 2.0 * FARTHEST)
            if clearance <= FARTHEST:
                found += 1
                yield q, clearance


def still(robot: RobotGeometry, q: Array) -> Trajectory:
    """Standing in q for a second."""
    return Trajectory(robot.chain.joint_names, np.array([0.0, 1.0]), q[None, :, None].copy())


def reach(robot: RobotGeometry) -> float:
    """How far the tool of an arm gets from its base [m], about."""
    low, high = robot.chain.sampling_bounds()
    states = np.random.default_rng(0).uniform(low, high, (200, robot.chain.n))
    tips = [link_poses(robot.chain, q, [robot.chain.tip_link])[0][:3, 3] for q in states]
    return reach_of(np.array(tips))


def main() -> None:
    """Count and tell."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=700, help="configurations of each arm")
    parser.add_argument("--problems", type=Path, help="MotionBenchMaker's folder of problems")
    parser.add_argument("--robots", nargs="+", default=["ur5"], choices=list(ARMS))
    given = parser.parse_args()
    for name in given.robots:
        began = time.process_time()
        robot = ARMS[name].geometry()
        made = time.process_time() - began
        covers = sum(piece.surface is not None for piece in robot.pieces)
        print(f"{name}: {len(robot.pieces)} pieces, {covers} of them covers, in {made:.1f} s")
        truth = Triangles(ARMS[name], robot)
        compare(
            "scenes of our own", robot, truth, list(own_scenes(SCENES, reach(robot))), given.count
        )
        if given.problems is not None:
            files = sorted(given.problems.glob("*/scene*.yaml"))[:: max(1, 350 // 70)]
            scenes = [scene_at_root(file.read_text()) for file in files]
            compare("MotionBenchMaker's obstacles", robot, truth, scenes, given.count)


def compare(
    what: str, robot: RobotGeometry, truth: Triangles, scenes: list[Scene], count: int
) -> None:
    """Compare and print one table."""
    random = np.random.default_rng(1)
    rows = []
    for scene in scenes:
        exact, rough = Checker.of(robot, scene), Checker.of(hulled(robot), scene)
        for q, clearance in near_contacts(truth, robot, scene, -(-count // len(scenes)), random):
            proof = certify(still(robot, q), robot, scene)
            collides = proof.violation is not None and proof.violation.kind == "collision"
            told, by_hulls = exact.clearance(q)[0], rough.clearance(q)[0]
            rows.append((clearance, told, by_hulls, exact.valid(q), not collides))
    table = np.array(rows)
    free = table[:, 0] > 0.0
    counts = f"{free.sum()} of them free and {(~free).sum()} colliding by their triangles"
    print(f"{what}: {len(table)} configurations, {counts}")
    for who, column in (("verdict", 3), ("certificate", 4)):
        missed = int((~free & (table[:, column] > 0.0)).sum())
        refused = table[:, column] == 0.0
        false = int((refused & (table[:, 0] > BAND)).sum())
        touching = int((refused & free).sum()) - false
        print(f"  {who}: {missed} misses, {false} false collisions", end="")
        print(f", {touching} with less than {1e6 * BAND:g} µm to spare" if touching else "")
    print("  clearance by triangles   free   false collisions   with one hull a link")
    for low, high in pairwise(BINS):
        own = (table[:, 0] > max(low, BAND)) & (table[:, 0] <= high)
        false, hull = ((table[own, k] <= 0.0).sum() for k in (1, 2))
        bin_ = f"{1e3 * low:5.1f} to {1e3 * high:4.1f} mm"
        print(f"  {bin_} {own.sum():12d} {false:12d} {hull:18d}")
    off = np.abs(table[free, 0] - table[free, 1])
    middle, most = np.quantile(off, [0.5, 0.95])
    worst = f"95 % {1e3 * most:.2g} mm, worst {1e3 * float(off.max()):.2g} mm"
    print(f"  clearance off by: median {1e3 * middle:.2g} mm, {worst}", flush=True)


if __name__ == "__main__":
    main()
