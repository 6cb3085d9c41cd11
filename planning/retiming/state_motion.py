"""Timed motion between two states: the fastest with bounded jerk, its limits certified."""

from collections.abc import Mapping, Sequence

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidTrajectory
from kinematics.model.chain import Chain, Limits
from kinematics.trajectory.trajectory import Trajectory
from planning.preflight.limits import moved_note, rates_onto_limits, snap_to_limits
from planning.proof.certificate import certify_limits
from planning.retiming.retimed import Retimed
from planning.timing.choice import chosen_parametrization, require_limits, required_limits
from planning.timing.jerk.state_to_state import (
    AT_REST,
    JointState,
    Synchronization,
    state_to_state,
    without_rounding,
)
from planning.timing.method import timing_method
from planning.timing.options import TimingOptions
from planning.timing.parametrization import TimingReport
from planning.values.limits import RATIO_TOLERANCE, position_excess


def time_states(
    joint_names: Sequence[str],
    states: tuple[JointState, JointState],
    timing: TimingOptions,
    overrides: Mapping[str, Array],
    chain: Chain | None = None,
    synchronization: Synchronization = "phase",
) -> Retimed:
    """The fastest motion from one state to another with bounded jerk, its limits certified.

    Args:
        joint_names: n names.
        states: State at the beginning and at the end.
        timing: Options, method "jerk_limited": shares of the limits.
        overrides: Limits (n,) by quantity, in place of the robot's.
        chain: The robot; without one the limits have to be given.
        synchronization: Same as in ``state_to_state``.

    Raises:
        MissingLimit: A limit that is needed is not known; the message names the joints.
        InvalidTrajectory: A state is malformed, or outside the limits of position.
        InvalidOption: A state can't be kept within the other limits.
        TimingFailed: There is no such motion, or none was found.
    """
    names, n = tuple(joint_names), len(joint_names)
    if chain is None:
        require_limits(required_limits(timing_method(timing.method)), names, overrides)
    limits = Limits.unlimited(n) if chain is None else chain.limits
    parametrization = chosen_parametrization(timing, names, limits, overrides, chain)
    bounds = np.stack([parametrization.bounds[q] for q in ("velocity", "acceleration", "jerk")])
    start, moved = _measured(states[0], chain, bounds)
    states = start, states[1]
    for label, state in zip(("from", "to"), states, strict=True):
        _check_position(label, names, state, limits)
    motion = state_to_state(names, *states, bounds, synchronization)
    certificate = certify_limits(motion, chain, parametrization.motion_limits)
    notes = moved
    given = np.concatenate([state.rows for state in states], axis=1)
    off = np.abs(without_rounding(given, np.tile(bounds, 2)) - given).max()
    if off > 0.0:
        rest = f"Speeds and accelerations below {AT_REST:g} of their limits count as rest"
        notes += (f"{rest}: the motion is up to {off:.3g} off there.",)
    if synchronization == "phase" and not _is_straight(motion, states):
        notes += ("The states allow no straight line: the joints arrive together, on a curve.",)
    report = TimingReport("jerk_limited", None, parametrization.bounds, parametrization.ruled)
    # The states' velocities would change with the time.
    needed = 1.0 if certificate.verified else None
    return Retimed(motion, certificate, 1.0, needed, notes, timing=report)


def _measured(
    state: JointState, chain: Chain | None, bounds: Array
) -> tuple[JointState, tuple[str, ...]]:
    """A measured state moved onto the limits that it is hardly outside, with notes.

    Args:
        state: State as it was measured, n joints.
        chain: The robot; None where no positions are limited.
        bounds: Bounds of velocity, acceleration and jerk, shape (3, n).
    """
    given = state.rows
    if given.shape[1] != bounds.shape[1]:
        return state, ()  # said with the names of the joints
    position = given[0] if chain is None else snap_to_limits(chain, given[0], None)[0]
    taken = [position, *(rates_onto_limits(*pair) for pair in zip(given[1:], bounds, strict=False))]
    notes: tuple[str, ...] = ()
    for name, asked, row in zip(
        ("position", "velocity", "acceleration"), given, taken, strict=True
    ):
        notes += moved_note(f"{name} of from", asked, row)
    return (JointState(*taken), notes) if notes else (state, ())


def _check_position(label: str, names: Sequence[str], state: JointState, limits: Limits) -> None:
    if len(state.position) != len(names):
        raise InvalidTrajectory(
            f"{label}.position has {len(state.position)} value(s) in place of {len(names)}",
            hint=f"The joints are: {', '.join(names)}; give one value for each.",
        )
    for j, (name, q) in enumerate(zip(names, state.position, strict=True)):
        lower, upper = float(limits.lower[j]), float(limits.upper[j])
        if q < lower - RATIO_TOLERANCE or q > upper + RATIO_TOLERANCE:
            limit = lower if q < lower else upper
            raise InvalidTrajectory(
                f"{label}: {position_excess(name, float(q), limit)}",
                hint="Give a state inside the joint's limits.",
                joint=name,
                value=float(q),
                limit=limit,
            )


def _is_straight(motion: Trajectory, states: tuple[JointState, JointState]) -> bool:
    """Whether a motion stays on the line between its ends."""
    way = states[1].position - states[0].position
    length = float(np.linalg.norm(way))
    if not length > 0.0:
        return motion.pieces == 1 and motion.degree == 0
    direction = way / length
    times = np.linspace(0.0, motion.duration, 8 * motion.pieces + 1)
    off = motion.sample(times) - states[0].position
    off -= np.outer(off @ direction, direction)
    # A motion counts as straight where it leaves the line by less than this part of its way [-].
    return bool(np.linalg.norm(off, axis=1).max() <= 1e-9 * length)
