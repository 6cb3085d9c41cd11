"""Constrained inverse kinematics on seeded problems, beside IPOPT and drake.

    python -m benchmarks.constrained_ik ../data/mbm/panda [--count 500] [--solver auto]
    python -m benchmarks.constrained_ik ../data/mbm/panda --write problems.json
    PEER/bin/python benchmarks/constrained_ik_drake.py problems.json panda.urdf answers.json
    python -m benchmarks.constrained_ik ../data/mbm/panda --judge answers.json

Kinds: "upright" (a cone of 0.1 rad and a ball of 1 mm), "look_at" (a ray within 0.02 rad of a
target from a box of 5 cm), "shelf" (a pose within 1 cm and 0.1 rad, 2 cm from every shelf). All are
made of random configurations that hold them, so all are feasible. Processor time, one thread.
Every answer is judged by pinocchio's frames and FCL's distances, a peer's by ``--judge``: "clean"
are those that violate by no more than 1e-6 (distances by 1e-5, which FCL is good for) and touch
nothing.
"""

import argparse
import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pinocchio

from benchmarks.fcl_judge import FclJudge
from benchmarks.mbm_problems import cases, panda, scene_at_root
from kinematics.arrays import Array
from kinematics.forward import forward
from obstacles.checker import Checker
from obstacles.piece import Piece, PieceKind
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Scene
from planning.constrained.ik import IkOptions, constrained_ik
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
#: What counts as held [m or rad], and what FCL's distances are good for [m].
_OFF, _FCL_OFF = 1e-6, 1e-5
#: What a peer's looser tolerances may leave.
_NEARLY = 1e-4

Problem = tuple[Array, tuple[Constraint, ...], Scene | None]
Solver = Literal["auto", "descent", "ipopt"]


def constrained_states(
    kind: str, robot: RobotGeometry, scenes: list[Scene], count: int
) -> Iterator[Problem]:
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


class Judge:
    """Answers seen by pinocchio and FCL.

    Args:
        robot: Its solids.
        urdf: Its kinematics.
    """

    def __init__(self, robot: RobotGeometry, urdf: str) -> None:
        self._robot = robot
        self._model = pinocchio.buildModelFromXML(urdf)
        self._data = self._model.createData()
        self._tip = self._model.getFrameId(robot.chain.tip_link)
        self._judges: dict[str, FclJudge] = {}

    def clean(
        self, q: Array, constraints: tuple[Constraint, ...], scene: Scene | None, off: float = _OFF
    ) -> bool:
        """Whether a configuration holds what was asked for up to ``off`` and touches nothing."""
        low, high = self._model.lowerPositionLimit, self._model.upperPositionLimit
        inside = bool((q >= low - off).all() and (q <= high + off).all())
        pinocchio.framesForwardKinematics(self._model, self._data, q)
        T = self._data.oMf[self._tip].homogeneous
        held = all(_residual(T, constraint) <= off for constraint in constraints)
        if scene is None or not (inside and held):
            return inside and held
        judge = self._judges.setdefault(scene.content_hash, FclJudge(self._robot, scene))
        return not judge.collides(q) and judge.obstacle_distance(q) >= MARGIN - _FCL_OFF - off


def _residual(T: Array, constraint: Constraint) -> float:
    """By how much a pose violates a constraint, negative by what it has to spare."""
    place = T[:3, 3]
    if isinstance(constraint, ConeConstraint):
        cosine = np.asarray(constraint.direction) @ T[:3, :3] @ np.asarray(constraint.axis)
        return float(np.arccos(np.clip(cosine, -1.0, 1.0))) - constraint.cone_angle
    if isinstance(constraint, LookAtConstraint):
        sight = np.asarray(constraint.target) - place
        axis = T[:3, :3] @ np.asarray(constraint.axis)
        cosine = sight @ axis / np.linalg.norm(sight)
        return float(np.arccos(np.clip(cosine, -1.0, 1.0))) - constraint.angle
    if isinstance(constraint, RelativePoseConstraint):
        M = np.linalg.inv(constraint.T_reference_link) @ T
        turn = pinocchio.log3(M[:3, :3])
        return float(max(np.abs(M[:3, 3]).max() - 0.01, np.abs(turn).max() - 0.1))
    if isinstance(constraint, PositionConstraint):
        region = constraint.region
        if isinstance(region, SphereRegion):
            return float(np.linalg.norm(place - np.asarray(region.center))) - region.radius
        assert isinstance(region, BoxRegion)
        inside = region.T[:3, :3].T @ (place - region.T[:3, 3])
        return float((np.abs(inside) - 0.5 * np.asarray(region.size)).max())
    return -np.inf


