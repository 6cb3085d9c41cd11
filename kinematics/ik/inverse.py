"""Inverse kinematics by the best method a chain has, with the best solution first."""

from collections.abc import Collection
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, frozen
from kinematics.chain import Chain
from kinematics.errors import InvalidOption
from kinematics.ik import numeric
from kinematics.ik.analytic import Branches, branches, closed_form, middle, parameter
from kinematics.ik.numeric import AXES, Axis
from kinematics.ik.ranking import Choice, order, whole_turns
from kinematics.ik.solution import IkResult, IkSolution
from kinematics.ik.structure import Structure, structure

Method = Literal["auto", "analytic", "numeric"]
METHODS: tuple[Method, ...] = get_args(Method)

#: Values of a redundant arm's parameter that are tried.
_GRID = 48
#: A closed form's branches fit their pose better than this, poses of six digits fit worse.
CLOSE = 1e-9
#: Starts of the numeric method for each solution that is looked for.
_STARTS_EACH = 60


def inverse_kinematics(
    chain: Chain,
    target: ArrayLike,
    *,
    link: str | None = None,
    method: Method = "auto",
    seed_joints: ArrayLike | None = None,
    seed: int = 0,
    most: int = 1,
    choice: Choice = "nearest",
    outside_limits: bool = False,
    all_turns: bool = False,
    parameters: ArrayLike | None = None,
    axes: Collection[Axis] = AXES,
) -> IkResult:
    """Configurations that bring a link to a pose, best first.

    "auto" takes the closed form where the arm has one and all axes count, and the numeric method
    where it has none or nothing of it is inside the limits.

    Args:
        chain: The robot.
        target: T_base_link, shape (4, 4).
        link: The link to bring there; the tip where none is named.
        method: "auto", "analytic" or "numeric".
        seed_joints: Where to look first and what "nearest" is counted from, shape (n,); the middle
            of the limits where not given.
        seed: Of the numeric method's restarts.
        most: How many solutions to answer at most.
        choice: What makes one better than another, see ``choice.order``.
        outside_limits: Also answer branches with no copy inside the limits, after the others.
        all_turns: Also answer each solution's copies by whole turns inside the limits.
        parameters: Of a redundant arm's closed form, see ``analytic.branches``; where not given,
            that of the seed is taken, then values all around it until one has a solution. Where
            several solutions are wanted, all those values.
        axes: The axes of the target's frame that count; see ``numeric.solve``.

    Raises:
        NotAvailable: "analytic" is asked for, but the arm has no closed form.
        InvalidOption: No such method or choice, or an option the method does not have.
        InvalidPose: The target is no finite 4x4 matrix.
        InvalidRobotState: ``seed_joints`` has the wrong length or is not finite.
        InvalidLinkName: No such link.
    """
    if method not in METHODS:
        raise InvalidOption(f"there is no method {method!r}", hint=f"One of: {', '.join(METHODS)}.")
    if most < 1:
        raise InvalidOption("most must be 1 at least")
    near = middle(chain) if seed_joints is None else chain.configuration(seed_joints, "seed_joints")
    whole = set(axes) == set(AXES)
    if method == "analytic" and not whole:
        raise InvalidOption("a closed form needs all axes of the target", hint='Take "numeric".')
    form = closed_form(chain, link) if method == "analytic" else structure(chain, link)
    found: list[IkSolution] = []
    if form is not None and whole and method != "numeric":
        found = _closed(chain, form, target, link, near, most, outside_limits, parameters)
    if any(solution.within_limits for solution in found):
        return _sorted(chain, found, choice, near, link, most, all_turns)
    result = numeric.solve(
        chain, target, link=link, seed_joints=near, seed=seed, solutions=most, axes=axes,
        starts=max(numeric.STARTS if most == 1 else 500, _STARTS_EACH * most),
    )  # fmt: skip
    if result.solutions and form is not None and form.redundant and parameters is None and whole:
        # The parameter's window was narrower than the grid: the numeric method fell into it.
        value = parameter(chain, result.solutions[0].joints, link)
        more = _closed(chain, form, target, link, near, most, outside_limits, [value])
        found = [*more, *found] if method != "numeric" else found
    if not any(solution.within_limits for solution in found) and method != "analytic":
        found = [*result.solutions, *found]
    if not found:
        return result
    return _sorted(chain, found, choice, near, link, most, all_turns, result.starts)


def _closed(
    chain: Chain,
    form: Structure,
    target: ArrayLike,
    link: str | None,
    near: Array,
    most: int,
    outside_limits: bool,
    parameters: ArrayLike | None,
) -> list[IkSolution]:
    values = parameters
    if parameters is None and form.redundant:
        values = parameter_grid(chain, form, parameter(chain, near, link))
    enough = 1 if most == 1 and not outside_limits else None
    table = branches(
        chain, target, link=link, seed_joints=near, parameters=values, enough=enough,
        tolerance=CLOSE,
    )  # fmt: skip
    return _solutions(table, outside_limits)


def _solutions(table: Branches, outside_limits: bool) -> list[IkSolution]:
    rows = zip(
        table.joints, table.position_error, table.orientation_error, table.within_limits,
        strict=True,
    )  # fmt: skip
    return [
        IkSolution(frozen(q), float(p), float(r), 0, table.label(i), bool(inside))
        for i, (q, p, r, inside) in enumerate(rows)
        if inside or outside_limits
    ]


def parameter_grid(chain: Chain, form: Structure, value: float) -> Array:
    """Values of the parameter, nearest to ``value`` first."""
    if form.locked is None:
        steps = np.arange(_GRID) * 2.0 * np.pi / _GRID
        values = np.remainder(value + steps + np.pi, 2.0 * np.pi) - np.pi
        away = np.minimum(steps, 2.0 * np.pi - steps)
    else:
        low, high = chain.sampling_bounds()
        grid = np.linspace(low[form.locked], high[form.locked], _GRID)
        values = np.array([np.clip(value, grid[0], grid[-1]), *grid])
        away = np.abs(values - value)
    return np.asarray(values[np.argsort(away, kind="stable")])


def _sorted(
    chain: Chain,
    found: list[IkSolution],
    choice: Choice,
    near: Array,
    link: str | None,
    most: int,
    all_turns: bool,
    starts: int = 0,
) -> IkResult:
    inside = [solution for solution in found if solution.within_limits]
    if all_turns:
        inside = [
            IkSolution(frozen(q), s.position_error, s.orientation_error, s.iterations, s.branch)
            for s in inside
            for q in whole_turns(chain, s.joints, most, near)
        ]
    joints = np.array([solution.joints for solution in inside]).reshape(-1, chain.n)
    ranked = [inside[i] for i in order(chain, joints, choice, near, link)]
    rest = [solution for solution in found if not solution.within_limits]
    best = (*ranked, *rest)[:most]
    return IkResult(best, best[0], starts)
