"""Recorded curves told by few waypoints: do bounds hold, how few are they, how fast the motions?

    python -m benchmarks.planning.recorded [--curves 1000]

Curves of 2 to 7 joints, smooth, noisy, rounded, with places visited twice. The bound is held
against a discrete Frechet distance of dense samples on both lines, the number of waypoints against
a dynamic programme over all pairs on small curves, and durations by toppra, proved to be within the
tolerance, against those of the uncut curve.
"""

import argparse
import time

import numpy as np

import armwright as aw
from kinematics.arrays import Array
from planning.retiming.simplify import simplify
from planning.timing.options import TimingOptions
from planning.timing.path.simplification import leg_stands_kernel


def curve(rng: np.random.Generator, k: int) -> Array:
    """A recorded path of k waypoints, shape (k, n)."""
    n, u = int(rng.integers(2, 8)), np.linspace(0.0, 1.0, k)[:, None]
    bend = 0.3 * np.sin(u * rng.uniform(0.0, 15.0, n) + rng.uniform(0.0, 6.0, n))
    points = rng.uniform(-1.0, 1.0, n) + u * rng.uniform(-1.0, 1.0, n) + bend
    kind = rng.integers(4)
    if kind == 1:
        points += rng.normal(0.0, 3e-4, points.shape)
    elif kind == 2:
        points = points.round(4)
    elif kind == 3:
        points = np.concatenate([points[: k // 2], points[: k - k // 2][::-1]])
    return np.ascontiguousarray(points)


def dense(points: Array, count: int) -> Array:
    """So many places on each leg of a polyline."""
    at = np.linspace(0.0, len(points) - 1.0, count * (len(points) - 1) + 1)
    return np.stack([np.interp(at, np.arange(len(points)), row) for row in points.T], axis=-1)


def frechet(first: Array, second: Array) -> float:
    """The discrete Frechet distance of two dense polylines, any joint; too large by a step."""
    away = np.abs(first[:, None] - second[None]).max(axis=2)
    reached = np.maximum.accumulate(away[0])
    for row in away[1:]:
        free = np.maximum(row, np.minimum(reached, np.append(np.inf, reached[:-1])))
        for k in range(1, len(row)):
            free[k] = min(free[k], max(row[k], free[k - 1]))
        reached = free
    return float(reached[-1])


def fewest(points: Array, within: float) -> int:
    """The least number of waypoints, by a dynamic programme."""
    best = np.full(len(points), len(points) + 1)
    best[0] = 1
    for a in range(len(points) - 1):
        for b in range(a + 1, len(points)):
            if best[a] + 1 < best[b] and leg_stands_kernel(points, a, b, within, np.inf):
                best[b] = best[a] + 1
    return int(best[-1])


def main() -> None:
    """Judge."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--curves", type=int, default=1000)
    count, rng = parser.parse_args().curves, np.random.default_rng(0)
    beyond, more, ratios, proved, spent = 0, [], [], 0, []
    for number in range(count):
        points = curve(rng, int(rng.integers(40, 120)))
        tolerance = 10.0 ** rng.uniform(-3.3, -1.7)
        began = time.process_time()
        found = simplify(points, tolerance)
        spent.append(time.process_time() - began)
        ends = [dense(points, 4), dense(found.waypoints, 4 * -(-len(points) // len(found.numbers)))]
        step = max(np.abs(np.diff(rows, axis=0)).max() for rows in ends)
        beyond += not found.deviation <= tolerance or frechet(*ends) > found.deviation + step
        if number % 4 == 0:
            more.append(len(found.numbers) / fewest(points, tolerance))
            limits = {name: np.full(points.shape[1], 2.0) for name in ("velocity", "acceleration")}
            timing = TimingOptions("toppra")
            near = aw.retime(points, tolerance=tolerance, limits=limits, timing_options=timing)
            timing = TimingOptions("toppra", interpolation="clamped_spline")
            uncut = aw.retime(points, limits=limits, timing_options=timing)
            ratios.append(near.trajectory.duration / uncut.trajectory.duration)
            path = near.certificate.path
            is_near = path is not None and path.deviation is not None
            proved += near.certificate.verified and is_near
    print(f"{count} curves, {1e3 * np.median(spent):.2f} ms each: {beyond} beyond their bound")
    print(f"waypoints beside the fewest, {len(more)} curves: {max(more):.3f} times at most")
    p10, p50, p90 = np.percentile(ratios, [10, 50, 90])
    print(f"durations beside full splines: {p50:.3f} times (p10 {p10:.3f}, p90 {p90:.3f})")
    print(f"{proved} of {len(ratios)} motions proved within the tolerance")


if __name__ == "__main__":
    main()
