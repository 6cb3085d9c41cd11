"""Sweeps of a ball on two slides, whose distances have closed forms."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from kinematics.trajectory.trajectory import Trajectory
from obstacles.scenes.scene import Scene
from planning.proof.collision.pair_table import PairArrays, PairTable
from planning.proof.collision.sweep import run
from planning.proof.collision.sweep_state import Sweep, start_kernel
from tests.planning.scenes import box
from tests.planning.slider import slider

#: From x = 0.45 to 0.55: the ball of 0.05 m touches it from x = 0.4 on.
WALL = Scene((box("wall", (0.1, 1.0, 1.0), (0.5, 0.0, 0.0)),))


class Started(NamedTuple):
    """A sweep with what it is of."""

    table: PairTable
    sweep: Sweep
    trajectory: Trajectory

    def go(self, sharp: bool = True, most: int = 100_000) -> int:
        """Sweep on; why it stopped."""
        breaks, c = self.trajectory.breaks, self.trajectory.coefficients
        return int(run(self.table.arrays, breaks, c, self.sweep, sharp, most))


def through(*points: Sequence[float], times: Sequence[float] | None = None) -> Trajectory:
    """Straight legs through points (x, y) [m], each in a second or until ``times`` [s]."""
    corners = np.array(points, dtype=np.float64)
    breaks = np.arange(len(corners), dtype=np.float64) if times is None else np.array(times)
    rates = np.diff(corners, axis=0) / np.diff(breaks)[:, None]
    coefficients = np.stack([corners[:-1], rates], axis=2)
    return Trajectory(slider().chain.joint_names, breaks, coefficients)


def start_sweep(trajectory: Trajectory, pairs: PairArrays) -> Sweep:
    """A sweep at the start of a trajectory, every pair open."""
    sizes = pairs.bodies.shape[1], len(pairs.joints), pairs.moving
    return start_kernel(trajectory.breaks, trajectory.coefficients, pairs.roots, sizes)


def start(trajectory: Trajectory, scene: Scene = WALL, margin: float = 0.0) -> Started:
    """A sweep at its beginning."""
    table = PairTable.of(slider(), scene, margin)
    return Started(table, start_sweep(trajectory, table.arrays), trajectory)
