"""Path timing against the toppra package, in the same run: time to compute, duration, limits.

    python -m benchmarks.timing                 the two tables
    python -m benchmarks.timing --limits 1000   limits of random paths

The package gets 100 or 1,000 uniform grid points and
answers a trajectory of constant path acceleration between them. Ours is timed from the same path
to a polynomial trajectory whose limits hold at every instant.

A second table is about bounded jerk, 20 waypoints of 7 joints: durations are told as parts of what
motions with a stop at each waypoint take; softness divides the jerk limits.

With ``--limits`` so many random paths are timed by each method, and judged by numpy alone. Paths
have 1 to 14 joints and 2 to 100 waypoints, smooth and rough, tiny and long, with repeated points
and reversals. Faults are ratios to a limit above 1 + 1e-9, motions farther from the polyline than
the tolerance, jumps, and ends that are missed or not at rest.
"""

import argparse
import logging
import statistics
import sys
import time
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import toppra

from benchmarks import mbm_problems
from benchmarks.judges.least_time import stops
from benchmarks.judges.ratios import worst_ratio
from benchmarks.rounds import once
from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory
from planning.timing.jerk.jerk_limited import time_path_with_jerk
from planning.timing.method import timing_method
from planning.timing.options import Method
from planning.timing.parametrization import TimeParametrization
from planning.timing.path.blend import blend, largest_reaches, merge, reach_for_deviation
from planning.timing.path.path import JointPath
from planning.timing.speed.minimum_time import time_path
from planning.timing.spline.spline import Ends, chord_knots, spline_path

NAMES = tuple(f"joint{i}" for i in range(1, 8))
VELOCITY = np.array([2.175] * 4 + [2.61] * 3)
ACCELERATION, JERK = np.array(mbm_problems.ACCELERATION), np.array(mbm_problems.JERK)
PATHS = 25


class _Path:
    """Our path as the package sees it."""

    def __init__(self, path: JointPath) -> None:
        self._path = path
        self.dof = path.n
        self.path_interval = np.array([0.0, path.breaks[-1]])

    def __call__(self, places: float | Array, order: int = 0) -> Array:
        values = self._path.sample(np.atleast_1d(places), order)
        return values[0] if np.ndim(places) == 0 else values

    def get_duration(self) -> float:
        return float(self.path_interval[1])


def package(path: JointPath, points: int) -> Any:
    """The package's trajectory on a uniform grid, at constant acceleration from point to point."""
    constraints = [
        toppra.constraint.JointVelocityConstraint(np.column_stack([-VELOCITY, VELOCITY])),
        toppra.constraint.JointAccelerationConstraint(
            np.column_stack([-ACCELERATION, ACCELERATION])
        ),
    ]
    solver = toppra.algorithm.TOPPRA(
        constraints,
        _Path(path),
        gridpoints=np.linspace(0.0, path.breaks[-1], points),
        solver_wrapper="seidel",
        parametrizer="ParametrizeConstAccel",
    )
    return solver.compute_trajectory(0.0, 0.0)


def sampled_ratio(trajectory: Any) -> float:
    """The largest ratio to a limit on 2,000 samples: a lower bound of the true one."""
    times = np.linspace(0.0, trajectory.duration, 2000)[:-1]
    velocity = np.abs(trajectory(times, 1)) / VELOCITY
    acceleration = np.abs(trajectory(times, 2)) / ACCELERATION
    return float(max(velocity.max(), acceleration.max()))


def paths(kind: str, rng: np.random.Generator) -> JointPath:
    """A random seven-joint path of a kind."""
    waypoints = rng.uniform(-2.0, 2.0, (6, 7))
    if kind == "natural spline":
        return spline_path(waypoints, chord_knots(waypoints))
    part = {"parabolas only": 1.0, "half blended": 0.5, "tightly blended": 0.05}[kind]
    return blend(waypoints, part * largest_reaches(waypoints))


def compare(kind: str, points: int) -> str:
    """A line of the table: one kind of path against one grid of the package."""
    rng = np.random.default_rng(0)
    ours, theirs, ratios, peaks, samples = [], [], [], [], []
    for _ in range(PATHS):
        path = paths(kind, rng)
        mine = partial(time_path, path, NAMES, VELOCITY, ACCELERATION)
        other = partial(package, path, points)
        trajectory, reference = mine().trajectory, other()
        ratios.append(trajectory.duration / float(reference.duration))
        peaks.append((trajectory.peaks(1).value / VELOCITY).max())
        peaks.append((trajectory.peaks(2).value / ACCELERATION).max())
        samples.append(sampled_ratio(reference))
        ours.append(once(mine) / 1e3)
        theirs.append(once(other) / 1e3)
    a, b = statistics.median(ours), statistics.median(theirs)
    return (
        f"{kind:16}{points:7}{a:9.2f}{b:8.2f}{a / b:8.3f}"
        f"{statistics.median(ratios):10.4f}{max(ratios):8.4f}{max(peaks):13.9f}{max(samples):8.4f}"
    )


