"""Exciting motions: those from whose logs the parameters of an arm are found best, certified."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dynamics.identification.unknowns import DRIVES, Drive, Unknowns, with_believed_bodies
from dynamics.inverse import inverse_dynamics
from kinematics.arrays import Array, typed
from kinematics.errors import InvalidOption
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory, interpolate
from obstacles.collision.checker import Checker
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.proof.certificate import Certificate, certify
from planning.result import Failure
from planning.values.deadline import Deadline
from planning.values.limits import EffortLimits, MotionLimits

#: Share of every limit that a motion uses on the instants that are looked at.
_USED = 0.95
#: Instants of a period that are looked at for each harmonic.
_INSTANTS = 24
#: Share of the time that is left which the search takes at most; the rest is for the proof.
_SEARCH = 0.6
#: Series that are drawn before the best of them is improved.
_DRAWN = 40
#: Amplitudes fall by this factor, so often, where a motion is not free or a torque is too large.
_SMALLER, _SHRINKS = 0.75, 10
#: First and least step of the search, in amplitudes, and its factors after a step that helps and
#: after another: where one in five helps the steps stay as long as they are.
_STEP, _LEAST_STEP, _LONGER, _SHORTER = 0.3, 0.02, 1.5, 0.904


@dataclass(frozen=True, slots=True)
class ExcitationOptions:
    """Options of exciting motions.

    Args:
        period: Time after which the motion is where it began [s].
        harmonics: Number of sines and cosines for each joint.
        drives: Parameters of the drives that are to be found too.
        velocity_scaling: Share of the velocity limits that is used, above 0 and up to 1.
        acceleration_scaling: Share of the acceleration limits, likewise.
        margin: Distance to keep from obstacles beyond their own margins [m].
        evaluations: Series that are tried.
        seed: Seed of the search.

    Raises:
        InvalidOption: A value is out of its range.
    """

    period: float = 10.0
    harmonics: int = 5
    drives: Sequence[Drive] = tuple(DRIVES)
    velocity_scaling: float = 1.0
    acceleration_scaling: float = 1.0
    margin: float = 0.0
    evaluations: int = 600
    seed: int = 0

    def __post_init__(self) -> None:
        scalings = (self.velocity_scaling, self.acceleration_scaling)
        sound = 0.0 < self.period < np.inf and all(0.0 < share <= 1.0 for share in scalings)
        if not sound or not 3 <= self.harmonics <= 20 or not 1 <= self.evaluations <= 100_000:
            raise InvalidOption(
                "an exciting motion needs a positive period, scalings above 0 and up to 1, 3 to 20 "
                "harmonics and 1 to 100000 evaluations"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Excitation:
    """An exciting motion.

    Args:
        trajectory: Motion of one period, from rest to rest at the same place: quintic polynomials.
        certificate: Its proof.
        condition: Condition number of the base regressor along it, its columns scaled to length 1,
            the torque of each joint in units of its limit.
        names: Base parameters that logs of it determine.
    """

    trajectory: Trajectory
    certificate: Certificate
    condition: float
    names: tuple[str, ...]


@typed
def excite(
    robot: RobotGeometry,
    scene: Scene | None = None,
    start: ArrayLike | None = None,
    options: ExcitationOptions | None = None,
    *,
    deadline: Deadline | None = None,
) -> Excitation | Failure:
    """Find and prove a motion whose logs determine the parameters of an arm.

    Each joint follows a Fourier series through the start, at rest there. Series are drawn and the
    best one improved step by step.

    Args:
        robot: The robot with its geometry.
        scene: The obstacles; none where left out.
        start: Where the motion begins and ends, shape (n,) [rad or m]; the middle of the limits
            where none is given.
        options: Period, harmonics, shares of the limits and seed.
        deadline: Instant at which the search ends with what it has.

    Raises:
        InvalidRobotState: The start has the wrong length or is not finite.
        InvalidOption: A value is out of its range.
        MissingLimit: A velocity or acceleration limit is not known.
    """
    given = options or ExcitationOptions()
    cell = scene or Scene()
    chain = robot.chain
    lower, upper = chain.sampling_bounds()
    q0 = 0.5 * (lower + upper) if start is None else chain.state(start, "start")
    checker = Checker.of(robot, cell, given.margin)
    if (q0 < chain.limits.lower).any() or (q0 > chain.limits.upper).any() or not checker.valid(q0):
        return Failure(
            "START_STATE_INVALID",
            "the start of the exciting motion collides, or is outside the limits",
            "Give a start that is free, with room about it.",
            "excitation",
        )
    search = _Search.of(chain, q0, given, checker)
    ends = None if deadline is None else deadline.at_most(_SEARCH * deadline.remaining)
    best, condition = _improved(search, given, ends)
    while np.isfinite(condition):
        motion = search.trajectory(best)
        certificate = certify(
            motion, robot, cell, margin=given.margin, limits=search.limits, deadline=deadline
        )
        if certificate.verified:
            names = search.unknowns.base.names
            return Excitation(motion, certificate, search.condition(best), names)
        if (deadline is not None and deadline.passed) or np.abs(best).max() < 1e-3:
            break
        best = 0.9 * best
    return Failure(
        "PLANNING_FAILED",
        "no exciting motion about this start was proved free and within the limits",
        "Give a start with more room about it, a longer period, or a longer timeout.",
        "excitation",
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """What series are measured by.

    Args:
        unknowns: Parameters to be found.
        start: Shape (n,).
        period: [s].
        waves: Harmonics of each series and their two derivatives at the instants, (3, m, 2 h): all
            are at rest, and 0, at the start.
        room: Least and largest positions, shape (2, n).
        bounds: Largest velocity and acceleration, and jerk where it is known, shape (3, n).
        effort: Torque limits; infinite where there are none, shape (n,).
        checker: Of collisions.
    """

    unknowns: Unknowns
    start: Array
    period: float
    waves: Array
    room: Array
    bounds: Array
    effort: Array
    checker: Checker

    @classmethod
    def of(
        cls, chain: Chain, start: Array, given: ExcitationOptions, checker: Checker
    ) -> "_Search":
        unknowns = Unknowns(with_believed_bodies(chain)[0], tuple(given.drives))
        limits, names = chain.limits, chain.joint_names
        effort = np.where(limits.effort > 0.0, limits.effort, np.inf)
        jerk = np.where(limits.jerk > 0.0, limits.jerk, np.inf)
        return cls(
            unknowns,
            start,
            given.period,
            _waves(given.period, given.harmonics),
            np.array([np.maximum(limits.lower, start - np.pi),
                      np.minimum(limits.upper, start + np.pi)]),
            np.array([
                given.velocity_scaling * limits.require("velocity", names),
                given.acceleration_scaling * limits.require("acceleration", names),
                jerk,
            ]),
            effort,
            checker,
        )  # fmt: skip

    @property
    def limits(self) -> MotionLimits:
        """Limits that the proof holds the motion to."""
        chain, names = self.unknowns.chain, ("velocity", "acceleration", "jerk")
        effort = EffortLimits(chain, self.effort) if np.isfinite(self.effort).any() else None
        return MotionLimits(dict(zip(names, self.bounds, strict=True)), effort)

    def states(self, series: Array) -> Array:
        """Position and three derivatives of a series (2 h, n), shape (4, m, n)."""
        found = self.waves @ series
        found[0] += self.start
        return np.asarray(found)

    def fitted(self, series: Array) -> Array | None:
        """A series (2 h, n) with amplitudes that fit; None where none are free."""
        moved = self.waves @ series
        above, below = moved[0].max(axis=0), -moved[0].min(axis=0)
        peaks = np.abs(moved[1:]).max(axis=1)
        room = np.array([self.room[1] - self.start, self.start - self.room[0], *self.bounds])
        needed = np.maximum([above, below, *peaks], 1e-9)  # some go one way only
        fits = np.min(room / needed, axis=0)
        series = series * np.minimum(_USED * fits, 1.0 / np.abs(series).max(axis=0) * np.pi)
        for _ in range(_SHRINKS):
            q, qd, qdd, _ = self.states(series)
            torques = inverse_dynamics(self.unknowns.chain, q, qd, qdd)
            if (np.abs(torques) <= _USED * self.effort).all() and self.checker.all_valid(q):
                return np.asarray(series)
            series = _SMALLER * series
        return None

    def condition(self, series: Array) -> float:
        """Condition number of the base regressor, its columns scaled to length 1."""
        q, qd, qdd, _ = self.states(series)
        base = self.unknowns.base
        Y = base.regressor(self.unknowns.regressor(q, qd, qdd))
        W = (Y / np.where(np.isfinite(self.effort), self.effort, 1.0)[:, None]).reshape(
            -1, base.count
        )
        W = W / np.maximum(np.linalg.norm(W, axis=0), 1e-300)
        least, *_, largest = np.linalg.eigvalsh(W.T @ W)
        return float(np.sqrt(largest / max(least, 1e-300)))

    def trajectory(self, series: Array) -> Trajectory:
        """The motion of a series as quintic polynomials from instant to instant."""
        q, qd, qdd, _ = self.states(series)
        times = np.linspace(0.0, self.period, len(q))
        names = self.unknowns.chain.joint_names
        return interpolate(names, times, q, "quintic", qd, qdd)


def _waves(period: float, harmonics: int) -> Array:
    """Waves that are 0 and at rest at the start: harmonics less a part of the first ones."""
    k = np.arange(1, harmonics + 1)
    w = 2.0 * np.pi / period * k
    t = np.linspace(0.0, period, _INSTANTS * harmonics + 1)
    angle = np.outer(t, w)
    S, C = np.sin(angle) / k, np.cos(angle) / k
    sines = np.array([S, C * w, -S * w**2, -C * w**3])
    cosines = np.array([C, -S * w, -C * w**2, S * w**3])
    # Velocities at the start are w / k of the sines, alike for all; accelerations w^2 / k = w w_1.
    sines = sines[..., 1:] - sines[..., :1]
    cosines = cosines[..., 1:] - cosines[..., :1] * k[1:]
    cosines[0] -= cosines[0, :1]
    return np.concatenate([sines, cosines], axis=-1)


def _improved(
    search: _Search, given: ExcitationOptions, deadline: Deadline | None
) -> tuple[Array, float]:
    """The best series that was found, and its cost; infinite where none fits."""
    rng = np.random.default_rng(given.seed)
    shape = (search.waves.shape[-1], len(search.start))
    best, least, step = np.zeros(shape), np.inf, _STEP
    for i in range(given.evaluations):
        if deadline is not None and deadline.passed:
            break
        drawn = rng.standard_normal(shape)
        size = np.abs(best).max(axis=0)
        refine = i >= min(_DRAWN, given.evaluations // 3) and np.isfinite(least)
        series = search.fitted(best + step * size * drawn if refine else drawn)
        cost = np.inf if series is None else search.condition(series)
        better = cost < least
        if refine:
            step = max(step * (_LONGER if better else _SHORTER), _LEAST_STEP)
        if series is not None and better:
            best, least = series, cost
    return best, least
