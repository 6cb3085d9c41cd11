"""One robot's frames and Jacobians at one configuration, with little between Python and kernels."""

from typing import Self

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidRobotState
from kinematics.forward import all_poses, link_number, one_pose, write_branches
from kinematics.jacobian import both_of_one, one_jacobian
from kinematics.model.chain import Chain


class KinematicsEvaluator:
    """The kinematics of one robot, a configuration a call, for loops that can't be batched.

    The functions of this package check what they are given and answer new arrays; here q must be a
    contiguous float64 array, nothing is checked but that it is one finite number a joint, and every
    answer is a buffer that the next call of the same method overwrites. Not for several threads.

    Args:
        chain: The robot.
        link: The link that ``pose`` and ``jacobian`` are of; the tip where none is named.

    Raises:
        InvalidLinkName: No such link.
        InvalidOption: The link hangs on a joint that mimics another.
    """

    __slots__ = (
        "_J", "_T", "_both", "_jacobian", "_model", "_number", "_pose", "_poses", "_poses_of",
        "chain", "link",
    )  # fmt: skip

    def __init__(self, chain: Chain, link: str | None = None) -> None:
        self.chain, self.link = chain, chain.link(link or chain.tip_link).name
        self._model, self._number = chain.model, link_number(chain, self.link)
        self._T, self._J = np.empty((4, 4)), np.empty((6, chain.n))
        self._poses = np.empty((len(chain.links), 4, 4))
        self._pose, self._poses_of = one_pose(), all_poses()
        self._jacobian, self._both = one_jacobian(), both_of_one()

    def copy(self) -> Self:
        """Another evaluator of the same link, say for another thread."""
        return type(self)(self.chain, self.link)

    def pose(self, q: Array) -> Array:
        """T_base_link, shape (4, 4); see ``forward.forward``."""
        if self._pose(self._model, q, self._number, self._T):
            return self._T
        raise self._wrong(q)

    def link_poses(self, q: Array) -> Array:
        """Poses of all links, shape (len(links), 4, 4); see ``forward.link_poses``."""
        if self._poses_of(self._model, q, self._poses):
            if self.chain.followers:
                write_branches(self.chain, q, self._poses)
            return self._poses
        raise self._wrong(q)

    def jacobian(self, q: Array) -> Array:
        """Geometric Jacobian, shape (6, n); see ``jacobian.geometric``."""
        if self._jacobian(self._model, q, self._number, self._J):
            return self._J
        raise self._wrong(q)

    def pose_and_jacobian(self, q: Array) -> tuple[Array, Array]:
        """Both in one walk; see ``jacobian.pose_and_jacobian``."""
        if self._both(self._model, q, self._number, self._T, self._J):
            return self._T, self._J
        raise self._wrong(q)

    def _wrong(self, q: Array) -> InvalidRobotState:
        self.chain.configuration(q)
        return InvalidRobotState("joints must be one configuration here, in one contiguous array")