def jerk_line(count: int, part: float, softness: float) -> str:
    """A line of the second table: time to compute and duration of motion with bounded jerk."""
    rng = np.random.default_rng(0)
    jerk = JERK / softness
    spent, ratios, gains, factors = [], [], [], []
    for _ in range(PATHS):
        waypoints = rng.uniform(-2.0, 2.0, (count, 7))
        path = blend(waypoints, part * largest_reaches(waypoints), smooth=True)
        mine = partial(time_path_with_jerk, path, NAMES, VELOCITY, ACCELERATION, jerk)
        trajectory, factor, *_ = mine()
        limits = (VELOCITY, ACCELERATION, jerk)
        ratios.append(max(worst_ratio(trajectory, v, k) for k, v in enumerate(limits, 1)))
        gains.append(trajectory.duration / stops(waypoints, limits))
        factors.append(factor)
        spent.append(once(mine) / 1e3)
    return (
        f"{count:9}{part:7.2f}{softness:10.0f}{statistics.median(spent):10.1f}{max(spent):8.1f}"
        f"{statistics.median(gains):10.3f}{max(gains):8.3f}{max(factors):10.4f}"
        f"{max(ratios):13.9f}"
    )


#: What the last digits of an extremum are worth.
TOLERANCE = 1e-9
#: Rounding of places of size 1 and of their rates, relative to the limits.
_ROUNDING = 1e-9
KINDS = ("stops", "blended", "widely blended", "natural spline", "clamped spline")


@dataclass(frozen=True)
class Case:
    """A path to be timed and its limits."""

    kind: str
    waypoints: Array
    deviation: float
    velocity: Array
    acceleration: Array
    jerk: Array

    @property
    def names(self) -> tuple[str, ...]:
        """Names for the joints."""
        return tuple(f"joint{i}" for i in range(self.waypoints.shape[1]))


@dataclass
class Findings:
    """What was found of many motions."""

    paths: int = 0
    motions: int = 0
    worst: dict[str, float] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)


def random_case(rng: np.random.Generator) -> Case:
    """One path: its kind, size, smoothness, joints and limits all drawn."""
    n = int(rng.integers(1, 15))
    kind = KINDS[rng.integers(len(KINDS))]
    count = int(np.exp(rng.uniform(np.log(2.0), np.log(100.0))))
    size = 10.0 ** rng.uniform(-4.0, 1.0)
    points = rng.uniform(-1.0, 1.0, (max(count, 2), n)) * size
    if rng.random() < 0.5:
        # Smooth: a random walk of directions that change little.
        points = np.cumsum(np.cumsum(0.1 * points, axis=0), axis=0)
    if kind in KINDS[:3] and rng.random() < 0.3:
        points = np.repeat(points, rng.integers(1, 3, len(points)), axis=0)
        points = np.concatenate([points, points[-2:-4:-1]])
    velocity = 10.0 ** rng.uniform(-1.0, 1.0, n)
    acceleration = velocity * 10.0 ** rng.uniform(0.0, 1.5, n)
    jerk = acceleration * 10.0 ** rng.uniform(0.5, 2.5, n)
    deviation = {"stops": 0.0, "blended": 0.02, "widely blended": 1.0}.get(kind, 0.0) * size
    return Case(kind, points, deviation, velocity, acceleration, jerk)


def time_case(case: Case, method: Method) -> Trajectory:
    """The motion of a case by a method."""
    law = TimeParametrization(timing_method(method), case.velocity, case.acceleration, case.jerk)
    if case.kind.endswith("spline"):
        ends: Ends = "natural" if case.kind.startswith("natural") else "clamped"
        if method == "spline":
            return law.time_spline(case.waypoints, None, ends, case.names).trajectory
        path = spline_path(case.waypoints, chord_knots(case.waypoints), ends)
        return law.time(path, case.names).trajectory
    points = merge(case.waypoints)
    reaches = reach_for_deviation(points, case.deviation, law.smooth)
    return law.time_polyline(points, reaches, case.names).trajectory


