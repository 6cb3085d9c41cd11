"""Inverse kinematics of many poses by the batch kernels, one verified solution for each."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidOption
from kinematics.ik.closed_form.analytic import Branches, branches, middle, parameter
from kinematics.ik.closed_form.structure import Structure, structure
from kinematics.ik.inverse import CLOSE, IkOptions, parameter_grid
from kinematics.ik.numeric import numeric
from kinematics.ik.ranking import order
from kinematics.ik.solution import IkSolution
from kinematics.model.chain import Chain

#: Starts of the search for each pose. The rare pose that needs more is left to the single search.
_STARTS = 100
#: Poses whose branches are tabulated at once: 100 kB each for an arm with a parameter.
_CHUNK = 128


def inverse_kinematics_batch(
    chain: Chain,
    targets: ArrayLike,
    options: IkOptions | None = None,
    *,
    link: str | None = None,
    seed_joints: ArrayLike | None = None,
    threads: int | None = None,
) -> list[IkSolution | None]:
    """One configuration inside the limits for each of many poses.

    "auto" and "analytic" take the closed form where the arm has one and all axes count, "auto" and
    "numeric" the search for the poses that are left. Every solution is verified by forward
    kinematics in the kernel that found it.

    Args:
        chain: The robot.
        targets: T_base_link, shape (m, 4, 4).
        options: Method; one solution a pose, inside the limits.
        link: The link to bring there; the tip where none is named.
        seed_joints: Configuration to search from and to measure "nearest" from, shape (n,); the
            middle of the limits where not given.
        threads: Number of threads; all the processors that this process may use where not given.

    Returns:
        A solution for each pose, None where the batch kernels found none: `inverse_kinematics` of
        that pose alone tries more and says how near it came.

    Raises:
        InvalidOption: Several solutions, whole turns or solutions outside the limits are asked for.
        InvalidPose: A target is not a finite 4x4 matrix.
        InvalidRobotState: ``seed_joints`` has the wrong length or is not finite.
        InvalidLinkName: No such link.
    """
    how = options or IkOptions()
    if how.most > 1 or how.all_turns or how.outside_limits:
        raise InvalidOption(
            "a batch has one solution inside the limits for each pose",
            hint="Call `inverse_kinematics` pose by pose for more.",
        )
    T = np.asarray(targets, dtype=np.float64)
    near = middle(chain) if seed_joints is None else chain.configuration(seed_joints, "seed_joints")
    query = _Query(chain, link, near, how, threads)
    solutions: list[IkSolution | None] = [None] * len(T)
    form = structure(chain, link)
    if form is not None and how.method != "numeric" and how.all_axes:
        for first in range(0, len(T), _CHUNK):
            part = T[first : first + _CHUNK]
            solutions[first : first + len(part)] = _closed_form_solutions(query, form, part)
    left = [i for i, solution in enumerate(solutions) if solution is None]
    if left and how.method != "analytic":
        for i, solution in zip(left, _search(query, T[left]), strict=True):
            solutions[i] = solution
    return solutions


class _Query(NamedTuple):
    """Data that all poses of a batch share."""

    chain: Chain
    link: str | None
    near: Array
    options: IkOptions
    threads: int | None


def _search(query: _Query, targets: Array) -> list[IkSolution | None]:
    """The numeric method's solution for each pose."""
    how = query.options
    result = numeric.solve_many(
        query.chain, targets, numeric.SearchOptions(how.seed, _STARTS, axes=how.axes),
        link=query.link, seed_joints=query.near, threads=query.threads,
    )  # fmt: skip
    return [
        IkSolution(frozen(q.copy()), float(position), float(orientation), int(steps))
        if solved
        else None
        for q, position, orientation, steps, solved in zip(
            result.joints, result.position_error, result.orientation_error, result.steps,
            result.solved, strict=True,
        )
    ]  # fmt: skip


def _closed_form_solutions(
    query: _Query, form: Structure, targets: Array
) -> list[IkSolution | None]:
    """The best branch inside the limits for each of some poses."""
    chain, link, values = query.chain, query.link, query.options.parameters
    if values is None and form.redundant:
        values = parameter_grid(chain, form, parameter(chain, query.near, link))
    table = branches(
        chain, targets, link=link, seed_joints=query.near, parameters=values, enough=1,
        tolerance=CLOSE, threads=query.threads,
    )  # fmt: skip
    return [_best(query, table, i) for i in range(len(targets))]


def _best(query: _Query, table: Branches, pose: int) -> IkSolution | None:
    """The best branch of one pose inside the limits."""
    assert table.counts is not None
    own = table._replace(table=table.table[pose, : table.counts[pose]], counts=None)
    inside = np.flatnonzero(own.within_limits)
    if not inside.size:
        return None
    row = int(inside[0])
    if len(inside) > 1:
        ranking = query.options.ranking
        row = int(
            inside[order(query.chain, own.joints[inside], ranking, query.near, query.link)[0]]
        )
    return IkSolution(
        frozen(own.joints[row].copy()),
        float(own.position_error[row]),
        float(own.orientation_error[row]),
        0,
        own.label(row),
    )
