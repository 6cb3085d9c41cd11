"""Logs of motions and torques, and the samples that an identification takes from them."""

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import ArrayLike

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain

#: Cutoff of the filter of a log whose velocities are not measured [Hz]: far above what exciting
#: motions contain, far below the noise of encoders.
_CUTOFF = 10.0
#: Order of the filter; it runs forwards and backwards, so that nothing is delayed.
_ORDER = 4
#: Times may be so far off a regular grid, in periods, before values are interpolated.
_JITTER = 1e-3
#: Instants at both ends that the filter spoils, in periods of its cutoff.
_SPOILED = 2.0
#: Fewest instants that are filtered and differentiated.
_FEWEST = 30
#: Positions so many ranges of their limits off, torques so many times theirs, and positions that
#: move by another multiple of what velocities say are in other units.
_RANGES, _EFFORTS, _SPEEDS = 1.0, 20.0, (0.5, 2.0)
#: Longest time without instants, over which values are interpolated [s], or so many periods.
_GAP, _GAPS = 0.05, 5.0


@dataclass(frozen=True, slots=True, eq=False)
class Log:
    """A log of one motion, or of poses at rest where it has no times.

    Args:
        positions: q, shape (m, n) [rad or m].
        torques: tau of the joints, shape (m, n) [N m or N].
        times: Instants, shape (m,), or the time from one to the next [s].
        velocities: q_dot, shape (m, n); derivatives of the positions where none are given.
        accelerations: q_ddot, shape (m, n); derivatives where none are given.
    """

    positions: ArrayLike
    torques: ArrayLike
    times: ArrayLike | None = None
    velocities: ArrayLike | None = None
    accelerations: ArrayLike | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """States of motion with their torques.

    Args:
        q: Positions, shape (m, n) [rad or m].
        qd: Velocities, shape (m, n).
        qdd: Accelerations, shape (m, n).
        tau: Torques, not filtered yet, shape (m, n) [N m or N].
        period: Time from one sample to the next [s]; 0 for poses at rest.
        cutoff: Cutoff of the filter [Hz]; None for none.
    """

    q: Array
    qd: Array
    qdd: Array
    tau: Array
    period: float = 0.0
    cutoff: float | None = None

    def reduce(self, values: Array) -> Array:
        """Values (m, ...) through the filter, of which as many are left as it leaves independent.

        Regressors and torques go through it alike: what is equal before is equal behind it.
        """
        if self.cutoff is None:
            return values
        step = max(1, int(0.5 / (self.cutoff * self.period)))
        ends = _spoiled(self.cutoff, self.period)
        return _smooth(values, self.cutoff, self.period)[ends : len(values) - ends : step]


def read_log(chain: Chain, log: Log, cutoff: float | None = None) -> Samples:
    """The samples of a log, its positions smoothed and differentiated where that is needed.

    Args:
        chain: The robot.
        log: The log.
        cutoff: Cutoff of the low-pass filter without delay [Hz]; where none is given 10 Hz, or no
            filter where velocities and accelerations are given.

    Raises:
        InvalidOption: Numbers of rows differ, times do not ascend, or the log is too short.
        InvalidRobotState: Rows have the wrong length or are not finite.
    """
    q = chain.configuration(log.positions, "positions").reshape(-1, chain.n)
    given = {
        name: None
        if getattr(log, name) is None
        else chain.configuration(getattr(log, name), name).reshape(-1, chain.n)
        for name in ("torques", "velocities", "accelerations")
    }
    for name, rows in given.items():
        if rows is not None and len(rows) != len(q):
            raise InvalidOption(
                f"a log has {len(q)} positions and {len(rows)} {name}",
                hint="Give one row of each for every instant.",
            )
    qd, qdd, tau = given["velocities"], given["accelerations"], given["torques"]
    if tau is None:
        raise InvalidOption("a log has no torques", hint="Give one row of them for every instant.")
    _check_sizes(chain, q, tau)
    if log.times is None:
        zero = np.zeros_like(q)
        return Samples(q, zero if qd is None else qd, zero if qdd is None else qdd, tau)
    times = _instants(log.times, len(q))
    if qd is not None:
        _check_speeds(times, q, qd)
    columns, period = _regular(times, [q, tau, *(x for x in (qd, qdd) if x is not None)])
    q, tau = columns[:2]
    qd = None if qd is None else columns[2]
    qdd = None if qdd is None else columns[-1]
    known = Samples(q, q if qd is None else qd, q if qdd is None else qdd, tau, period, cutoff)
    if qd is not None and qdd is not None and cutoff is None:
        return known
    known = replace(known, cutoff=_checked_cutoff(cutoff, period, len(q)))
    return _differentiated(known, qd is None, qdd is None)


