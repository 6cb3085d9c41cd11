"""Notes on a simulation: what a reader of its numbers should know, a sentence each."""

import numpy as np

from armwright_wire.motions.simulation import SimulateRequest
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from tracking.controllers.controller import Controller
from tracking.controllers.gain import commute
from tracking.controllers.model_based import Adaptive, IndependentJoint, Passivity, PdGravity
from tracking.simulation.result import SimulationResult
from tracking.tube.tube import limit_uses

#: Excess of a limit, and jump of a reference, that is no rounding error [rad or m, rad/s or m/s].
_ROUNDING = 1e-9
#: Growth of V that is no error of the integrator, as part of the largest V.
_GROWTH = 1e-3
#: A largest V below this is that of a perfect track: what it does is rounding.
_SMALL_V = 1e-6


def request_notes(body: SimulateRequest, used: Controller) -> list[str]:
    """Notes on what a request asks for without effect.

    Args:
        body: The request.
        used: The controller.
    """
    notes = []
    pushed = body.disturbance
    if pushed is not None and np.any(pushed.amplitude) and pushed.frequency == 0.0:
        notes.append("disturbance.amplitude has no effect: its frequency is 0")
    if pushed is not None and pushed.frequency > 0.0 and not np.any(pushed.amplitude):
        notes.append("disturbance.frequency has no effect: its amplitude is 0")
    if body.noise is not None and body.noise.period and body.control_period is not None:
        notes.append(
            "noise.period has no effect: with a control_period errors are drawn once in each period"
        )
    if body.scene is None and body.allowed_collisions:
        notes.append("allowed_collisions has no effect without a scene")
    if isinstance(used, IndependentJoint):
        notes += _independent_notes(body)
    return notes


def _independent_notes(body: SimulateRequest) -> list[str]:
    """Model errors that independent joint control does not read."""
    error = body.model_error
    if error is None:
        return []
    names = ("mass_scale", "inertias", "gravity", "coulomb_friction")
    unread = [name for name in names if getattr(error, name) is not None]
    if not unread:
        return []
    note = (
        f"model_error: {', '.join(unread)} does not enter the torque of independent joint control, "
        "which reads inertias at most for its gains and J"
    )
    return [note]


def simulation_notes(
    motion: Trajectory,
    robot: Chain,
    used: Controller,
    result: SimulationResult,
    begins: float,
    *,
    has_stops: bool = False,
) -> list[str]:
    """Notes on the reference, the start, the controller and the tracked motion.

    Args:
        motion: The reference.
        robot: The robot with its limits.
        used: The controller.
        result: The simulation.
        begins: Time of the reference's beginning, as the request counts [s].
        has_stops: Whether the joints have stops at their position limits.
    """
    notes = _reference_notes(motion, robot, begins)
    names, limits = robot.joint_names, robot.limits
    outside = _outside(result.position[0], result.position[0], robot)
    if outside:
        notes.append(f"the robot starts outside the position limits of joint(s) {outside}")
    uses = limit_uses(result.bounds, limits)
    if "position" in uses and uses["position"].ratio > 1.0 + _ROUNDING:
        joint = repr(names[uses["position"].joint])
        notes.append(
            f"joint {joint} is pressed into its stop"
            if has_stops
            else f"joint {joint} passes a position limit on the way: simulated joints have no "
            "stops without joint_stops"
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
    if isinstance(used, Passivity | Adaptive) and not commute(used.Lambda, used.K):
        notes.append(
            "Lambda and K do not commute, so the proof of this controller, which needs Lambda K "
            "symmetric, does not cover it: V has the symmetric part of Lambda K, and may grow"
        )
    return notes + _lyapunov_notes(result, begins)


def _lyapunov_notes(result: SimulationResult, begins: float) -> list[str]:
    """Growth of V that its proof would forbid."""
    V = result.lyapunov
    rise = V - np.minimum.accumulate(V)
    worst = int(np.argmax(rise))
    if V.max() < _SMALL_V or rise[worst] < _GROWTH * V.max():
        return []
    first = int(np.argmin(V[: worst + 1]))
    times = result.times + begins
    note = (
        f"V grows from {V[first]:.3g} to {V[worst]:.3g} between {times[first]:.6g} s and "
        f"{times[worst]:.6g} s: an assumption of its proof does not hold there (an exact model, a "
        "continuous controller, no saturation, disturbance, noise or stop)"
    )
    return [note]


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
