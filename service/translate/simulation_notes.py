"""Notes on a simulation: what a reader of its numbers should know, a sentence each."""

import numpy as np

from kinematics.arrays import Array
from kinematics.chain import Chain
from kinematics.trajectory import Trajectory
from tracking.controller import Controller
from tracking.limit_use import limit_uses
from tracking.pd_gravity import PdGravity
from tracking.result import SimulationResult

#: Excess of a limit, and jump of a reference, that is no rounding error [rad or m, rad/s or m/s].
_ROUNDING = 1e-9


def simulation_notes(
    motion: Trajectory, robot: Chain, used: Controller, result: SimulationResult, begins: float
) -> list[str]:
    """Notes on the reference, the start, the controller and the tracked motion.

    Args:
        motion: The reference.
        robot: The robot with its limits.
        used: The controller.
        result: The simulation.
        begins: When the reference begins, in the request's time [s].
    """
    notes = _reference_notes(motion, robot, begins)
    names, limits = robot.joint_names, robot.limits
    outside = _outside(result.position[0], result.position[0], robot)
    if outside:
        notes.append(f"the robot starts outside the position limits of joint(s) {outside}")
    uses = limit_uses(result.bounds, limits)
    if "position" in uses and uses["position"].ratio > 1.0 + _ROUNDING:
        notes.append(
            f"joint {names[uses['position'].joint]!r} passes a position limit on the way: "
            "simulated joints have no stops"
        )
    if "velocity" in uses and uses["velocity"].ratio > 1.0 + _ROUNDING:
        notes.append(
            f"joint {names[uses['velocity'].joint]!r} reaches "
            f"{uses['velocity'].ratio:.3g} times its velocity limit"
        )
    if isinstance(used, PdGravity) and motion.peaks(1).value.max() > _ROUNDING:
        notes.append(
            "PD control with gravity compensation has a proof of stability for a constant "
            "reference only: for a moving one V may grow and an error remains"
        )
    return notes


def _reference_notes(motion: Trajectory, robot: Chain, begins: float) -> list[str]:
    """Limits that the reference does not keep, and its jumps."""
    notes = []
    span = motion.extrema()
    outside = _outside(span.minimum, span.maximum, robot)
    if outside:
        notes.append(f"the reference leaves the position limits of joint(s) {outside}")
    speed, limit = motion.peaks(1).value, robot.limits.velocity
    fast = np.flatnonzero(speed > limit + _ROUNDING)
    if len(fast):
        listed = ", ".join(repr(robot.joint_names[int(j)]) for j in fast)
        notes.append(f"the reference exceeds the velocity limits of joint(s) {listed}")
    for order, what in ((0, "position"), (1, "velocity")):
        jumps = np.abs(motion.jumps(order))
        if jumps.size and jumps.max() > _ROUNDING:
            row, joint = np.unravel_index(np.argmax(jumps), jumps.shape)
            notes.append(
                f"the reference jumps in {what} by {jumps[row, joint]:.3g} at "
                f"{motion.breaks[row + 1] + begins:.6g} s (joint {robot.joint_names[int(joint)]!r})"
            )
    return notes


def _outside(low: Array, high: Array, robot: Chain) -> str:
    """The joints whose range from ``low`` to ``high`` (n,) leaves their position limits."""
    limits = robot.limits
    below, above = low < limits.lower - _ROUNDING, high > limits.upper + _ROUNDING
    return ", ".join(repr(robot.joint_names[int(j)]) for j in np.flatnonzero(below | above))
