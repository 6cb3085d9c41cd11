"""Proposals of motions, and the motions that they become from a state on, at any scale.

A motion is slowed down along its own path: its time runs slower by the scale. Where it begins at
full speed it can't be slower at once: its speed then falls from 1 to the scale by a cubic, whose
derivative is 0 at both ends, so that velocity and acceleration stay continuous. Velocities are
scaled themselves, and the joints change theirs as quickly as their limits allow.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import scipy

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidOption, InvalidTrajectory
from kinematics.model.chain import Chain
from kinematics.trajectory.polynomial import composed_pieces
from kinematics.trajectory.trajectory import INTERPOLATIONS, Trajectory, concatenate, interpolate
from kinematics.velocity import joint_velocities
from planning.stops.braking import BrakingLimits
from planning.stops.stop_family import braking_motion, state_at, taylor

#: Time after which the joint velocities of a twist are worked out anew [s].
_TWIST_STEP = 0.02
#: The longest proposal [s], and how many samples one may have.
MAX_DURATION = 60.0
MAX_SAMPLES = 2_000
#: Degree of pieces that requests may have.
_MOST_DEGREE = 15
#: Velocities that are at rest [rad/s or m/s].
AT_REST = 1e-9


class Proposal(Protocol):
    """A motion that somebody is about to send."""

    #: Whether a slower motion keeps to the path of the faster one.
    keeps_path: bool

    def motion(self, chain: Chain, state: Array, limits: BrakingLimits, scale: float) -> Trajectory:
        """The motion that it becomes.

        Args:
            chain: The robot.
            state: Position, velocity and acceleration it begins with, shape (3, n).
            limits: Limits that velocities change at.
            scale: Share of its speed, above 0 and at most 1.

        Raises:
            InvalidTrajectory: It is none of this robot's.
            InvalidOption: It is malformed, or can't be run at this scale.
        """


@dataclass(frozen=True, slots=True, eq=False)
class TrajectoryProposal:
    """A timed motion from the state on.

    Args:
        trajectory: The motion; it begins where the state is.
    """

    trajectory: Trajectory
    keeps_path = True

    def __post_init__(self) -> None:
        _check_duration(self.trajectory.duration)

    def motion(
        self,
        chain: Chain,
        state: Array,  # noqa: ARG002  (it is compared with the begin by the gate)
        limits: BrakingLimits,
        scale: float,
    ) -> Trajectory:
        """As ``Proposal.motion``."""
        motion = self.trajectory
        if motion.joint_names != chain.joint_names:
            raise InvalidTrajectory(
                f"the proposal is of the joints {', '.join(motion.joint_names)}",
                hint=f"Robot {chain.name!r} has, in this order: {', '.join(chain.joint_names)}.",
            )
        return slowed(motion, limits, scale)


@dataclass(frozen=True, slots=True, eq=False)
class SamplesProposal:
    """Targets at even times, as policies answer them; the first is reached after one period.

    "natural_spline" and "clamped_spline" begin with the velocity of the state.

    Args:
        positions: Shape (m, n) [rad or m].
        period: Time between two of them [s].
        interpolation: One of ``kinematics.trajectory.trajectory.INTERPOLATIONS``.
        velocities: Shape (m, n), for "cubic" and "quintic" [rad/s or m/s].
        accelerations: Shape (m, n), for "quintic" [rad/s^2 or m/s^2].
    """

    positions: Array
    period: float
    interpolation: str
    velocities: Array | None = None
    accelerations: Array | None = None
    keeps_path = True

    def __post_init__(self) -> None:
        for name in ("positions", "velocities", "accelerations"):
            given = getattr(self, name)
            if given is not None:
                object.__setattr__(self, name, frozen(given))
        if self.positions.ndim != 2 or not 0 < len(self.positions) <= MAX_SAMPLES:
            raise InvalidOption(
                f"samples have the shape {self.positions.shape}",
                hint=f"Give 1 to {MAX_SAMPLES} rows, one value for each joint.",
            )
        if not self.period > 0.0:
            raise InvalidOption(f"the period is {self.period} s", hint="Give a positive number.")
        _check_duration(self.period * len(self.positions))
        if self.interpolation not in INTERPOLATIONS:
            raise InvalidOption(
                f"there is no interpolation {self.interpolation!r}",
                hint=f"Choose one of: {', '.join(INTERPOLATIONS)}.",
            )

    def motion(self, chain: Chain, state: Array, limits: BrakingLimits, scale: float) -> Trajectory:
        """As ``Proposal.motion``."""
        if self.positions.shape[1] != chain.n:
            raise InvalidTrajectory(
                f"samples have {self.positions.shape[1]} value(s) each, robot {chain.name!r} has "
                f"{chain.n} joints",
                hint=f"The order is: {', '.join(chain.joint_names)}.",
            )
        rows = [
            None if given is None else np.concatenate([state[order : order + 1], given])
            for order, given in enumerate((self.positions, self.velocities, self.accelerations))
        ]
        assert rows[0] is not None
        times: Array = self.period * np.arange(float(len(rows[0])))
        if self.interpolation.endswith("_spline"):
            end = 1 if self.interpolation == "clamped_spline" else 2
            still = np.zeros(chain.n)
            ends: Any = ((1, state[1]), (end, still))
            c = np.moveaxis(
                scipy.interpolate.CubicSpline(times, rows[0], bc_type=ends).c[::-1], 0, 2
            )
            made = Trajectory(chain.joint_names, times, c)
        else:
            made = interpolate(chain.joint_names, times, rows[0], self.interpolation, *rows[1:])
        return slowed(made, limits, scale)


@dataclass(frozen=True, slots=True, eq=False)
class VelocityProposal:
    """Joint velocities to be held, as a joystick gives them.

    Args:
        velocities: Shape (n,) [rad/s or m/s].
        duration: How long they are held, from the state on [s].
    """

    velocities: Array
    duration: float
    keeps_path = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "velocities", frozen(self.velocities))
        _check_duration(self.duration)

    def motion(self, chain: Chain, state: Array, limits: BrakingLimits, scale: float) -> Trajectory:
        """As ``Proposal.motion``."""
        wanted = chain.configuration(self.velocities, "joint_velocities")
        return braking_motion(chain.joint_names, state, limits, scale * wanted, self.duration)


@dataclass(frozen=True, slots=True, eq=False)
class TwistProposal:
    """A twist of the tool or a link to be held; joint velocities follow it every 20 ms.

    Args:
        twist: Velocity and angular velocity in the root frame, shape (6,) [m/s, rad/s].
        duration: How long it is held, from the state on [s].
        link: The link; the tip where None.
    """

    twist: Array
    duration: float
    link: str | None = None
    keeps_path = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "twist", frozen(self.twist))
        _check_duration(self.duration)

    def motion(self, chain: Chain, state: Array, limits: BrakingLimits, scale: float) -> Trajectory:
        """As ``Proposal.motion``."""
        count = max(int(np.ceil(self.duration / _TWIST_STEP - 1e-9)), 1)
        span, parts = self.duration / count, []
        for _ in range(count):
            wanted = joint_velocities(chain, state[0], scale * self.twist, link=self.link)
            rates = wanted.joint_velocities
            parts.append(braking_motion(chain.joint_names, state, limits, rates, span))
            state = state_at(parts[-1])
        return concatenate(parts)


def slowed(motion: Trajectory, limits: BrakingLimits, scale: float) -> Trajectory:
    """A motion along the same path, slower by a scale; at full speed still where it begins moving.

    Args:
        motion: The motion.
        limits: Limits that the joints slow down at.
        scale: Share of its speed.

    Raises:
        InvalidOption: It is over before it could be slower.
    """
    if scale == 1.0:
        return motion
    speed = np.abs(motion.coefficients[0, :, 1]) if motion.degree else np.zeros(motion.n)
    if speed.max() <= AT_REST:
        return motion.dilate(1.0 / scale)
    fastest = motion.peaks(1).value
    # Half of what limits allow: the path itself takes a part.
    less = 1.0 - scale
    span = float(np.max(3.0 * less * fastest / limits.acceleration))
    span = max(span, float(np.max(np.sqrt(12.0 * less * fastest / limits.jerk))))
    # The motion's own time is s = t - less (u^3 - u^4 / 2) span with u = t / span; of polynomials
    # whose degree that would take too high s = t - less u^2 span / 2, whose acceleration jumps.
    passed, order = span * (1.0 - 0.5 * less), 4 if 4 * motion.degree <= _MOST_DEGREE else 2
    if passed >= motion.duration or order * motion.degree > _MOST_DEGREE:
        raise InvalidOption(f"the proposal is over before it could run at {scale:.3g} of its speed")
    head, tail = motion.split(passed)
    clock = np.array([0.0, 1.0, 0.0, -less / span**2, 0.5 * less / span**3])
    clock = clock if order == 4 else np.array([0.0, 1.0, -0.5 * less / span, 0.0])
    return concatenate([_run_by(head, clock, span), tail.dilate(1.0 / scale)])


def _run_by(motion: Trajectory, clock: Array, span: float) -> Trajectory:
    """A motion q(s(t)), 0 <= t <= span, with s of the coefficients (k,) and its whole duration."""
    breaks = [0.0]
    for instant in motion.breaks[1:-1].tolist():
        low, high = breaks[-1], span
        for _ in range(60):
            middle = 0.5 * (low + high)
            before = float(np.polynomial.polynomial.polyval(middle, clock)) < instant
            low, high = (middle, high) if before else (low, middle)
        breaks.append(0.5 * (low + high))
    breaks.append(span)
    begins = np.array(breaks[:-1])
    clocks = taylor(np.tile(clock, (len(begins), 1, 1)), begins)[:, 0]
    clocks[:, 0] -= motion.breaks[:-1]
    owners, phases = np.arange(len(begins)), np.ascontiguousarray(clocks)
    pieces = composed_pieces(motion.coefficients, owners, phases, len(clock) - 1)
    return Trajectory(motion.joint_names, np.array(breaks), pieces[..., : _MOST_DEGREE + 1])


def _check_duration(duration: float) -> None:
    if not 0.0 < duration <= MAX_DURATION:
        raise InvalidOption(
            f"the proposal takes {duration} s", hint=f"Give more than 0 and {MAX_DURATION:g} s."
        )
