"""Motion along a path at a constant speed wherever the limits allow it, slower where they do not.

Each piece of the path has a largest speed: that asked for, or less where the joints' velocity
|q'| v, acceleration |q''| v^2 or jerk |q'''| v^3 would be above a limit. Neighbouring pieces of
nearly equal ones are run through at one speed. From one speed to the next lead ramps of at most
three phases of constant jerk, all on the faster side. On a ramp to the speed v

    |d2q/dt2| <= |q'| a + |q''| v^2,    |d3q/dt3| <= |q'| j + 3 |q''| v a + |q'''| v^3,

so that an a and a j with which these are within the limits are known for any part of the path. A
stretch that is too short for its ramps is run through more slowly.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from kinematics.arrays import Array
from kinematics.trajectory.polynomial import composed_pieces
from kinematics.trajectory.trajectory import Trajectory
from planning.timing.jerk.double_s import MAX_PHASES, are_same, ramp_length, write_ramp
from planning.timing.path.path import JointPath
from planning.timing.time_scaling import ScaledTime, dilate

#: Share of the limits of acceleration and jerk that constant speeds may use: the rest is for ramps.
_SHARE = 0.9
#: Two places of a path nearer than this part of it are one.
_SAME_PLACE = 1e-12


class SteadyMotion(NamedTuple):
    """A motion at steady speeds.

    Args:
        timed: The motion.
        speeds: ds/dt of each stretch that is run through at one speed.
    """

    timed: ScaledTime
    speeds: tuple[float, ...]


class _Ramp(NamedTuple):
    """A change of speed with no acceleration at its ends.

    Args:
        low: Lower speed.
        limits: Higher speed, largest acceleration and largest jerk, shape (3,).
        length: Way that the ramp takes.
    """

    low: float
    limits: Array
    length: float


@dataclass(frozen=True, slots=True, eq=False)
class _Rates:
    """Largest derivatives of a path's pieces, and the limits of the joints.

    Args:
        lengths: Lengths of the pieces, shape (p,).
        first: Largest |q'|, shape (p, n).
        second: Largest |q''|, likewise.
        third: Largest |q'''|, likewise.
        limits: Limits of velocity, acceleration and jerk, shape (3, n).
    """

    lengths: Array
    first: Array
    second: Array
    third: Array
    limits: Array

    @classmethod
    def of(cls, path: JointPath, limits: Array) -> "_Rates":
        """Speed caps of a path of degree 3 at most."""
        c, ends = path.coefficients, path.lengths[:, None]
        c = np.concatenate([c, np.zeros((*c.shape[:2], max(0, 4 - c.shape[2])))], axis=2)
        with np.errstate(divide="ignore", invalid="ignore"):
            vertex = np.clip(np.nan_to_num(-c[..., 2] / (3.0 * c[..., 3])), 0.0, ends)
        places = (0.0 * vertex, vertex, ends + 0.0 * vertex)
        slopes = [np.abs(c[..., 1] + (2.0 * c[..., 2] + 3.0 * c[..., 3] * u) * u) for u in places]
        bends = [np.abs(2.0 * c[..., 2] + 6.0 * c[..., 3] * u) for u in places]
        first, second = np.max(slopes, axis=0), np.max(bends, axis=0)
        return cls(path.lengths, first, second, np.abs(6.0 * c[..., 3]), limits)

    def caps_by_limit(self, share: float) -> Array:
        """Largest constant speed of each piece by each limit, shape (p, 3, n).

        Args:
            share: Share of the limits of acceleration and jerk that may be used.
        """
        velocity, acceleration, jerk = self.limits
        with np.errstate(divide="ignore"):
            by_velocity = velocity / self.first
            by_acceleration = (share * acceleration / self.second) ** 0.5
            by_jerk = (share * jerk / self.third) ** (1.0 / 3.0)
        return np.stack([by_velocity, by_acceleration, by_jerk], axis=1)

    def ramp(self, pieces: Sequence[int], low: float, high: float) -> _Ramp | None:
        """The ramp at the beginning of some pieces, in their order; None where it has no room."""
        first = second = third = np.zeros(self.limits.shape[1])
        room = 0.0
        for k in pieces:
            first, second = np.maximum(first, self.first[k]), np.maximum(second, self.second[k])
            third, room = np.maximum(third, self.third[k]), room + float(self.lengths[k])
            ramp = self._ramp(first, second, third, low, high)
            if ramp.length <= room:
                return ramp
        return None

    def _ramp(self, first: Array, second: Array, third: Array, low: float, high: float) -> _Ramp:
        """The ramp where the derivatives are at most these, each of shape (n,)."""
        _, acceleration, jerk = self.limits
        room = jerk - third * high**3
        with np.errstate(divide="ignore"):
            straight = (acceleration - second * high**2) / first
            # Part of a ramp's room for jerk that its acceleration may take where the path bends.
            bent = 0.5 * room / (3.0 * second * high)
        a = float(np.minimum(straight, bent).min())
        with np.errstate(divide="ignore"):
            j = float(((room - 3.0 * second * high * a) / first).min())
        return _Ramp(low, np.array([high, a, j]), ramp_length(low, high, a, j))


@dataclass(slots=True)
class _Stretch:
    """Pieces that are run through at one speed.

    Args:
        first: The first of them.
        last: The one after the last.
        speed: ds/dt.
    """

    first: int
    last: int
    speed: float


def speed_caps(path: JointPath, limits: Array, share: float = _SHARE) -> Array:
    """Largest constant ds/dt on each of a path's p pieces by each limit of each joint.

    Args:
        path: Path of degree at most 3.
        limits: Limits of velocity, acceleration and jerk, inf for none, shape (3, n).
        share: Share of the limits of acceleration and jerk that may be used.

    Returns:
        Shape (p, 3, n); inf where a limit allows any.
    """
    return _Rates.of(path, limits).caps_by_limit(share)


def time_at_steady_speed(
    path: JointPath,
    joint_names: Sequence[str],
    limits: Array,
    wanted: Array,
    variation: float,
) -> SteadyMotion | None:
    """A path run through from rest to rest at speeds as constant as its limits allow.

    Args:
        path: Path to follow, of degree at most 3, without sharp corners.
        joint_names: n names.
        limits: Limits of velocity (inf for none), acceleration and jerk, shape (3, n).
        wanted: ds/dt asked for on each piece, shape (p,).
        variation: Largest difference of the speeds of neighbouring pieces that are run through at
            one, the lowest of them, as part of the highest.

    Returns:
        The motion; None where there is no room for its ramps.
    """
    rates = _Rates.of(path, limits)
    stretches = _stretches(
        np.minimum(wanted, rates.caps_by_limit(_SHARE).min(axis=(1, 2))), variation
    )
    ramps = _fit(stretches, rates)
    if ramps is None:
        return None
    phases = _split(np.concatenate(_phases(path, stretches, ramps)), path.breaks)
    owners = np.searchsorted(path.breaks, phases[:, 0] + _SAME_PLACE * path.length, side="right")
    owners = np.clip(owners - 1, 0, len(path.lengths) - 1).astype(np.int64)
    phases[:, 0] -= path.breaks[owners]
    pieces = composed_pieces(path.coefficients, owners, phases, 3)
    times = np.concatenate([[0.0], np.cumsum(phases[:, 4])])
    motion = Trajectory(tuple(joint_names), times, pieces)
    return SteadyMotion(dilate(motion, *limits), tuple(one.speed for one in stretches))


def _stretches(caps: Array, variation: float) -> list[_Stretch]:
    """Neighbouring pieces of nearly equal largest speeds."""
    stretches = [_Stretch(0, 1, float(caps[0]))]
    most = float(caps[0])
    for k, cap in enumerate(caps[1:].tolist(), start=1):
        one = stretches[-1]
        if min(one.speed, cap) >= (1.0 - variation) * max(most, cap):
            one.last, one.speed, most = k + 1, min(one.speed, cap), max(most, cap)
        else:
            stretches.append(_Stretch(k, k + 1, cap))
            most = cap
    return stretches


def _fit(stretches: list[_Stretch], rates: _Rates) -> list[tuple[_Ramp | None, ...]] | None:
    """Ramps at both ends of each stretch, which is made slower where they have no room."""
    # A stretch is made slower so often at most.
    for _ in range(200):
        ramps = []
        for k, one in enumerate(stretches):
            fitting = _ramps(stretches, k, rates)
            if fitting is None:
                _slow_down(stretches, k, one)
                break
            ramps.append(fitting)
        else:
            return ramps
    return None


def _speeds_beside(stretches: list[_Stretch], k: int) -> tuple[float, float]:
    """Speeds before and after a stretch, 0 at the ends of the path."""
    before = stretches[k - 1].speed if k > 0 else 0.0
    after = stretches[k + 1].speed if k + 1 < len(stretches) else 0.0
    return before, after


def _ramps(stretches: list[_Stretch], k: int, rates: _Rates) -> tuple[_Ramp | None, ...] | None:
    """Ramps of a stretch from and to slower ones beside it; None where they have no room."""
    one, made, way = stretches[k], [], 0.0
    pieces = range(one.first, one.last)
    for low, order in zip(_speeds_beside(stretches, k), (pieces, pieces[::-1]), strict=True):
        ramp = None
        if low < one.speed and not are_same(low, one.speed):
            ramp = rates.ramp(order, low, one.speed)
            if ramp is None:
                return None
            way += ramp.length
        made.append(ramp)
    return tuple(made) if way <= float(rates.lengths[one.first : one.last].sum()) else None


def _slow_down(stretches: list[_Stretch], k: int, one: _Stretch) -> None:
    """Make a stretch slower, or one with the faster of the slower ones beside it."""
    beside = _speeds_beside(stretches, k)
    slower = [speed if speed < one.speed else -1.0 for speed in beside]
    # A stretch that is too short for its ramps is made slower by this factor.
    one.speed *= 0.9
    if one.speed > max(slower):
        return
    other = stretches.pop(k - 1 if slower[0] >= slower[1] else k + 1)
    one.first, one.last = min(one.first, other.first), max(one.last, other.last)
    one.speed = other.speed


def _phases(
    path: JointPath, stretches: list[_Stretch], ramps: list[tuple[_Ramp | None, ...]]
) -> list[Array]:
    """(place, speed, acceleration / 2, jerk / 6, duration) of the phases, stretch by stretch."""
    breaks, rows = path.breaks, []
    for one, (rising, falling) in zip(stretches, ramps, strict=True):
        begin, end = float(breaks[one.first]), float(breaks[one.last])
        room, used = np.empty((MAX_PHASES, 5)), 0
        # A phase, or a stretch between ramps, that takes less than this part of it is rounding.
        least = 1e-12 * (end - begin) / one.speed
        if rising is not None:
            used = write_ramp(begin, rising.low, one.speed, rising.limits, least, room, used)
            begin += rising.length
        leave = end - (0.0 if falling is None else falling.length)
        if leave - begin > least * one.speed:
            room[used] = begin, one.speed, 0.0, 0.0, (leave - begin) / one.speed
            used += 1
        if falling is not None:
            used = write_ramp(leave, one.speed, falling.low, falling.limits, least, room, used)
        rows.append(room[:used])
    return rows


def _split(phases: Array, breaks: Array) -> Array:
    """The phases, cut where they pass from one piece of the path to the next."""
    near = _SAME_PLACE * float(breaks[-1])
    ends = np.append(phases[1:, 0], breaks[-1])
    rows: list[NDArray[np.float64]] = []
    for phase, end in zip(phases, ends, strict=True):
        inside = breaks[(breaks > phase[0] + near) & (breaks < end - near)]
        cuts = [0.0, *(_time_at(phase, float(place)) for place in inside), float(phase[4])]
        starts = [float(phase[0]), *inside.tolist()]
        for start, begin, until in zip(starts, cuts[:-1], cuts[1:], strict=True):
            _, v, half, sixth, _ = phase
            speed = v + (2.0 * half + 3.0 * sixth * begin) * begin
            rows.append(np.array([start, speed, half + 3.0 * sixth * begin, sixth, until - begin]))
    return np.array(rows)


def _time_at(phase: Array, place: float) -> float:
    """Time at which a phase is at a place within it."""
    start, v, half, sixth, duration = (float(value) for value in phase)
    if half == sixth == 0.0:
        return (place - start) / v
    return float(
        scipy.optimize.brentq(
            lambda t: start + (v + (half + sixth * t) * t) * t - place, 0.0, duration, xtol=1e-15
        )
    )
