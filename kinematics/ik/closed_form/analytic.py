"""Inverse kinematics in closed form: every branch of an arm that has one, verified.

Six revolute joints with a spherical wrist or shoulder, or three parallel axes (UR); seven with
both spheres (the arm angle is the parameter) or with six such joints behind or before one more
(its value is the parameter, as q7 of the Panda). ``structure`` finds out which.
"""

from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from compiled.kernel import direct, directly
from kinematics.arrays import Array, contiguous, frozen
from kinematics.errors import InvalidOption, InvalidPose, NotAvailable
from kinematics.forward import link_number
from kinematics.ik.batch import shared
from kinematics.ik.closed_form.branches import (
    branches_batch_kernel,
    branches_kernel,
    nearest_kernel,
)
from kinematics.ik.closed_form.refine import (
    CODE,
    INSIDE,
    MORE,
    ORIENTATION,
    POSITION,
    VALUE,
    parameter_kernel,
)
from kinematics.ik.closed_form.structure import Arm, Structure, structure
from kinematics.model.chain import Chain

#: Largest error of a solution [m], [rad].
TOLERANCE = 1e-9
#: Rows for branches: a closed form has 8, 16 at most for general axes.
_ROWS = 16
_POSE = (4, 4)
#: Stands for the seed's own parameter.
_OF_SEED = np.array([np.nan])
#: More branches than there are.
_ALL = 2**31


class Branches(NamedTuple):
    """The branches of one pose, k of them, or of a batch of m poses: (m, r, ...), ``counts`` each.

    Attributes:
        form: The closed form they come from.
        n: Joints of the chain.
        table: Joints and what is known of them in a row, shape (k, n + 6) or (m, r, n + 6).
        counts: Rows of the table that hold a branch of each pose, shape (m,); None for one pose.
    """

    form: Structure
    n: int
    table: Array
    counts: NDArray[np.int64] | None = None

    @property
    def joints(self) -> Array:
        """Configurations, each joint the whole turn that is inside its limits nearest the seed."""
        return self.table[..., : self.n]

    @property
    def position_error(self) -> Array:
        """Distance from the target [m]."""
        return self.table[..., self.n + POSITION]

    @property
    def orientation_error(self) -> Array:
        """Angle from the target [rad]."""
        return self.table[..., self.n + ORIENTATION]

    @property
    def within_limits(self) -> NDArray[np.bool_]:
        """Whether some whole turn of every joint is inside its limits."""
        return np.asarray(self.table[..., self.n + INSIDE] != 0.0)

    @property
    def parameter(self) -> Array:
        """The arm angle or the value of the locked joint [rad or m]; 0 where there is none."""
        return self.table[..., self.n + VALUE]

    def label(self, *index: int) -> str:
        """Name of the branch at an index, such as "shoulder+ elbow- wrist+".

        A sign is that of the factor of the Jacobian's determinant which vanishes where this branch
        and its opposite meet. Where axes 5 and 6 behind three parallel ones miss each other, the
        determinant has one factor for shoulder and wrist: their signs are then those of its part
        by joint 1 and of the sine of joint 5.
        """
        row = self.table[index]
        text = _signs(row[self.n + CODE], self.form.reverse)
        if self.form.kind == "redundant":
            text += f" arm_angle={row[self.n + VALUE]:.6f}"
        elif self.form.locked is not None:
            text += f" q{self.form.locked + 1}={row[self.n + VALUE]:.6f}"
        return text

    def nearest(self, seed: Array) -> tuple[int, int]:
        """Row of the branch of one pose inside the limits that is nearest to a seed, shape (n,).

        -1 where none is inside; and the number of those inside.
        """
        return directly(nearest_kernel, self.table, seed)


@cache
def _signs(code: float, reverse: bool) -> str:
    """Signs of shoulder, elbow and wrist by the bits of a code."""
    first, last = ("wrist", "shoulder") if reverse else ("shoulder", "wrist")
    signs = [f"{name}{'-' if int(code) & bit else '+'}" for name, bit in
             ((first, 4), ("elbow", 2), (last, 1))]  # fmt: skip
    return " ".join(reversed(signs) if reverse else signs)


def closed_form(chain: Chain, link: str | None = None) -> Structure:
    """The closed form of a chain up to a link (the tip where none is named).

    Raises:
        NotAvailable: The arm has no closed form; the message says which arms do.
        InvalidLinkName: No such link.
    """
    form = structure(chain, link)
    if form is None:
        raise NotAvailable(
            f"robot {chain.name!r} has no closed form of inverse kinematics up to "
            f"{link or chain.tip_link!r}",
            hint="There is one for six revolute joints with a spherical wrist or shoulder or three "
            "parallel axes, and for seven with two spheres or six of those. "
            "Take the numeric method.",
        )
    return form


