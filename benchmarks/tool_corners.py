"""Corners of tool motions that are passed at a speed: how constant it is, judged by pinocchio.

    python -m benchmarks.tool_corners [--arms panda ur5e kr6_sixx iiwa14] [--paths 10]
        [--speeds 0.05 0.1 0.25]

Random polylines of five lines about a reachable pose, with turns of the tool, short legs whose
blends touch, sharp corners and nearly straight ones; each asked for at several tool speeds. Told of
each arm and speed: of all blends the least speed within them, as part of that asked for (worst,
twentieth and half of them), how many dip below 0.99 of it; of plans in which no joint's limit is
told to be in the way the least speed between the first ramp and the last one; the motion's
duration, its pieces and the processor time of the plan.
"""

import argparse
import time
from typing import NamedTuple

import numpy as np
import pinocchio

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.pose import from_axis_angle, transform
from kinematics.robots import builtin_chain, builtin_srdf, builtin_urdf
from kinematics.serial_chain import serial_chain
from kinematics.srdf import parse_srdf
from kinematics.urdf import parse_urdf
from obstacles.robot_geometry import RobotGeometry, robot_geometry
from obstacles.scene import Scene
from planning.options import CartesianOptions, Options, ToolMotionOptions
from planning.pipeline import plan
from planning.problem import PoseGoal, Problem
from planning.result import Plan
from planning.timing.options import TimingOptions

ARMS = ("panda", "ur5e", "kr6_sixx", "iiwa14")
#: Where each arm begins: bent, in the middle of its room.
STARTS = {
    "panda": [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785],
    "ur5e": [0.3, -1.4, 1.8, -1.9, -1.5, 0.2],
    "kr6_sixx": [0.1, -1.2, 1.6, 0.2, 0.9, 0.0],
    "iiwa14": [0.2, 0.6, 0.1, -1.5, 0.1, 0.9, 0.0],
}
#: Looks at each blend.
LOOKS = 201
#: A speed that is lower than this part of what was asked for is a dip.
DIP = 0.99


class Passed(NamedTuple):
    """One plan.

    Args:
        lows: Least speed in each blend, as part of what was asked for.
        between: Least speed between the first ramp and the last one, likewise; 0 where it is never
            reached.
        is_free: Whether no joint's limit is told to be in the way.
        duration: Of the motion [s].
        pieces: Of the motion.
        seconds: Processor time of the plan [s].
    """

    lows: list[float]
    between: float
    is_free: bool
    duration: float
    pieces: int
    seconds: float


class Tool:
    """Speeds of a robot's tip by pinocchio."""

    def __init__(self, name: str) -> None:
        self.chain = builtin_chain(name)
        self._model = pinocchio.buildModelFromXML(builtin_urdf(name))
        self._data = self._model.createData()
        names = self.chain.joint_names
        self._index = [self._model.joints[self._model.getJointId(j)].idx_v for j in names]
        self._frame = self._model.getFrameId(self.chain.tip_link)

    def speed(self, q: Array, rates: Array) -> float:
        """Speed of the tip's origin [m/s]."""
        wide = np.zeros((2, self._model.nv))
        wide[:, self._index] = q, rates
        pinocchio.forwardKinematics(self._model, self._data, *wide)
        pinocchio.updateFramePlacements(self._model, self._data)
        velocity = pinocchio.getFrameVelocity(self._model, self._data, self._frame)
        return float(np.linalg.norm(velocity.linear))


def load(name: str) -> RobotGeometry:
    """A built-in robot with its solids."""
    description, semantics = parse_urdf(builtin_urdf(name)), parse_srdf(builtin_srdf(name))
    chain = serial_chain(description, semantics=semantics)
    return robot_geometry(chain, description, {}, semantics)


