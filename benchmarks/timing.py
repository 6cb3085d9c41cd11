"""Path timing against the toppra package, in the same run: time to compute, duration, limits.

Run it with `python -m benchmarks.timing`. The package gets 100 or 1,000 uniform grid points and
answers a trajectory of constant path acceleration between them. Ours is timed from the same path
to a polynomial trajectory whose limits hold at every instant.

A second table is about bounded jerk, 20 waypoints of 7 joints: durations are told as parts of what
motions with a stop at each waypoint take; softness divides the jerk limits.
"""

import logging
import statistics
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import toppra
from numpy.typing import NDArray

from benchmarks.ratios import worst_ratio
from benchmarks.timing_optimum import stops
from planning.timing.blend import blend, largest_reaches
from planning.timing.jerk_limited import time_path_with_jerk
from planning.timing.minimum_time import time_path
from planning.timing.path import JointPath
from planning.timing.spline import chord_knots, spline_path

Array = NDArray[np.float64]
NAMES = tuple(f"joint{i}" for i in range(1, 8))
VELOCITY = np.array([2.175] * 4 + [2.61] * 3)
ACCELERATION = np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0])
JERK = np.array([7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0])
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


def milliseconds(function: Callable[[], object], repeats: int = 5) -> float:
    """Median processor time of several calls after one to warm up."""
    function()
    spent = []
    for _ in range(repeats):
        start = time.process_time()
        function()
        spent.append(time.process_time() - start)
    return 1e3 * statistics.median(spent)


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
        ours.append(milliseconds(mine))
        theirs.append(milliseconds(other))
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
        trajectory, factor, _ = mine()
        limits = (VELOCITY, ACCELERATION, jerk)
        ratios.append(max(worst_ratio(trajectory, v, k) for k, v in enumerate(limits, 1)))
        gains.append(trajectory.duration / stops(waypoints, limits))
        factors.append(factor)
        spent.append(milliseconds(mine))
    return (
        f"{count:9}{part:7.2f}{softness:10.0f}{statistics.median(spent):10.1f}{max(spent):8.1f}"
        f"{statistics.median(gains):10.3f}{max(gains):8.3f}{max(factors):10.4f}"
        f"{max(ratios):13.9f}"
    )


def main() -> None:
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
