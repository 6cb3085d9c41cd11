"""Inverse kinematics by following a gradient, with its trace (course notes, lectures 15 and 16).

Two rules, each as a flow, integrated by the classical Runge-Kutta method, or step by step:

    pseudo_inverse   q_dot = J^+(q) K e      q <- q + J^+(q) K e
    transpose        q_dot = J^T(q) K e      q <- q + J^T(q) K e

Along the flow of the first e_dot = -K e: the error decays at the rate K in every direction, as long
as J has full row rank. The second descends on U = e^T K e / 2, with K = gamma the learning rate; it
needs no inverse and creeps along flat directions. Its steps take the gamma that is best for the
linear model where none is given.

e = x_d - x is counted in rotation vectors, or as in the notes in zyz Euler angles with their
analytic Jacobian, which does not exist where sin(theta) = 0. Only some axes of the target may
count, such as its position. Neither rule knows joint limits.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidOption, InvalidPose
from kinematics.forward import forward
from kinematics.ik.numeric.numeric import (
    AXES,
    ORIENTATION_TOLERANCE,
    POSITION,
    POSITION_TOLERANCE,
    Axis,
    check_axes,
)
from kinematics.ik.solution import IkSolution
from kinematics.jacobian import analytic_zyz, pose_and_jacobian
from kinematics.model.chain import Chain
from kinematics.pose import rotation_error, to_zyz

Rule = Literal["pseudo_inverse", "transpose"]
Form = Literal["flow", "step"]
Coordinates = Literal["rotation_vector", "zyz"]
RULES: tuple[Rule, ...] = get_args(Rule)
FORMS: tuple[Form, ...] = get_args(Form)
COORDINATES: tuple[Coordinates, ...] = get_args(Coordinates)

#: Steps of the flow by the pseudo-inverse, in units of 1 / K: in each e falls by exp(-0.1),
#: and the way of the joints is that of the equation to some 1e-6 rad.
_STEP = 0.1
#: Steps of the flow by the transpose, in units of 1 / (K s^2), with s the largest singular value.
_TRANSPOSE_STEP = 0.1
#: J J^T + this where J loses rank: without it a singular start would throw the arm anywhere.
_DAMPING = 1e-9
#: Smallest singular value of J, relative to the largest, down to which nothing is damped.
_FULL_RANK = 1e-5
#: |J^T K e| relative to its factors below which a point is stationary.
_STATIONARY = 1e-7
#: Evaluations of a flow with a duration at most: some seconds.
_MOST_EVALUATIONS = 50_000
#: Steps that are traced and taken at most.
STEPS = {"pseudo_inverse": 400, "transpose": 20_000}
#: The form of each rule where none is asked for.
_USUAL_FORM: dict[Rule, Form] = {"pseudo_inverse": "flow", "transpose": "step"}


@dataclass(frozen=True, slots=True, eq=False)
class GradientOptions:
    """Options of the gradient methods.

    Args:
        rule: "pseudo_inverse" or "transpose".
        coordinates: Coordinates that orientation errors are counted in.
        gain: K [1/s]: a number, or a matrix (r, r) for the r axes that count; gamma of the
            transpose. None for 1, and for the best of each step of the transpose.
        steps: Steps at most; None for 400 (pseudo-inverse) and 20,000 (transpose).
        duration: Time at which a flow ends, wherever it is then [s]; None to go on to the pose.
        form: "flow" or "step"; None for the flow of the pseudo-inverse and the step of the
            transpose.
        axes: Axes of the target that count. Where all three of position or of rotation do, their
            error is seen in the base frame, else in the target's own.

    Raises:
        InvalidOption: An unknown name, a gain that does not make the error decay or does not fit
            the axes, or no steps.
    """

    rule: Rule = "pseudo_inverse"
    coordinates: Coordinates = "rotation_vector"
    gain: float | ArrayLike | None = None
    steps: int | None = None
    form: Form | None = None
    axes: Collection[Axis] = AXES
    duration: float | None = None

    def __post_init__(self) -> None:
        choices = {"rule": RULES, "form": (None, *FORMS), "coordinates": COORDINATES}
        for name, known in choices.items():
            if getattr(self, name) not in known:
                raise InvalidOption(
                    f"{name} {getattr(self, name)!r} is unknown", hint=f"One of: {known}."
                )
        if self.steps is not None and self.steps < 1:
            raise InvalidOption(f"steps must be 1 at least, got {self.steps}")
        check_axes(self.axes)
        if self.coordinates == "zyz" and 0 < len(set(self.axes) & set(AXES[3:])) < 3:
            raise InvalidOption(
                "zyz angles count together or not at all",
                hint='Take all of "rx", "ry", "rz", or the coordinates "rotation_vector".',
            )
        if self.gain is not None:
            _check_gain(self.gain, self.rule, len(self.rows))
        if self.duration is not None:
            if not 0.0 < self.duration < math.inf:
                raise InvalidOption(f"duration must be positive, got {self.duration}")
            if not self.is_flow or self.steps is not None:
                raise InvalidOption(
                    "duration is that of a flow; steps are counted",
                    hint='Take the form "flow" and leave steps out, or leave duration out.',
                )

    @property
    def rows(self) -> list[int]:
        """Rows of the error that count, in the order x, y, z, rx, ry, rz."""
        return [i for i, axis in enumerate(AXES) if axis in self.axes]

    @property
    def is_flow(self) -> bool:
        """Whether a differential equation is integrated."""
        return (self.form or _USUAL_FORM[self.rule]) == "flow"

    @property
    def matrix(self) -> Array:
        """K, shape (r, r); the unit matrix where no gain is given."""
        r = len(self.rows)
        K = np.array(1.0 if self.gain is None else self.gain, dtype=np.float64)
        return K * np.eye(r) if K.ndim == 0 else K


def _check_gain(gain: object, rule: Rule, r: int) -> None:
    """Refuse a gain along which the error would not decay.

    Raises:
        InvalidOption: The gain is no positive number and no matrix (r, r) as the rule needs it.
    """
    try:
        K = np.array(gain, dtype=np.float64)
    except (TypeError, ValueError):
        K = np.array(np.nan)
    if K.ndim == 0:
        if not 0.0 < float(K) < math.inf:
            raise InvalidOption(f"gain must be positive, got {gain}")
        return
    if K.shape != (r, r) or not np.isfinite(K).all():
        raise InvalidOption(
            f"gain must be a positive number or a {r} x {r} matrix of finite numbers",
            hint="It has a row and a column for each of the axes that count.",
        )
    if rule == "transpose" and not np.array_equal(K, K.T):
        raise InvalidOption(
            "gain of the transpose must be symmetric: U = e^T K e / 2 has no other part",
            hint="Take (K + K^T) / 2.",
        )
    if float(np.linalg.eigvals(K).real.min()) <= 0.0:
        raise InvalidOption(
            "gain must have eigenvalues with positive real parts, else the error grows",
            hint="A diagonal matrix of positive numbers has.",
        )


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """Course of a gradient method, k + 1 points from the start on.

    Args:
        times: Times of the flow [s]; of steps their number, shape (k + 1,).
        joints: Configurations, shape (k + 1, n) [rad or m].
        errors: e of the r axes that count, shape (k + 1, r) [m or rad].
        position_error: Norm of its positions, shape (k + 1,) [m].
        orientation_error: Norm of its rotation vector, shape (k + 1,) [rad].
        converged: Whether the last point is inside the tolerances.
        stationary: Whether J^T K e vanishes at the last point, which neither rule leaves.
        damped: Whether J^+ was damped on the way, where J lost rank.
    """

    times: Array
    joints: Array
    errors: Array
    position_error: Array
    orientation_error: Array
    converged: bool
    stationary: bool = False
    damped: bool = False

    @property
    def solution(self) -> IkSolution:
        """The last point."""
        return IkSolution(
            frozen(self.joints[-1]),
            float(self.position_error[-1]),
            float(self.orientation_error[-1]),
            len(self.times) - 1,
        )


def follow(
    chain: Chain,
    target: ArrayLike,
    *,
    link: str | None = None,
    seed_joints: ArrayLike | None = None,
    options: GradientOptions | None = None,
    position_tolerance: float = POSITION_TOLERANCE,
    orientation_tolerance: float = ORIENTATION_TOLERANCE,
) -> Trace:
    """Follow the gradient from a configuration until it meets the tolerances or can't go on.

    It ends where the error is inside the tolerances, the gradient vanishes, or the steps are spent;
    a flow with a duration ends there alone.

    Args:
        chain: The robot.
        target: T_base_link, shape (4, 4).
        link: The link to bring there; the tip where none is named.
        seed_joints: The start, shape (n,); the middle of the limits where not given.
        options: Rule, coordinates, gain, axes and number of steps.
        position_tolerance: [m].
        orientation_tolerance: [rad].

    Raises:
        InvalidPose: ``target`` is no finite 4x4 matrix.
        InvalidRobotState: ``seed_joints`` has the wrong length or is not finite.
        InvalidLinkName: No such link.
        InvalidOption: zyz angles were asked for and do not exist on the way.
    """
    how = options or GradientOptions()
    T = np.array(target, dtype=np.float64)
    if T.shape != (4, 4) or not np.isfinite(T).all():
        raise InvalidPose("the target must be a finite 4x4 transform")
    low, high = chain.sampling_bounds()
    q = 0.5 * (low + high) if seed_joints is None else chain.configuration(seed_joints)
    K = how.matrix
    system = _System(chain, T, link, how, K, float(np.abs(np.linalg.eigvals(K)).max()))
    points, times, told = [q], [0.0], [system.errors(q)]
    while how.duration is None and len(points) <= (how.steps or STEPS[how.rule]):
        if told[-1].stationary or _done(told[-1], position_tolerance, orientation_tolerance):
            break
        q, interval = _runge_kutta(system, q) if how.is_flow else (_step(system, q), 1.0)
        points.append(q)
        times.append(times[-1] + interval)
        told.append(system.errors(q))
    if how.duration is not None:
        times, points = _flow_until(system, q, how.duration)
        told = [system.errors(q) for q in points]
    done = _done(told[-1], position_tolerance, orientation_tolerance)
    norms = np.array([item[:2] for item in told])
    errors = np.array([item.e for item in told])
    still = how.duration is None and told[-1].stationary
    return Trace(
        np.array(times), np.array(points), errors, norms[:, 0], norms[:, 1], done,
        still and not done, any(item.damped for item in told),
    )  # fmt: skip


class _Errors(NamedTuple):
    """The error at a configuration.

    Args:
        position: Norm of its positions [m].
        orientation: Norm of its rotation vector [rad], in zyz coordinates too.
        e: Error of the r axes that count, shape (r,) [m or rad].
        stationary: Whether J^T K e is nothing but rounding.
        damped: Whether J^+ is damped.
    """

    position: float
    orientation: float
    e: Array
    stationary: bool
    damped: bool


def _done(errors: _Errors, position: float, orientation: float) -> bool:
    return errors[0] <= position and errors[1] <= orientation


@dataclass(frozen=True, slots=True, eq=False)
class _System:
    """The error of a link's pose as a function of the joints, in the coordinates asked for.

    Args:
        chain: The robot.
        T: Target T_base_link, shape (4, 4).
        link: The link to bring there; None for the tip.
        options: Coordinates, axes and gain.
        K: The gain, shape (r, r).
        fastest: Largest size of its eigenvalues.
    """

    chain: Chain
    T: Array
    link: str | None
    options: GradientOptions
    K: Array
    fastest: float

    def errors(self, q: Array) -> _Errors:
        """The error at q (n,), and whether the rule is stationary or damped there."""
        J, e = self.jacobian(q)
        seen, positions = e, sum(row < len(POSITION) for row in self.options.rows)
        if self.options.coordinates == "zyz" and positions < len(e):
            turn = rotation_error(forward(self.chain, q, self.link)[:3, :3], self.T[:3, :3])
            seen = np.array([*e[:positions], *turn])
        norms = float(np.linalg.norm(seen[:positions])), float(np.linalg.norm(seen[positions:]))
        pull = self.K @ e
        size = float(np.linalg.norm(J) * np.linalg.norm(pull))
        stationary = float(np.linalg.norm(J.T @ pull)) <= _STATIONARY * size
        damped = self.options.rule == "pseudo_inverse" and _loses_rank(
            np.linalg.svd(J, compute_uv=False)
        )
        return _Errors(*norms, e, stationary, damped)

    def jacobian(self, q: Array) -> tuple[Array, Array]:
        """J (r, n) and e (r,) of the axes that count, at q (n,)."""
        T, zyz = self.T, self.options.coordinates == "zyz"
        B, J = pose_and_jacobian(self.chain, q, self.link)
        is_turned = any(row >= 3 for row in self.options.rows)
        turn = rotation_error(B[:3, :3], T[:3, :3])
        if zyz and is_turned:
            J, turn = analytic_zyz(J, B[:3, :3]), _zyz_error(B, T)
        e = np.array([*(T[:3, 3] - B[:3, 3]), *turn])
        if len(self.options.rows) == len(AXES):
            return J, e
        S = _selection(T, self.options)
        return S @ J, S @ e


def _zyz_error(B: Array, T: Array) -> Array:
    """The zyz angles of T less those of B, both (4, 4); the nearer of the target's two branches."""
    angles = to_zyz(B[:3, :3])
    differences = [
        np.array([math.remainder(x, 2.0 * math.pi) for x in to_zyz(T[:3, :3], flip=flip) - angles])
        for flip in (False, True)
    ]
    return min(differences, key=lambda x: float(x @ x))