def polyline(T: Array, random: np.random.Generator) -> tuple[ToolMotionOptions, ...]:
    """Five lines from a pose, each turned by up to 0.4 rad, and a fifth of them short."""
    ways, place, R = [], T[:3, 3].copy(), T[:3, :3]
    direction = random.normal(size=3)
    for _ in range(5):
        sharpness = random.choice([0.02, 0.5, 1.0, 2.0])
        direction = direction / np.linalg.norm(direction) + sharpness * random.normal(size=3)
        direction = direction / np.linalg.norm(direction) - 3.0 * (place - T[:3, 3])
        direction /= np.linalg.norm(direction)
        length = random.uniform(0.02, 0.05) if random.random() < 0.2 else random.uniform(0.06, 0.15)
        place = place + length * direction
        axis = random.normal(size=3)
        turned = from_axis_angle(axis / np.linalg.norm(axis), random.uniform(0.0, 0.4)) @ R
        R = turned if random.random() < 0.5 else R
        ways.append(ToolMotionOptions("lin", transform(R, place)))
    return tuple(ways)


def passed(robot: RobotGeometry, tool: Tool, start: Array, ways: tuple[ToolMotionOptions, ...],
           speed: float) -> Passed | None:  # fmt: skip
    """The plan through a polyline at a speed, judged; None where there is none."""
    asked = CartesianOptions(motions=ways, blend=0.03)
    problem = Problem(robot, Scene(), start, (PoseGoal(ways[-1].T_base_tip),))
    timing = TimingOptions("jerk_limited", tool_speed=speed)
    began = time.process_time()
    answer = plan(problem, Options(planner="cartesian", cartesian=asked, timing=timing, timeout=60))
    seconds = time.process_time() - began
    if not isinstance(answer, Plan):
        return None
    motion, lows = answer.trajectory, []
    blends = [report for report in answer.tool_motions if report.blends]
    for k in sorted({report.asked for report in blends}):
        mine = [report for report in blends if report.asked == k]
        times = np.linspace(mine[0].begins, mine[-1].ends, LOOKS)
        states = zip(motion.sample(times), motion.sample(times, 1), strict=True)
        lows.append(min(tool.speed(*state) for state in states) / speed)
    times = np.linspace(0.0, motion.duration, 4001)
    states = zip(motion.sample(times), motion.sample(times, 1), strict=True)
    speeds = np.array([tool.speed(*state) for state in states]) / speed
    reached = np.flatnonzero(speeds >= DIP)
    between = float(speeds[reached[0] : reached[-1] + 1].min()) if len(reached) else 0.0
    # Reports of before there were limits have none.
    is_free = all(getattr(one, "speed_limit", None) is None for one in answer.tool_motions)
    return Passed(lows, between, is_free, motion.duration, motion.pieces, seconds)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--arms", nargs="*", default=ARMS)
    parser.add_argument("--paths", type=int, default=10)
    parser.add_argument("--speeds", type=float, nargs="*", default=[0.05, 0.1, 0.25])
    given = parser.parse_args()
    print(
        "| arm | speed | plans | blends | worst | 5 % | median | dips | free: plans, worst "
        "| duration | pieces | CPU |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|---|")
    for name in given.arms:
        robot, tool = load(name), Tool(name)
        start = np.array(STARTS[name])
        for speed in given.speeds:
            random = np.random.default_rng(7)
            T = forward(robot.chain, start)
            made = [
                passed(robot, tool, start, polyline(T, random), speed) for _ in range(given.paths)
            ]
            found = [one for one in made if one is not None]
            lows = np.array([low for one in found for low in one.lows])
            free = [one.between for one in found if one.is_free]
            low, tail, middle = np.quantile(lows, [0.0, 0.05, 0.5])
            print(
                f"| {name} | {speed:g} | {len(found)} of {len(made)} | {len(lows)} | {low:.3f} "
                f"| {tail:.3f} | {middle:.4f} | {int((lows < DIP).sum())} "
                f"| {len(free)}, {min(free, default=np.nan):.4f} "
                f"| {np.median([one.duration for one in found]):.3f} s "
                f"| {np.median([one.pieces for one in found]):.0f} "
                f"| {1e3 * np.median([one.seconds for one in found]):.0f} ms |"
            )


if __name__ == "__main__":
    main()
