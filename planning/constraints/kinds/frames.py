"""Frames of a constraint: a link, and the link it is seen from."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidGoal
from kinematics.model.branch import require_on_chain
from kinematics.model.chain import Chain
from kinematics.pose import inverse
from planning.constraints.row import Row, RowKind, Unit


@dataclass(frozen=True, slots=True, eq=False)
class Attachment:
    """A link of a chain seen from another one, or from the base.

    Args:
        carrier: The joint that carries the link, -1 for the base.
        T_carrier_link: The link's frame in that joint's, shape (4, 4).
        reference: The joint that carries the link it is seen from, -1 for the base.
        T_reference_link: The frame of that link in that joint's, shape (4, 4).
        name: Name of the link.
    """

    carrier: int
    T_carrier_link: Array
    reference: int
    T_reference_link: Array
    name: str

    @classmethod
    def of(cls, chain: Chain, link: str | None, reference_link: str | None = None) -> "Attachment":
        """The attachment of a link, the tip where none is named.

        Raises:
            InvalidLinkName: No such link.
            InvalidGoal: Both move with the same joint.
            InvalidOption: A link hangs on a joint that mimics another.
        """
        for name in (link, reference_link):
            require_on_chain(chain, name or chain.tip_link)
        body = chain.link(link or chain.tip_link)
        joint, T = -1, np.eye(4)
        if reference_link is not None:
            seen_from = chain.link(reference_link)
            joint, T = seen_from.joint, seen_from.T_joint_link
        if body.joint == joint:
            base = chain.root_link if reference_link is None else reference_link
            raise InvalidGoal(
                f"link {body.name!r} does not move against {base!r}: no motion changes this "
                "constraint",
                hint="Name a link that a joint moves.",
                link=body.name,
            )
        return cls(body.joint, body.T_joint_link, joint, T, body.name)

    def point(self, point: Array) -> Array:
        """A point of the link in its carrier's frame."""
        return np.asarray(self.T_carrier_link[:3, :3] @ point + self.T_carrier_link[:3, 3])

    def axis(self, axis: Array) -> Array:
        """A direction of the link in its carrier's frame."""
        return np.asarray(self.T_carrier_link[:3, :3] @ axis)

    def place(self, position: Array) -> Array:
        """A place that the link it is seen from knows, in the reference's frame."""
        return np.asarray(self.T_reference_link[:3, :3] @ position + self.T_reference_link[:3, 3])

    def direction(self, direction: Array) -> Array:
        """A direction that the link it is seen from knows, in the reference's frame."""
        return np.asarray(self.T_reference_link[:3, :3] @ direction)

    def row(
        self, kind: RowKind, bounds: tuple[float, float], label: str, unit: Unit = "m", /,
        **vectors: Array,
    ) -> Row:  # fmt: skip
        """A row between this link and the one it is seen from.

        Args:
            kind: The function.
            bounds: Least and largest value [unit].
            label: Description of the bound in words.
            unit: "rad" or "m".
            vectors: Vectors of the row by name, in the frames of the joints.
        """
        lower, upper = bounds
        return Row(kind, self.carrier, self.reference, lower, upper, unit, label=label, **vectors)

    def turn(self, rotation: Array) -> tuple[Array, Array]:
        """K and M of log(R_target^T R) = M^T log(K X) for a rotation that is aimed at, (3, 3).

        R = T_r^T X M with M the link's rotation in its carrier: so R_target^T R = M^-1 (M L) X M
        with L = R_target^T T_r^T, and log(M^-1 E M) = M^-1 log(E).
        """
        M = self.T_carrier_link[:3, :3]
        return np.asarray(M @ rotation.T @ inverse(self.T_reference_link)[:3, :3]), M


def vector(values: ArrayLike, name: str) -> Array:
    """Three finite numbers, read-only.

    Raises:
        InvalidGoal: They are not.
    """
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.zeros(0)
    if array.shape != (3,) or not np.isfinite(array).all():
        raise InvalidGoal(f"{name} must be three finite numbers [x, y, z]")
    return frozen(array)


def unit(values: ArrayLike, name: str) -> Array:
    """Three numbers scaled to length 1, read-only.

    Raises:
        InvalidGoal: They are no three finite numbers, or all 0.
    """
    array = vector(values, name)
    length = float(np.linalg.norm(array))
    # Axes and directions shorter than this name none.
    if length < 1e-9:
        raise InvalidGoal(
            f"{name} has length {length:.3g}, so it names no direction",
            hint="Any length but 0 will do: [0, 0, 1] is the z axis.",
        )
    return frozen(array / length)


def tolerance(value: float, name: str, most: float = np.inf) -> float:
    """A tolerance, 0 or more.

    Raises:
        InvalidGoal: It is negative, no number, or beyond ``most``.
    """
    if not 0.0 <= value <= most:
        limit = "" if np.isinf(most) else f" and at most {most:.6g}"
        raise InvalidGoal(f"{name} is {value}; it must be 0 or more{limit}")
    return float(value)


def tolerances(values: float | Sequence[float] | Array, name: str) -> Array:
    """Three tolerances, one number standing for all of them.

    Raises:
        InvalidGoal: They are not, or one is negative.
    """
    array = (
        np.broadcast_to(np.array(values, dtype=np.float64), (3,))
        if np.ndim(values) == 0
        else (np.array(values, dtype=np.float64))
    )
    if array.shape != (3,) or not (array >= 0.0).all():
        raise InvalidGoal(f"{name} must be one number or three, each 0 or more")
    return frozen(array)


def weight(value: float | None) -> None:
    """Check a weight: None makes a constraint hard, a positive number soft.

    Raises:
        InvalidGoal: It is not positive.
    """
    if value is not None and not 0.0 < value < np.inf:
        raise InvalidGoal(
            f"weight is {value}; it must be positive",
            hint="Leave weight out for a hard constraint.",
        )
