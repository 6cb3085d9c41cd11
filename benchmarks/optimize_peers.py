"""Optimised motions beside OMPL with TOPP-RA, and beside drake's trajectory optimisation.

    python -m benchmarks.optimize_peers ../data/mbm/panda [--every 25] [--write FOLDER]
    PEER/bin/python benchmarks/optimize_peers_drake.py FOLDER panda.urdf
    python -m benchmarks.optimize_peers ../data/mbm/panda --every 25 --judge FOLDER

Rows: Armwright's ladder; the planner "optimize"; RRT-Connect of OMPL from Python with its own
simplification, a checker on pinocchio and python-fcl, its waypoints joined by a cubic spline (as
the toppra package's examples do) or by straight lines, and timed by toppra; drake's
KinematicTrajectoryOptimization, which starts from the ladder's motion as ours does. All are sampled
every milliradian: collisions by FCL, limits from the samples. Times are the processor's; those of
OMPL hold planning and timing, those of drake and "optimize" what is spent on optimising (ours with
the proof, drake's with its program).
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import toppra
from toppra import algorithm, constraint

from benchmarks.constrained_ik import solid
from benchmarks.mbm_problems import ACCELERATION, Case, cases, panda, scene_at_root
from benchmarks.peers import peer
from benchmarks.recheck import STEP, Recheck, Scenery
from kinematics.arrays import Array
from kinematics.trajectory import Trajectory
from obstacles.robot_geometry import RobotGeometry
from planning.options import Options
from planning.pipeline import plan
from planning.result import Plan

#: Motions are looked at as often as a joint moves so far [rad], and so often at least.
_LEAST = 500
#: What rounding may leave of a ratio to a limit.
_OFF = 1e-6

Samples = tuple[Array, Array, Array]


@dataclass(frozen=True)
class Row:
    """One motion of one problem.

    Args:
        duration: [s].
        milliseconds: Of the processor.
        ratio: To the limits, the largest.
        colliding: Whether a sample collides.
    """

    duration: float
    milliseconds: float
    ratio: float
    colliding: bool


def samples(at: Callable[[Array, int], Array], duration: float) -> Samples:
    """Positions, velocities and accelerations often enough along a motion."""
    coarse = np.linspace(0.0, duration, _LEAST)
    way = np.abs(np.diff(at(coarse, 0), axis=0)).max(axis=1).sum()
    times = np.linspace(0.0, duration, max(_LEAST, int(way / (0.5 * STEP))))
    return at(times, 0), at(times, 1), at(times, 2)


def check_motion(recheck: Recheck, truth: Scenery, motion: Samples) -> tuple[float, bool]:
    """The largest ratio to the limits, and whether anything collides."""
    q, v, a = motion
    model = recheck.model
    ratio = max(
        float((np.abs(v) / model.velocityLimit).max()),
        float((np.abs(a) / np.array(ACCELERATION)).max()),
    )
    outside = np.maximum(q - model.upperPositionLimit, model.lowerPositionLimit - q).max()
    last, colliding = np.full(q.shape[1], np.inf), False
    for row in q:
        if np.abs(row - last).max() >= STEP:
            last, colliding = row, colliding or recheck.collision(row, truth) is not None
    return max(ratio, 1.0 + float(outside) if outside > _OFF else 0.0), colliding


def ours(case: Case, robot: RobotGeometry, planner: str, alone: bool) -> tuple[Plan, float] | None:
    """A plan, and the time of all of it or of optimising and proving alone [ms]."""
    began = time.process_time()
    answer = plan(case.problem(robot, 0.0), Options(planner, timeout=60.0))
    spent = 1e3 * (time.process_time() - began)
    if not isinstance(answer, Plan):
        return None
    if alone:
        last = ("optimize", "certificate")
        spent = sum(s.processor_milliseconds for s in answer.stages if s.name in last)
    return answer, spent


def time_with_toppra(path: Array, speed: Array, lines: bool) -> tuple[Samples, float] | None:
    """A path timed by the toppra package, and its duration."""
    spaced = path[np.append(True, np.linalg.norm(np.diff(path, axis=0), axis=1) > 1e-9)]
    if lines:
        # A corner can't be driven through: points close together make it a narrow bend.
        parts = [np.linspace(a, b, 20)[:-1] for a, b in pairwise(spaced)]
        spaced = np.vstack([*parts, spaced[-1:]])
    knots = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(spaced, axis=0), axis=1)))
    way: Any = toppra.SplineInterpolator(knots, spaced)
    limit = np.array(ACCELERATION)
    limits = [
        constraint.JointVelocityConstraint(np.column_stack([-speed, speed])),
        constraint.JointAccelerationConstraint(np.column_stack([-limit, limit])),
    ]
    motion: Any = algorithm.TOPPRA(limits, way, solver_wrapper="seidel").compute_trajectory()
    if motion is None:
        return None
    duration = float(motion.duration)
    return samples(lambda t, order: np.asarray(motion(t, order)), duration), duration


def write_problem(
    folder: Path, number: int, case: Case, robot: RobotGeometry, known: Trajectory
) -> None:
    """What drake needs of a problem."""
    scene = scene_at_root(case.text)
    links = [int(joint) + 1 for joint in robot.joints]
    bodies = zip(links, robot.pieces, strict=True)
    times = np.linspace(0.0, known.duration, 200)
    np.savez(
        folder / f"problem{number}.npz",
        robot=np.array([{"link": k} | solid(piece) for k, piece in bodies if k > 0], dtype=object),
        scene=np.array([solid(p) for o in scene.obstacles for p in o.pieces()], dtype=object),
        known=known.sample(times), duration=known.duration,
        acceleration=np.array(ACCELERATION),
    )  # fmt: skip


def report(
    name: str, rows: list[Row], tried: int, base: dict[int, float], numbers: list[int]
) -> None:
    """Print one row."""
    if not rows:
        print(f"{name:34}{0:4} of {tried}", flush=True)
        return
    ratios = [row.duration / base[i] for row, i in zip(rows, numbers, strict=True)]
    spent = [row.milliseconds for row in rows]
    obeyed = sum(row.ratio <= 1.0 + _OFF for row in rows)
    clean = sum(not row.colliding for row in rows)
    both = sum(not row.colliding and row.ratio <= 1.0 + _OFF for row in rows)
    print(
        f"{name:34}{len(rows):4} of {tried} | duration/ladder median {np.median(ratios):6.3f} p90 "
        f"{np.percentile(ratios, 90):6.3f} | ms median {np.median(spent):8.1f} "
        f"max {max(spent):8.1f} | limits obeyed {obeyed}, free {clean}, both {both}, worst ratio "
        f"{max(row.ratio for row in rows):.3f}",
        flush=True,
    )


class Comparison:
    """All problems, and what came of them by the name of the way."""

    def __init__(self, folder: Path, asked: argparse.Namespace) -> None:
        robot_folder = folder.parent.parent / "panda"
        self._robot, self._recheck = panda(robot_folder), Recheck(robot_folder)
        self._asked, self._folder = asked, folder
        self._rows: dict[str, list[Row]] = {}
        self._numbers: dict[str, list[int]] = {}
        self._base: dict[int, float] = {}

    def run(self) -> None:
        """Solve, look again, print."""
        names = self._robot.chain.joint_names
        chosen = list(cases(self._folder, names, self._asked.every))
        ours(chosen[0], self._robot, "optimize", alone=False)
        for number, case in enumerate(chosen):
            self._compare(number, case)
        for name, rows in self._rows.items():
            report(name, rows, len(self._base), self._base, self._numbers[name])

    def _compare(self, number: int, case: Case) -> None:
        truth = self._recheck.scene(case.text)
        known = ours(case, self._robot, "auto", alone=False)
        better = ours(case, self._robot, "optimize", alone=True)
        if known is None or better is None:
            return
        self._base[number] = known[0].trajectory.duration
        if self._asked.write is not None:
            write_problem(self._asked.write, number, case, self._robot, known[0].trajectory)
        for name, (answer, spent) in (
            ("Armwright, ladder", known),
            ("Armwright, optimised", better),
        ):
            motion = answer.trajectory
            self._take(name, number, truth, samples(motion.sample, motion.duration),
                       motion.duration, spent)  # fmt: skip
        if self._asked.judge is not None:
            found = np.load(self._asked.judge / f"answer{number}.npz")
            if found["q"].size:
                motion_seen = found["q"], found["v"], found["a"]
                self._take("drake", number, truth, motion_seen, float(found["duration"]),
                           float(found["milliseconds"]))  # fmt: skip
        else:
            self._ompl(number, case, truth)

    def _ompl(self, number: int, case: Case, truth: Scenery) -> None:
        spent, path = peer(case, self._robot.chain, self._recheck, truth, self._asked.timeout)
        if path is None:
            return
        for name, lines in (("OMPL, splines, toppra", False), ("OMPL, lines, toppra", True)):
            began = time.process_time()
            found = time_with_toppra(path, self._recheck.model.velocityLimit, lines)
            more = 1e3 * (time.process_time() - began)
            if found is not None:
                self._take(name, number, truth, *found, spent + more)

    def _take(
        self, name: str, number: int, truth: Scenery, motion: Samples, duration: float, spent: float
    ) -> None:
        ratio, colliding = check_motion(self._recheck, truth, motion)
        self._rows.setdefault(name, []).append(Row(duration, spent, ratio, colliding))
        self._numbers.setdefault(name, []).append(number)


def main() -> None:
    """Run the comparison from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("problems", type=Path)
    parser.add_argument("--every", type=int, default=25)
    parser.add_argument("--timeout", type=float, default=20.0)
    parser.add_argument("--write", type=Path)
    parser.add_argument("--judge", type=Path)
    asked = parser.parse_args()
    if asked.write is not None:
        asked.write.mkdir(parents=True, exist_ok=True)
    Comparison(asked.problems, asked).run()


if __name__ == "__main__":
    main()