def _check_sizes(chain: Chain, q: Array, tau: Array) -> None:
    """Refuse positions and torques that are in other units."""
    limits = chain.limits
    width = limits.upper - limits.lower
    off = np.maximum(q - limits.upper, limits.lower - q).max(axis=0)
    largest = np.abs(tau).max(axis=0)
    far = np.isfinite(width) & (off > _RANGES * width)
    strong = (limits.effort > 0.0) & (largest > _EFFORTS * limits.effort)
    for name, wrong, value, unit in (
        ("positions", far, np.abs(q).max(axis=0), "rad or m"),
        ("torques", strong, largest, "N m or N; currents are given as such, with gains"),
    ):
        if wrong.any():
            i = int(np.flatnonzero(wrong)[0])
            raise InvalidOption(
                f"{name} of joint {chain.joint_names[i]} are as large as {value[i]:.4g}, far "
                "beyond its limits",
                hint=f"Give them in {unit}; or mend the limits of the robot.",
            )


def _check_speeds(times: Array, q: Array, qd: Array) -> None:
    """Refuse velocities or times that do not go with the positions."""
    moved = scipy.integrate.cumulative_trapezoid(qd, times, axis=0, initial=0)
    square = float(np.sum(moved**2))
    share = float(np.sum(moved * (q - q[0]))) / max(square, 1e-300)
    least, most = _SPEEDS
    if square > 1e-2 * len(q) and not least < share < most:
        raise InvalidOption(
            f"positions of a log move {share:.3g} times as far as its velocities say",
            hint="Look at units and at the times, which are in seconds; or leave velocities out.",
        )


def _differentiated(known: Samples, needs_qd: bool, needs_qdd: bool) -> Samples:
    """Samples with smooth motions, and with the derivatives that they lack."""
    assert known.cutoff is not None
    t = known.period * np.arange(len(known.q))
    q = _smooth(known.q, known.cutoff, known.period)
    curve = scipy.interpolate.make_interp_spline(t, q, k=5)
    qd = curve(t, 1) if needs_qd else _smooth(known.qd, known.cutoff, known.period)
    if not needs_qdd:
        qdd = _smooth(known.qdd, known.cutoff, known.period)
    else:
        qdd = curve(t, 2) if needs_qd else scipy.interpolate.make_interp_spline(t, qd, k=5)(t, 1)
    return replace(known, q=q, qd=qd, qdd=qdd)


def _instants(times: ArrayLike, count: int) -> Array:
    values = np.array(times, dtype=np.float64)
    if values.ndim == 0:
        values = values * np.arange(count)
    if values.shape != (count,) or not np.isfinite(values).all() or (np.diff(values) <= 0.0).any():
        raise InvalidOption(
            f"times are not {count} ascending instants, one for each row of a log",
            hint="Give them in seconds, or one positive period.",
        )
    return values


def _regular(times: Array, columns: list[Array]) -> tuple[list[Array], float]:
    """Columns at regular instants, and the period [s]."""
    if len(times) < _FEWEST:
        raise InvalidOption(
            f"a log of a motion has {len(times)} instants",
            hint=f"Give at least {_FEWEST}; poses at rest have no times.",
        )
    period = float(times[-1] - times[0]) / (len(times) - 1)
    grid = times[0] + period * np.arange(len(times))
    if np.abs(times - grid).max() <= _JITTER * period:
        return columns, period
    gaps = np.diff(times)
    longest = int(gaps.argmax())
    if gaps[longest] > max(_GAP, _GAPS * period):
        raise InvalidOption(
            f"a log has no instants from {times[longest]:.6g} to {times[longest + 1]:.6g} s",
            hint="Give what was before and after as logs of their own.",
        )
    inside = np.clip(grid, times[0], times[-1])
    return [
        scipy.interpolate.make_interp_spline(times, rows, k=3)(inside) for rows in columns
    ], period


def _checked_cutoff(cutoff: float | None, period: float, count: int) -> float:
    highest = 0.4 / period
    value = min(_CUTOFF, 0.5 * highest) if cutoff is None else cutoff
    if not 0.0 < value <= highest:
        raise InvalidOption(
            f"the cutoff is {value:g} Hz, the log has {1.0 / period:.6g} instants a second",
            hint=f"Give at most {highest:.4g} Hz.",
        )
    if count < 2 * _spoiled(value, period) + _FEWEST:
        raise InvalidOption(
            f"a log of {count * period:.3g} s is too short for a filter of {value:g} Hz",
            hint="Give a longer log, or a higher cutoff.",
        )
    return value


def _spoiled(cutoff: float, period: float) -> int:
    return int(np.ceil(_SPOILED / (cutoff * period)))


def _smooth(values: Array, cutoff: float, period: float) -> Array:
    sections = scipy.signal.butter(_ORDER, cutoff, fs=1.0 / period, output="sos")
    return np.asarray(scipy.signal.sosfiltfilt(sections, values, axis=0))
