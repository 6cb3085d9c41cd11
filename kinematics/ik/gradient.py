"""Inverse kinematics by following a gradient, with its trace (course notes, lectures 15 and 16).

pseudo_inverse: the flow q_dot = J^+(q) K e, along which e_dot = -K e: the error decays at the rate
K in every direction, as long as J has full row rank. The classical Runge-Kutta method integrates
it.

transpose: descent of U = |e|^2 / 2 by q <- q + gamma J^T(q) e, with the gamma that is best for the
linear model where none is given. It needs no inverse and creeps along flat directions.

e = x_d - x is counted in rotation vectors, or as in the notes in zyz Euler angles with their
analytic Jacobian, which does not exist where sin(theta) = 0. Neither method knows joint limits.
"""

import math
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, frozen
from kinematics.chain import Chain
from kinematics.errors import InvalidOption, InvalidPose
from kinematics.forward import forward
from kinematics.ik.numeric import ORIENTATION_TOLERANCE, POSITION_TOLERANCE
from kinematics.ik.solution import IkSolution
from kinematics.jacobian import analytic_zyz, pose_and_jacobian
from kinematics.pose import rotation_error, to_zyz

Rule = Literal["pseudo_inverse", "transpose"]
Coordinates = Literal["rotation_vector", "zyz"]
RULES: tuple[Rule, ...] = get_args(Rule)
COORDINATES: tuple[Coordinates, ...] = get_args(Coordinates)

#: Runge-Kutta steps are this long in units of 1 / K; the error falls by exp(-0.25) in each.
_STEP = 0.25
#: J J^T + this: without it a singular start would throw the arm anywhere.
_DAMPING = 1e-9
#: Steps that are traced and taken at most.
STEPS = {"pseudo_inverse": 400, "transpose": 20_000}


@dataclass(frozen=True, slots=True, eq=False)
class GradientOptions:
    """How to follow the gradient.

    Args:
        rule: "pseudo_inverse" or "transpose".
        coordinates: What orientation errors are counted in.
        gain: K [1/s], or gamma of the descent; None for 1 and for the best of each step.
        steps: At most; None for 400 and 20,000.
    """

    rule: Rule = "pseudo_inverse"
    coordinates: Coordinates = "rotation_vector"
    gain: float | None = None
    steps: int | None = None

    def __post_init__(self) -> None:
        if self.rule not in RULES:
            raise InvalidOption(f"there is no rule {self.rule!r}", hint=f"One of: {RULES}.")
        if self.coordinates not in COORDINATES:
            raise InvalidOption(
                f"there are no coordinates {self.coordinates!r}", hint=f"One of: {COORDINATES}."
            )
        if self.gain is not None and not 0.0 < self.gain < math.inf:
            raise InvalidOption(f"gain must be positive, got {self.gain}")
        if self.steps is not None and self.steps < 1:
            raise InvalidOption(f"steps must be 1 at least, got {self.steps}")


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """Where a gradient went, k + 1 points from the start on.

    Args:
        times: Of the flow [s]; of the descent the number of the step, shape (k + 1,).
        joints: Shape (k + 1, n).
        position_error: [m], shape (k + 1,).
        orientation_error: [rad], shape (k + 1,).
        converged: Whether the last point is inside the tolerances.
    """

    times: Array
    joints: Array
    position_error: Array
    orientation_error: Array
    converged: bool

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
    """Follow the gradient from a configuration until the tolerances are met or the steps are spent.

    Args:
        chain: The robot.
        target: T_base_link, shape (4, 4).
        link: The link to bring there; the tip where none is named.
        seed_joints: The start, shape (n,); the middle of the limits where not given.
        options: How.
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
    gain = 1.0 if how.gain is None else how.gain
    points, errors = [q], [_errors(chain, q, T, link)]
    interval = _STEP / gain if how.rule == "pseudo_inverse" else 1.0
    while not _done(errors[-1], position_tolerance, orientation_tolerance):
        if len(points) > (how.steps or STEPS[how.rule]):
            break
        if how.rule == "pseudo_inverse":
            q = _runge_kutta(chain, q, T, link, how.coordinates, gain, interval)
        else:
            q = _descended(chain, q, T, link, how)
        points.append(q)
        errors.append(_errors(chain, q, T, link))
    done = _done(errors[-1], position_tolerance, orientation_tolerance)
    told = np.array(errors)
    times = np.array([interval * k for k in range(len(points))])
    return Trace(times, np.array(points), told[:, 0], told[:, 1], done)


def _done(errors: tuple[float, float], position: float, orientation: float) -> bool:
    return errors[0] <= position and errors[1] <= orientation


def _errors(chain: Chain, q: Array, T: Array, link: str | None) -> tuple[float, float]:
    B = forward(chain, q, link)
    away = float(np.linalg.norm(T[:3, 3] - B[:3, 3]))
    return away, float(np.linalg.norm(rotation_error(B[:3, :3], T[:3, :3])))


def _system(
    chain: Chain, q: Array, T: Array, link: str | None, coordinates: Coordinates
) -> tuple[Array, Array]:
    """J (6, n) and e (6,) in the coordinates asked for."""
    B, J = pose_and_jacobian(chain, q, link)
    if coordinates == "rotation_vector":
        return J, np.array([*(T[:3, 3] - B[:3, 3]), *rotation_error(B[:3, :3], T[:3, :3])])
    angles = to_zyz(B[:3, :3])
    # Both branches of the target are the same rotation: the nearer one is meant.
    differences = [
        np.array([math.remainder(x, 2.0 * math.pi) for x in to_zyz(T[:3, :3], flip=flip) - angles])
        for flip in (False, True)
    ]
    turn = min(differences, key=lambda x: float(x @ x))
    return analytic_zyz(J, B[:3, :3]), np.array([*(T[:3, 3] - B[:3, 3]), *turn])


def _flow(
    chain: Chain, q: Array, T: Array, link: str | None, coordinates: Coordinates, gain: float
) -> Array:
    J, e = _system(chain, q, T, link, coordinates)
    return np.asarray(gain * (J.T @ np.linalg.solve(J @ J.T + _DAMPING * np.eye(6), e)))


def _runge_kutta(
    chain: Chain,
    q: Array,
    T: Array,
    link: str | None,
    coordinates: Coordinates,
    gain: float,
    h: float,
) -> Array:
    def rate(x: Array) -> Array:
        return _flow(chain, x, T, link, coordinates, gain)

    k1 = rate(q)
    k2 = rate(q + 0.5 * h * k1)
    k3 = rate(q + 0.5 * h * k2)
    k4 = rate(q + h * k3)
    return np.asarray(q + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4))


def _descended(chain: Chain, q: Array, T: Array, link: str | None, how: GradientOptions) -> Array:
    J, e = _system(chain, q, T, link, how.coordinates)
    slope = J.T @ e
    gamma = how.gain
    if gamma is None:
        along = J @ slope
        square = float(along @ along)
        gamma = float(e @ along) / square if square > 0.0 else 0.0
    return np.asarray(q + gamma * slope)