def check(case: Case, method: Method, motion: Trajectory, found: Findings) -> None:
    """Add what is found of a motion."""
    found.motions += 1
    limits = {1: case.velocity, 2: case.acceleration}
    if method != "toppra":
        limits[3] = case.jerk
    label = f"{method}, {case.kind}, {case.waypoints.shape}"
    for order, limit in limits.items():
        ratio = worst_ratio(motion, limit, order)
        name = f"{method} order {order}"
        found.worst[name] = max(found.worst.get(name, 0.0), ratio)
        if ratio > 1.0 + TOLERANCE:
            found.faults.append(f"{label}: ratio {ratio} at order {order}")
    scale = max(1.0, float(np.abs(case.waypoints).max()))
    jumps = motion.continuity()
    rates = float(case.velocity.max()), float(case.acceleration.max())
    if jumps.position > _ROUNDING * scale or jumps.velocity > _ROUNDING * rates[0]:
        found.faults.append(f"{label}: jumps {jumps}")
    if method != "toppra" and jumps.acceleration > 1e-6 * rates[1]:
        found.faults.append(f"{label}: acceleration jumps by {jumps.acceleration}")
    ends = motion.sample([0.0, motion.duration])
    if np.abs(ends - case.waypoints[[0, -1]]).max() > _ROUNDING * scale:
        found.faults.append(f"{label}: ends are missed")
    if method != "spline":
        speeds = np.abs(motion.sample([0.0, motion.duration], 1)).max()
        if speeds > _ROUNDING * rates[0]:
            found.faults.append(f"{label}: not at rest, {speeds}")
    if not case.kind.endswith("spline"):
        off = _distance(motion.sample(np.linspace(0.0, motion.duration, 400)), case.waypoints)
        found.worst["deviation"] = max(
            found.worst.get("deviation", 0.0), off / case.deviation if case.deviation else 0.0
        )
        if off > case.deviation + _ROUNDING * scale:
            found.faults.append(f"{label}: {off} off the path, {case.deviation} allowed")


def _distance(points: Array, waypoints: Array) -> float:
    """The largest distance of points from a polyline."""
    starts, legs = waypoints[:-1], np.diff(waypoints, axis=0)
    squares = np.maximum((legs**2).sum(axis=1), 1e-300)
    nearest = np.full(len(points), np.inf)
    for start, leg, square in zip(starts, legs, squares, strict=True):
        share = np.clip((points - start) @ leg / square, 0.0, 1.0)
        away = np.linalg.norm(points - start - share[:, None] * leg, axis=1)
        nearest = np.minimum(nearest, away)
    return float(nearest.max())


def run(count: int, seed: int = 0) -> Findings:
    """Time and check random paths, each by every method that goes with it."""
    rng, found = np.random.default_rng(seed), Findings()
    for _ in range(count):
        case = random_case(rng)
        found.paths += 1
        methods: list[Method] = ["toppra", "jerk_limited"]
        if case.kind.endswith("spline"):
            methods.append("spline")
        for method in methods:
            try:
                check(case, method, time_case(case, method), found)
            except Exception as error:  # noqa: BLE001  told with the case it belongs to
                shape = case.waypoints.shape
                found.faults.append(f"{method}, {case.kind}, {shape}: {error!r}")
    return found


def limits_held(count: int) -> bool:
    """Print the faults of random paths; whether there are none."""
    began = time.perf_counter()
    found = run(count)
    print(f"{found.paths} paths, {found.motions} motions, {time.perf_counter() - began:.0f} s")
    for name, value in sorted(found.worst.items()):
        print(f"  worst {name}: {value:.12f}")
    print(f"{len(found.faults)} faults")
    for fault in found.faults[:50]:
        print(f"  {fault}")
    return not found.faults


def main() -> None:
    """Print the tables, or judge limits; the exit status tells of faults."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--limits", type=int, metavar="COUNT", help="random paths to judge")
    asked = parser.parse_args()
    if asked.limits is not None:
        sys.exit(not limits_held(asked.limits))
    tables()


def tables() -> None:
    """Print tables of medians over random paths."""
    logging.getLogger("toppra").setLevel(logging.CRITICAL)
    print(f"{'':23}{'compute [ms]':^25}{'duration ratio':^18}{'worst ratio to limit':^21}")
    print(f"{'path':16}{'points':>7}{'ours':>9}{'toppra':>8}{'ratio':>8}", end="")
    print(f"{'median':>10}{'worst':>8}{'ours':>13}{'toppra':>8}")
    for kind in ("tightly blended", "half blended", "parabolas only", "natural spline"):
        for points in (100, 1000):
            print(compare(kind, points))
    print()
    print(
        f"{'bounded jerk':26}{'compute [ms]':^18}{'of the stops':^18}{'dilated':>10}{'worst':>13}"
    )
    print(f"{'waypoints':>9}{'blend':>7}{'softness':>10}", end="")
    print(f"{'median':>10}{'worst':>8}{'median':>10}{'worst':>8}{'by':>10}{'ratio':>13}")
    for softness in (1.0, 10.0, 100.0):
        for part in (1.0, 0.25):
            print(jerk_line(20, part, softness))


if __name__ == "__main__":
    main()
