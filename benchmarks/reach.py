"""Reach of a million poses, with two threads; beside one `ik` and one check a pose.

    python -m benchmarks.reach [--poses 1000000] [--robots kr6_sixx ur5e] [--free rz --choice first]

Poses of random configurations, a seventh of them beyond reach, past a post and a ball.
"""

import argparse
import time

import numpy as np

import armwright as aw
from kinematics.forward import forward
from planning.reach.evaluation import CHOICES

#: Poses that are answered one by one for comparison.
_ONE_BY_ONE = 500


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description="Reach of many poses.")
    parser.add_argument("--poses", type=int, default=1_000_000)
    parser.add_argument("--robots", nargs="+", default=["kr6_sixx", "ur5e"])
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--free", nargs="*", default=[], choices=["rx", "ry", "rz"])
    parser.add_argument("--samples", type=int, default=12, help="of each free axis")
    parser.add_argument("--choice", default="manipulability", choices=CHOICES)
    parser.add_argument("--no-clearance", action="store_true")
    chosen = parser.parse_args()
    scene = aw.Scene(
        [
            aw.Obstacle("post", aw.Box((0.1, 0.1, 1.2)), aw.pose([0.45, 0.1, 0.6])),
            aw.Obstacle("ball", aw.Sphere(0.15), aw.pose([-0.3, 0.4, 0.5])),
        ]
    )
    options = aw.ReachOptions(
        aw.Tolerance.free(*chosen.free, samples=chosen.samples),
        choice=chosen.choice,
        clearance=not chosen.no_clearance,
        threads=chosen.threads,
    )
    for name in chosen.robots:
        _measure(name, scene, chosen.poses, options)


def _measure(name: str, scene: aw.Scene, count: int, options: aw.ReachOptions) -> None:
    robot = aw.load_robot(name)
    q = np.random.default_rng(0).uniform(*robot.chain.sampling_bounds(), (count, robot.chain.n))
    poses = forward(robot.chain, q)
    poses[::7, :3, 3] *= 1.5
    aw.reach(robot, scene, poses[:100], options)
    begin, work = time.perf_counter(), time.process_time()
    found = aw.reach(robot, scene, poses, options)
    seconds, work = time.perf_counter() - begin, time.process_time() - work
    checker = aw.Checker.of(robot, scene)
    begin = time.perf_counter()
    for T in poses[:_ONE_BY_ONE]:
        for solution in aw.ik(robot, T, most=16).solutions:
            checker.valid(solution.joints)
    single = (time.perf_counter() - begin) / _ONE_BY_ONE
    print(
        f"{name}: {count} poses in {seconds:.2f} s, {1e6 * work / count:.1f} us of processor time "
        f"each, {1e6 * work / count / len(options.tolerance.deviations()):.2f} us a deviation, "
        f"{100 * found.is_reached.mean():.1f} % reached; one by one {1e6 * single:.0f} us each"
    )


if __name__ == "__main__":
    main()