def measure(
    kind: str, problems: list[Problem], judge: Judge, robot: RobotGeometry, solver: Solver
) -> None:
    """Solve all problems of a kind and print one row."""
    low, high = robot.chain.sampling_bounds()
    spent, worst, solved, clean, starts = [], 0.0, 0, 0, []
    for i, (_, constraints, scene) in enumerate(problems):
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
            solved += 1
            clean += judge.clean(np.array(best.joints), constraints, scene)
    median, late = np.median(spent), np.percentile(spent, 95)
    print(
        f"{kind:8} {solver:8} {solved:4d} of {len(problems)} | clean {clean:4d} "
        f"| ms median {median:7.2f} p95 {late:8.2f} max {max(spent):8.1f} "
        f"| starts {np.mean(starts):5.1f} | worst violation {worst:.1e}",
        flush=True,
    )


def judge_answers(
    kind: str, problems: list[Problem], judge: Judge, answers: list[list[float] | None]
) -> None:
    """Judge a peer's answers and print one row."""
    given = [
        (np.array(answer), constraints, scene)
        for answer, (_, constraints, scene) in zip(answers, problems, strict=True)
        if answer is not None
    ]
    clean, nearly = (sum(judge.clean(*one, off) for one in given) for off in (_OFF, _NEARLY))
    print(
        f"{kind:8} answers {len(given)} of {len(problems)} | clean {clean}, within "
        f"{_NEARLY:g}: {nearly}",
        flush=True,
    )


def exported_problems(robot: RobotGeometry, scenes: list[Scene], count: int) -> dict[str, Any]:
    """The problems as values another program reads; solids as convex sets of points."""
    told: dict[str, Any] = {kind: [] for kind in KINDS}
    for kind in KINDS:
        for _, constraints, scene in constrained_states(kind, robot, scenes, count):
            told[kind].append(_values(constraints) | {"scene": _number(scenes, scene)})
    told["robot"] = [
        {"link": f"panda_link{joint + 1}"} | solid(piece)
        for joint, piece in zip(robot.joints, robot.pieces, strict=True)
        if joint >= 0
    ]
    told["scenes"] = [
        [solid(piece) for obstacle in scene.obstacles for piece in obstacle.pieces()]
        for scene in scenes
    ]
    return told


def _number(scenes: list[Scene], scene: Scene | None) -> int | None:
    return next((i for i, other in enumerate(scenes) if other is scene), None)


def solid(piece: Piece) -> dict[str, Any]:
    """A piece as values another program reads."""
    T = np.asarray(piece.T_owner_piece).tolist()
    if piece.kind == PieceKind.CYLINDER:
        return {"T": T, "radius": piece.radius, "length": 2.0 * piece.half_height}
    half = piece.box_half_sizes()
    if half is not None:
        return {"T": T, "box": (2.0 * half).tolist()}
    return {"T": T, "points": piece.vertices.tolist()}


def _values(constraints: tuple[Constraint, ...]) -> dict[str, Any]:
    first, second = constraints
    if isinstance(first, RelativePoseConstraint):
        return {"T": np.asarray(first.T_reference_link).tolist(), "margin": MARGIN}
    assert isinstance(second, PositionConstraint)
    region = second.region
    if isinstance(first, ConeConstraint) and isinstance(region, SphereRegion):
        values = {"axis": np.asarray(first.axis).tolist(), "angle": first.cone_angle}
        return values | {"center": np.asarray(region.center).tolist(), "radius": region.radius}
    assert isinstance(first, LookAtConstraint)
    assert isinstance(region, BoxRegion)
    values = {"axis": np.asarray(first.axis).tolist(), "angle": first.angle}
    values |= {"target": np.asarray(first.target).tolist()}
    return values | {"T": region.T.tolist(), "size": np.asarray(region.size).tolist()}


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problems", type=Path)
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--solver", choices=("auto", "descent", "ipopt"), default="auto")
    parser.add_argument("--write", type=Path)
    parser.add_argument("--judge", type=Path)
    asked = parser.parse_args()
    folder = asked.problems.parent.parent / "panda"
    robot = panda(folder)
    names = robot.chain.joint_names
    texts = [case.text for case in cases(asked.problems, names, 10) if "shelf" in case.kind]
    scenes = [scene_at_root(text) for text in texts]
    if asked.write is not None:
        asked.write.write_text(json.dumps(exported_problems(robot, scenes, asked.count)))
        return
    judge = Judge(robot, (folder / "panda.urdf").read_text())
    answers = None if asked.judge is None else json.loads(asked.judge.read_text())
    for kind in KINDS:
        problems = list(constrained_states(kind, robot, scenes, asked.count))
        if answers is None:
            measure(kind, problems, judge, robot, asked.solver)
        else:
            judge_answers(kind, problems[: len(answers[kind])], judge, answers[kind])


if __name__ == "__main__":
    main()
