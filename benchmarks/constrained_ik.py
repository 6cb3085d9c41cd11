"""Constrained inverse kinematics on seeded problems, beside IPOPT and drake.

    python -m benchmarks.constrained_ik ../data/mbm/panda [--count 500] [--solver auto]
    python -m benchmarks.constrained_ik ../data/mbm/panda --write problems.json
    PEER/python benchmarks/constrained_ik_drake.py problems.json

Kinds: "upright" (a cone of 0.1 rad and a ball of 1 mm), "look_at" (a ray within 0.02 rad of a
target from a box of 5 cm), "shelf" (a pose within 1 cm and 0.1 rad, 2 cm from every shelf). All are
made of random configurations that hold them, so all are feasible. Processor time, one thread.
"""

import argparse
import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np

from benchmarks.mbm_problems import cases, panda
from kinematics.chain import Array
from kinematics.forward import forward
from obstacles.checker import Checker
from obstacles.moveit import scene_from_moveit
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Scene
from planning.constrained_ik import IkOptions, constrained_ik
from planning.constraints.constraint import Constraint
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.limit import ClearanceConstraint
from planning.constraints.look_at import LookAtConstraint
from planning.constraints.orientation import ConeConstraint
from planning.constraints.position import PositionConstraint
from planning.constraints.region import BoxRegion, SphereRegion
from planning.constraints.relative_pose import RelativePoseConstraint

KINDS = ("upright", "look_at", "shelf")
MARGIN = 0.02
_UP = [0.0, 0.0, 1.0]


def made(
    kind: str, robot: RobotGeometry, scenes: list[Scene], count: int
) -> Iterator[tuple[Array, tuple[Constraint, ...], Scene | None]]:
    """Configurations, constraints that each holds, and the scene."""
    chain, random = robot.chain, np.random.default_rng(0)
    low, high = chain.sampling_bounds()
    checkers = [Checker.of(robot, scene, MARGIN) for scene in scenes] if kind == "shelf" else []
    at = 0
    while at < count:
        q = random.uniform(low, high)
        T = forward(chain, q)
        if kind == "upright":
            up = T[:3, :3].T @ _UP
            place = PositionConstraint(SphereRegion(T[:3, 3], 1e-3))
            yield q, (ConeConstraint(up, _UP, 0.1), place), None
        elif kind == "look_at":
            target = T[:3, 3] + 0.5 * T[:3, 2]
            place = PositionConstraint(BoxRegion(T, np.full(3, 0.05)))
            yield q, (LookAtConstraint(_UP, target, 0.02), place), None
        else:
            checker = checkers[at % len(scenes)]
            # Inside the shelf, where room is scarce.
            near = checker.clearance(q)[0]
            if not (0.0 < near < 0.05 and T[0, 3] > 0.3 and checker.valid(q)):
                continue
            aim = RelativePoseConstraint(T, position_tolerances=0.01, orientation_tolerances=0.1)
            yield q, (aim, ClearanceConstraint(MARGIN)), scenes[at % len(scenes)]
        at += 1


def measure(
    kind: str,
    robot: RobotGeometry,
    scenes: list[Scene],
    count: int,
    solver: Literal["auto", "descent", "ipopt"],
) -> None:
    """Solve all problems of a kind and print one row."""
    low, high = robot.chain.sampling_bounds()
    spent, worst, solved, starts = [], 0.0, 0, []
    for i, (_, constraints, scene) in enumerate(made(kind, robot, scenes, count)):
        wanted = ConstraintSet(robot.chain, constraints)
        options = IkOptions(posture=0.5 * (low + high), solver=solver)
        if i == 0:
            constrained_ik(robot, wanted, scene, options)
        began = time.process_time()
        found = constrained_ik(robot, wanted, scene, options)
        spent.append(1e3 * (time.process_time() - began))
        starts.append(found.starts)
        if found.solutions:
            best = found.solutions[0]
            worst = max(worst, float(best.residuals.max()))
            clear = scene is None or Checker.of(robot, scene, MARGIN).valid(np.array(best.joints))
            solved += clear
    median, late = np.median(spent), np.percentile(spent, 95)
    print(
        f"{kind:8} {solver:8} {solved:4d} of {count} | ms median {median:7.2f} p95 {late:8.2f} "
        f"max {max(spent):8.1f} | starts {np.mean(starts):5.1f} | worst violation {worst:.1e}",
        flush=True,
    )


def written(robot: RobotGeometry, count: int) -> dict[str, Any]:
    """The problems without obstacles as values another program reads."""
    told: dict[str, Any] = {}
    for kind in KINDS[:2]:
        told[kind] = []
        for _, (first, second), _ in made(kind, robot, [], count):
            values = {k: np.asarray(getattr(first, k)).tolist() for k in ("axis",)}
            assert isinstance(second, PositionConstraint)
            region = second.region
            if isinstance(first, ConeConstraint) and isinstance(region, SphereRegion):
                values |= {"angle": first.cone_angle, "center": np.asarray(region.center).tolist()}
                values["radius"] = region.radius
            elif isinstance(first, LookAtConstraint) and isinstance(region, BoxRegion):
                values |= {"angle": first.angle, "target": np.asarray(first.target).tolist()}
                values |= {"T": region.T.tolist(), "size": region.size.tolist()}
            told[kind].append(values)
    return told


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problems", type=Path)
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--solver", choices=("auto", "descent", "ipopt"), default="auto")
    parser.add_argument("--write", type=Path)
    asked = parser.parse_args()
    robot = panda(asked.problems.parent.parent / "panda")
    if asked.write is not None:
        asked.write.write_text(json.dumps(written(robot, asked.count)))
        return
    names = robot.chain.joint_names
    texts = [case.text for case in cases(asked.problems, names, 10) if "shelf" in case.kind]
    scenes = [scene_from_moveit(text) for text in texts]
    for kind in KINDS:
        measure(kind, robot, scenes, asked.count, asked.solver)


if __name__ == "__main__":
    main()
