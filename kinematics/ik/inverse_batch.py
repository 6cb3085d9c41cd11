"""Inverse kinematics of many poses by the batch kernels, one verified solution for each."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, frozen
from kinematics.chain import Chain
from kinematics.ik import numeric
from kinematics.ik.analytic import Branches, branches, middle, parameter
from kinematics.ik.inverse import CLOSE, Method, parameter_grid
from kinematics.ik.numeric import AXES, Axis
from kinematics.ik.ranking import Choice, order
from kinematics.ik.solution import IkSolution
from kinematics.ik.structure import Structure, structure

#: Starts of the search for each pose. The rare pose that needs more is left to the single search.
_STARTS = 100
#: Poses whose branches are tabulated at once: 100 kB each for an arm with a parameter.
_CHUNK = 128


@dataclass(frozen=True, slots=True, eq=False)
class BatchOptions:
    """Options of the inverse kinematics of many poses.

    Args:
        link: The link to bring to the poses; the tip where none is named.
        method: "auto", "analytic" or "numeric".
        seed_joints: Where the search begins and what "nearest" is counted from, shape (n,); the
            middle of the limits where not given.
        seed: Of the random restarts.
        choice: What makes one branch better than another, see ``ranking.order``.
        parameters: Of a redundant arm's closed form, see ``analytic.branches``.
        axes: The axes of the target's frame that count; see ``numeric.solve``.
        threads: How many to share the poses among; all the processors that this process may use
            where not given.
    """

    link: str | None = None
    method: Method = "auto"
    seed_joints: ArrayLike | None = None
    seed: int = 0
    choice: Choice = "nearest"
    parameters: ArrayLike | None = None
    axes: Collection[Axis] = AXES
    threads: int | None = None


def inverse_kinematics_batch(
    chain: Chain, targets: ArrayLike, options: BatchOptions | None = None
) -> list[IkSolution | None]:
    """One configuration inside the limits for each of many poses.

    "auto" and "analytic" take the closed form where the arm has one and all axes count, "auto" and
    "numeric" the search for the poses that are left. Every solution is verified by forward
    kinematics in the kernel that found it.

    Args:
        chain: The robot.
        targets: T_base_link, shape (m, 4, 4).
        options: How to solve.

    Returns:
        A solution for each pose, None where the batch kernels found none: `inverse_kinematics` of
        that pose alone tries more and says how near it came.

    Raises:
        InvalidOption: An axis or a choice is unknown.
        InvalidPose: A target is no finite 4x4 matrix.
        InvalidRobotState: ``seed_joints`` has the wrong length or is not finite.
        InvalidLinkName: No such link.
    """
    how = options or BatchOptions()
    T = np.asarray(targets, dtype=np.float64)
    start = (
        middle(chain)
        if how.seed_joints is None
        else chain.configuration(how.seed_joints, "seed_joints")
    )
    solutions: list[IkSolution | None] = [None] * len(T)
    form = structure(chain, how.link)
    if form is not None and how.method != "numeric" and set(how.axes) == set(AXES):
        for first in range(0, len(T), _CHUNK):
            part = T[first : first + _CHUNK]
            solutions[first : first + len(part)] = _closed(chain, form, part, start, how)
    left = [i for i, solution in enumerate(solutions) if solution is None]
    if left and how.method != "analytic":
        searched = numeric.solve_many(
            chain, T[left], link=how.link, seed_joints=start, seed=how.seed, starts=_STARTS,
            axes=how.axes, threads=how.threads,
        )  # fmt: skip
        for row, i in enumerate(left):
            if searched.solved[row]:
                solutions[i] = IkSolution(
                    frozen(searched.joints[row].copy()),
                    float(searched.position_error[row]),
                    float(searched.orientation_error[row]),
                    int(searched.steps[row]),
                )
    return solutions


def _closed(
    chain: Chain, form: Structure, targets: Array, start: Array, how: BatchOptions
) -> list[IkSolution | None]:
    """The best branch inside the limits for each of some poses."""
    values = how.parameters
    if values is None and form.redundant:
        values = parameter_grid(chain, form, parameter(chain, start, how.link))
    table = branches(
        chain, targets, link=how.link, seed_joints=start, parameters=values, enough=1,
        tolerance=CLOSE, threads=how.threads,
    )  # fmt: skip
    return [_best(chain, table, i, start, how) for i in range(len(targets))]


def _best(
    chain: Chain, table: Branches, pose: int, start: Array, how: BatchOptions
) -> IkSolution | None:
    """The best branch of one pose inside the limits."""
    assert table.counts is not None
    own = table._replace(table=table.table[pose, : table.counts[pose]], counts=None)
    inside = np.flatnonzero(own.within_limits)
    if not inside.size:
        return None
    row = int(inside[0])
    if len(inside) > 1:
        row = int(inside[order(chain, own.joints[inside], how.choice, start, how.link)[0]])
    return IkSolution(
        frozen(own.joints[row].copy()),
        float(own.position_error[row]),
        float(own.orientation_error[row]),
        0,
        own.label(row),
    )