def parameter(chain: Chain, q: ArrayLike, link: str | None = None) -> float:
    """The parameter of a redundant arm's configuration: arm angle or locked joint; else 0.

    Raises:
        NotAvailable: The arm has no closed form.
        InvalidRobotState: Wrong length or not finite.
    """
    form = closed_form(chain, link)
    return float(parameter_kernel(form.plan, chain.configuration(q), np.empty(7)))


def branches(
    chain: Chain,
    target: ArrayLike,
    *,
    link: str | None = None,
    seed_joints: ArrayLike | None = None,
    parameters: ArrayLike | None = None,
    tolerance: float = TOLERANCE,
    enough: int | None = None,
    threads: int | None = None,
) -> Branches:
    """All branches that bring a link to a pose, or to each pose of a batch.

    Those outside the limits are among them and say so. Where a pose leaves angles free (a straight
    wrist, the wrist on axis 1), one member of each family is answered: the seed's value of the
    free angle if it is inside the limits, else another that is.

    Args:
        chain: The robot.
        target: T_base_link, shape (4, 4) or (m, 4, 4).
        link: The link to bring there; the tip where none is named.
        seed_joints: Configuration that whole turns and free angles are near to, shape (n,) or (m,
            n); the middle of the limits where not given.
        parameters: Parameters of a redundant arm: the arm angles or values of the locked joint to
            take, in this order, shape (v,) or (m, v); that of the seed where not given.
        tolerance: Largest error of a branch [m], [rad].
        enough: Try no more parameters once so many branches are inside the limits.
        threads: Number of threads for a batch, which changes nothing but the time; all the
            processors that this process may use where not given.

    Raises:
        NotAvailable: The arm has no closed form.
        InvalidPose: The target is not finite or has another shape.
        InvalidRobotState: Seeds of the wrong length or not finite.
    """
    direct_branches, form, arm, near = _prepared(chain, link)
    many = _ALL if enough is None else enough
    seeds = near if seed_joints is None else contiguous(seed_joints, "seed_joints")
    T = contiguous(target, "the target")
    values = _OF_SEED if parameters is None else _parameters(parameters)
    if T.shape == _POSE and seeds.ndim == 1 and values.ndim == 1:
        table = np.empty((_ROWS * len(values), chain.n + MORE))
        count = direct_branches(arm, T, seeds, values, tolerance, many, table)
        if count >= 0:
            return Branches(form, chain.n, table[:count])
    chain.configuration(seeds, "seed_joints")
    if T.shape[-2:] != _POSE or not np.isfinite(T).all():
        raise InvalidPose("the target must be a finite 4x4 transform, or a batch of them")
    return _of_many(form, arm, T.reshape(-1, 4, 4), seeds, values, tolerance, many, threads)


def _of_many(
    form: Structure, arm: Arm, T: Array, seeds: Array, values: Array, tolerance: float, enough: int,
    threads: int | None,
) -> Branches:  # fmt: skip
    """Branches of a batch, as ``branches`` has them: variables of a closure cost single poses."""
    m, n = T.shape[0], arm.lower.shape[0]
    try:
        seeds = np.ascontiguousarray(np.broadcast_to(seeds, (m, n)))
        values = np.ascontiguousarray(np.broadcast_to(values, (m, values.shape[-1])))
    except ValueError:
        raise InvalidOption(f"seeds and parameters must be one or {m}, as the poses are") from None
    table = np.empty((m, _ROWS * values.shape[1], n + MORE))
    counts = np.zeros(m, dtype=np.int64)

    def part(k: slice) -> None:
        rows = T[k], seeds[k], values[k], tolerance, enough, table[k], counts[k]
        directly(branches_batch_kernel, arm, *rows)

    shared(part, m, threads)
    return Branches(form, n, table, counts)


@lru_cache(maxsize=256)
def _prepared(chain: Chain, link: str | None) -> tuple[Any, Structure, Arm, Array]:
    """The kernel, the form and the arrays of a chain up to a link, and the middle of its limits."""
    form = closed_form(chain, link)
    number = int(chain.model[0, 1]) if link is None else link_number(chain, link)
    arm = Arm(form.plan, chain.model, number, chain.limits.lower, chain.limits.upper)
    near, table = middle(chain), np.zeros((1, 1))
    kernel = direct(branches_kernel, arm, np.eye(4), near, _OF_SEED, TOLERANCE, _ALL, table)
    return kernel, form, arm, near


@lru_cache(maxsize=256)
def middle(chain: Chain) -> Array:
    """The middle of the limits, half way round where there are none, shape (n,)."""
    lower, upper = chain.sampling_bounds()
    return frozen(0.5 * (lower + upper))


def _parameters(parameters: ArrayLike) -> Array:
    values = np.atleast_1d(contiguous(parameters, "parameters"))
    if values.ndim > 2 or not values.size or not np.isfinite(values).all():
        raise InvalidOption("parameters must be finite numbers, one at least")
    return values
