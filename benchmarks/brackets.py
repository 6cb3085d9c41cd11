"""How tight are the sphere brackets of the built-in robots, and what do they cost to make?

    python -m benchmarks.brackets [--links]

Of each robot, or of each of its links: convex pieces, outer spheres (and as many inner ones), the
proved excess (how far the outer ones reach beyond, how much the inner ones lack, at most), and
the volumes of both, the link's own being 1. Times are processor time with nothing kept.
"""

import argparse
import time

import numpy as np

from benchmarks.verdict import builtin
from kinematics.robots import builtin_names
from obstacles.brackets import Brackets
from obstacles.sphere_set import ENOUGH, sphere_set


def main() -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--links", action="store_true", help="a row for each link")
    parser.add_argument("--robots", nargs="+", default=builtin_names())
    options = parser.parse_args()
    by_link = options.links
    head = f"{'':28} pieces spheres  excess mm: most median | volume outer inner"
    print(head if by_link else head + " | made in s")
    for name in options.robots:
        robot = builtin(name)
        told = Brackets.of(robot).tightness()
        excesses = 1e3 * np.array([t.excess for t in told])
        if by_link:
            for t in told:
                print(
                    f"{name + ' ' + t.link:28} {t.pieces:6d} {t.spheres:7d} {1e3 * t.excess:16.1f}"
                    f" {'':6} | {t.outer_volume:12.2f} {t.inner_volume:5.2f}"
                )
            continue
        # A hair fewer than what is kept: as much work, done anew.
        began = time.process_time()
        for piece in robot.pieces:
            sphere_set(piece, enough=ENOUGH * 1.000001)
        made = time.process_time() - began
        outer, inner = (np.median([t[k] for t in told]) for k in (4, 5))
        print(
            f"{name:28} {len(robot.pieces):6d} {sum(t.spheres for t in told):7d}"
            f" {excesses.max():16.1f} {np.median(excesses):6.1f} | {outer:12.2f} {inner:5.2f} |"
            f" {made:8.2f}"
        )


if __name__ == "__main__":
    main()
