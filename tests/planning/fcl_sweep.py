"""A certificate without a kernel of ours: FCL distances and one motion bound, cell by cell.

What the certificate was before it checked witnesses. Slow, and kept as its oracle.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import comb

from kinematics.arrays import Array
from kinematics.forward import joint_frames
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.fcl_distance import FclWorld
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene

#: As fine as the certificate itself decides [m].
_RESOLUTION = 1e-7


@dataclass(frozen=True)
class Sweep:
    """What was found: the first contact, or None, and the least clearance proved."""

    contact: float | None
    pair: tuple[str, str] | None
    clearance: float


def sweep(trajectory: Trajectory, robot: RobotGeometry, scene: Scene, margin: float = 0.0) -> Sweep:
    """Prove all pairs apart by more than their margins, or find where they are first not."""
    world = FclWorld(robot, scene)
    own = world.pairs[:, 1] < len(robot.pieces)
    apart = world.margins + np.where(own, 0.0, margin)
    everything = np.arange(len(apart))
    least = np.inf
    for piece in range(trajectory.pieces):
        begins, ends = trajectory.breaks[piece : piece + 2]
        waiting = [(0.0, float(ends - begins), everything)]
        while waiting:
            low, high, pairs = waiting.pop()
            half = 0.5 * (high - low)
            q, delta = _stray(trajectory.coefficients[piece], low + half, half)
            world.set_configuration(q)
            left = []
            moved = _Moved(world, q, delta)
            balls = world.ball_bounds(*world.pairs.T)
            bounds = {}
            for pair in pairs:
                bounds[pair] = moved(int(pair))
                if balls[pair] - bounds[pair] > max(apart[pair], 0.05):
                    continue
                distance = world.distance(int(pair)) + world.margins[pair]
                if distance - bounds[pair] > apart[pair]:
                    least = min(least, distance - bounds[pair])
                else:
                    left.append(pair)
            tight = [k for k in left if bounds[k] < _RESOLUTION]
            if tight:
                return Sweep(float(begins + low + half), world.pair_names(int(tight[0])), least)
            if left:
                halves = (low + half, high), (low, low + half)
                waiting += [(a, b, np.array(left)) for a, b in halves]
    return Sweep(None, None, least)


def _stray(coefficients: Array, at: float, half: float) -> tuple[Array, Array]:
    """Values (n,) at an instant, and how far they stray from them at most within ``half`` of it."""
    k = np.arange(coefficients.shape[1])
    # Taylor's expansion about the instant: t^j is the sum of binom(j, k) at^(j - k) (t - at)^k.
    shift = np.tril(comb(k[:, None], k) * float(at) ** np.maximum(k[:, None] - k, 0))
    about = coefficients @ shift
    return about[:, 0], np.abs(about[:, 1:]) @ half ** k[1:].astype(float)


class _Moved:
    """How far the second piece of a pair can move against the first, by joints in turn."""

    def __init__(self, world: FclWorld, q: Array, delta: Array) -> None:
        robot = world.robot
        self._world, self._delta = world, delta
        self._joints = np.append(robot.joints, np.full(len(world._arrays) - len(robot.pieces), -1))
        self._frames = joint_frames(robot.chain, q)
        self._known: dict[tuple[int, int], float] = {}

    def __call__(self, pair: int) -> float:
        still, moving = sorted(self._world.pairs[pair], key=lambda k: int(self._joints[k]))
        key = (int(moving), int(self._joints[still]))
        if key not in self._known:
            self._known[key] = self._moved(*key)
        return self._known[key]

    def _moved(self, piece: int, still: int) -> float:
        robot = self._world.robot
        center, moved = self._world._centers[piece], 0.0
        for j in range(self._joints[piece], still, -1):
            if robot.chain.joint_types[j] == 1:
                moved += self._delta[j]
                continue
            x, y, z = center - self._frames[j, :3, 3]
            a, b, c = self._frames[j, :3, 2]
            lever = math.hypot(b * z - c * y, c * x - a * z, a * y - b * x)
            moved += (lever + robot.arrays.radii[piece] + moved) * self._delta[j]
        return float(moved)
