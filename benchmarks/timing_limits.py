"""Limits, tolerances and continuity of timed random paths, checked by numpy alone.

Run it with `python -m benchmarks.timing_limits [COUNT]`. Paths have 1 to 14 joints and 2 to 100
waypoints, smooth and rough, tiny and long, with repeated points and reversals; each is timed by
each method. What is counted: ratios to a limit above 1 + 1e-9, motions farther from the polyline
than the tolerance asked for, jumps, ends that are not met or not at rest.
"""

import sys
import time
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from benchmarks.ratios import worst_ratio
from kinematics.trajectory import Trajectory
from planning.timing.blend import merge, reach_for_deviation
from planning.timing.method import timing_method
from planning.timing.options import Method
from planning.timing.parametrization import TimeParametrization
from planning.timing.spline import Ends, chord_knots, spline_path

Array = NDArray[np.float64]
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


def main() -> None:
    """Print what was found; the exit status says whether there was a fault."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    began = time.perf_counter()
    found = run(count)
    print(f"{found.paths} paths, {found.motions} motions, {time.perf_counter() - began:.0f} s")
    for name, value in sorted(found.worst.items()):
        print(f"  worst {name}: {value:.12f}")
    print(f"{len(found.faults)} faults")
    for fault in found.faults[:50]:
        print(f"  {fault}")
    sys.exit(bool(found.faults))


if __name__ == "__main__":
    main()