def _selection(T: Array, options: GradientOptions) -> Array:
    """S, which takes the rows that count of an error in the base frame, shape (r, 6)."""
    frames, rows = np.eye(6), options.rows
    for first in (0, 3):
        if not {first, first + 1, first + 2} <= set(rows):
            frames[first : first + 3, first : first + 3] = T[:3, :3].T
    return np.asarray(frames[rows])


def _rate(system: _System, q: Array) -> Array:
    """q_dot of the flow, shape (n,) [rad/s or m/s]; the step of the step form too."""
    J, e = system.jacobian(q)
    K = system.K
    if system.options.rule == "transpose":
        return np.asarray(J.T @ (K @ e))
    U, s, V = np.linalg.svd(J, full_matrices=False)
    inverse = s / (s * s + _DAMPING) if _loses_rank(s) else 1.0 / s
    return np.asarray(V.T @ (inverse * (U.T @ (K @ e))))


def _loses_rank(s: NDArray[np.floating[Any]]) -> bool:
    return bool(s[-1] <= _FULL_RANK * s[0])


def _flow_until(system: _System, q: Array, duration: float) -> tuple[list[float], list[Array]]:
    """Times and points of the flow up to a time [s], its steps as near a singularity demands."""
    count = 0

    def rate(_: float, at: Array) -> Array:
        nonlocal count
        count += 1
        if count > _MOST_EVALUATIONS:
            raise InvalidOption(
                f"the flow to {duration:g} s takes too many steps: it is too stiff",
                hint="Ask for a shorter duration or a smaller gain.",
            )
        return _rate(system, at)

    flow = scipy.integrate.solve_ivp(
        rate, (0.0, duration), q, method="DOP853", rtol=1e-9, atol=1e-11
    )
    return flow.t.tolist(), list(flow.y.T)


def _runge_kutta(system: _System, q: Array) -> tuple[Array, float]:
    """The next point of the flow, and the time to it [s]."""
    h = _STEP / system.fastest
    if system.options.rule == "transpose":
        stretch = float(np.linalg.norm(system.jacobian(q)[0], 2))
        h = _TRANSPOSE_STEP / (system.fastest * max(stretch, _DAMPING) ** 2)
    k1 = _rate(system, q)
    k2 = _rate(system, q + 0.5 * h * k1)
    k3 = _rate(system, q + 0.5 * h * k2)
    k4 = _rate(system, q + h * k3)
    return np.asarray(q + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)), h


def _step(system: _System, q: Array) -> Array:
    """The next configuration of the step form."""
    slope = _rate(system, q)
    if system.options.rule == "pseudo_inverse" or system.options.gain is not None:
        return np.asarray(q + slope)
    J, e = system.jacobian(q)
    along = J @ slope
    square = float(along @ along)
    gamma = float(e @ along) / square if square > 0.0 else 0.0
    return np.asarray(q + gamma * slope)
