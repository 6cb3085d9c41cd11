"""Inverse kinematics by the best method a chain has, with the best solution first.

Inverse kinematics of many poses by the batch kernels, one verified solution for each.
"""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, frozen
from kinematics.caches.bounded_cache import bounded_cache
from kinematics.errors import InvalidOption, InvalidPose
from kinematics.ik.closed_form.analytic import Branches, branches, closed_form, middle, parameter
from kinematics.ik.closed_form.arm_parts import out_of_reach
from kinematics.ik.closed_form.refine import CODE, GROUP
from kinematics.ik.closed_form.structure import Structure, structure
from kinematics.ik.closed_form.subproblem import EXACT
from kinematics.ik.decoupled import decoupled
from kinematics.ik.decoupled import solutions as decoupled_solutions
from kinematics.ik.numeric import numeric
from kinematics.ik.numeric.numeric import AXES, POSITION, Axis
from kinematics.ik.ranking import Ranking, check_ranking, order, whole_turns
from kinematics.ik.solution import IkResult, IkSolution
from kinematics.model.chain import Chain

Method = Literal["auto", "analytic", "numeric"]
METHODS: tuple[Method, ...] = get_args(Method)

#: Values of a redundant arm's parameter that are tried.
_GRID = 48
#: A closed form's branches fit their pose better than this, poses of six digits fit worse.
CLOSE = 1e-9
#: Starts of the numeric method for each solution that is looked for.
_STARTS_EACH = 60
#: Starts where a closed form has no branch: they tell how near the arm comes.
_STARTS_BEYOND_REACH = 20
#: Less than this is the rounding of a target at the edge of reach [m].
_EDGE = 1e-6
#: Starts at least where several solutions are looked for.
_STARTS_FOR_SEVERAL = 500


@dataclass(frozen=True, slots=True, eq=False)
class IkOptions:
    """Options of inverse kinematics.

    Args:
        method: "auto", "analytic" or "numeric". "auto" takes the closed form where the arm has one
            and all axes count, and the numeric method where it has none or nothing of it is inside
            the limits.
        seed: Seed of the numeric method's restarts.
        most: Largest number of solutions in the answer.
        ranking: Measure that makes one solution better than another, see ``ranking.order``.
        outside_limits: Whether branches with no copy inside the limits are answered, after the
            others.
        all_turns: Whether each solution's copies by whole turns inside the limits are answered.
        parameters: Parameters of a redundant arm's closed form, see ``analytic.branches``; where
            not given, that of the seed is taken, then values all around it until one has a
            solution. Where several solutions are wanted, all those values.
        axes: The axes of the target's frame that count; see ``numeric.SearchOptions``.

    Raises:
        InvalidOption: No such method or ranking, ``most`` below 1, or a closed form is asked for
            although only some axes count.
    """

    method: Method = "auto"
    seed: int = 0
    most: int = 1
    ranking: Ranking = "nearest"
    outside_limits: bool = False
    all_turns: bool = False
    parameters: ArrayLike | None = None
    axes: Collection[Axis] = AXES

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise InvalidOption(
                f"there is no method {self.method!r}", hint=f"One of: {', '.join(METHODS)}."
            )
        check_ranking(self.ranking)
        if self.most < 1:
            raise InvalidOption("most must be 1 at least")
        if self.method == "analytic" and not self.all_axes and not self.position_alone:
            raise InvalidOption(
                "a closed form needs all axes of the target, or x, y and z of three joints",
                hint='Take "numeric".',
            )

    @property
    def all_axes(self) -> bool:
        """Whether all axes of the target's frame count."""
        return self.axes is AXES or set(self.axes) == set(AXES)

    @property
    def position_alone(self) -> bool:
        """Whether the position counts and no turn."""
        return self.axes is not AXES and set(self.axes) == set(POSITION)


_DEFAULT = IkOptions()


class _Query(NamedTuple):
    """One pose or some, with their seed and the method."""

    chain: Chain
    target: ArrayLike
    link: str | None
    near: Array
    options: IkOptions


def inverse_kinematics(
    chain: Chain,
    target: ArrayLike,
    options: IkOptions | None = None,
    *,
    link: str | None = None,
    seed_joints: ArrayLike | None = None,
) -> IkResult:
    """Configurations that bring a link to a pose, best first.

    Args:
        chain: The robot.
        target: T_base_link, shape (4, 4).
        options: Method, and number of solutions in the answer.
        link: The link to bring there; the tip where none is named.
        seed_joints: Configuration to search from and to measure "nearest" from, shape (n,); the
            middle of the limits where not given.

    Raises:
        NotAvailable: "analytic" is asked for, but the arm has no closed form.
        InvalidOption: Parameters that the closed form does not have.
        InvalidPose: The target is not a finite 4x4 matrix.
        InvalidRobotState: ``seed_joints`` has the wrong length or is not finite.
        InvalidLinkName: No such link.
    """
    how = options or _DEFAULT
    near = middle(chain) if seed_joints is None else chain.state(seed_joints, "seed_joints")
    if np.shape(target) != (4, 4):
        raise InvalidPose("the target must be a finite 4x4 transform")
    query = _Query(chain, target, link, near, how)
    all_axes = how.all_axes
    form = structure(chain, link) if all_axes else None
    arm = None
    if form is None and (all_axes or how.position_alone):
        arm = decoupled(chain, link, position=how.position_alone)
    if form is None and arm is None and how.method == "analytic":
        closed_form(chain, link)
    solutions: list[IkSolution] = []
    complete = False
    if how.method != "numeric" and form is not None:
        table, complete = _closed_form_branches(query, form, how.parameters)
        row, inside = table.nearest(near)
        if inside and not how.all_turns:
            if how.most > 1 or how.ranking != "nearest":
                return _best_branches(query, table, complete=complete)
            best = _solution(table, row)
            found = len(table.table) if how.outside_limits else inside
            return IkResult((best,), best, 0, complete=complete, found=found)
        solutions = _solutions(table, how.outside_limits)
    elif how.method != "numeric" and arm is not None:
        branches, complete = decoupled_solutions(
            chain, arm, np.asarray(target, dtype=np.float64), near, link=link,
            position=how.position_alone,
        )  # fmt: skip
        solutions = [item for item in branches if item.within_limits or how.outside_limits]
    if any(solution.within_limits for solution in solutions):
        return _best_first(query, solutions, complete=complete)
    return _search(query, form, solutions)


def has_closed_form(chain: Chain, link: str | None = None, axes: Collection[Axis] = AXES) -> bool:
    """Whether inverse kinematics has a closed form up to a link (the tip) for these axes."""
    every, position = set(axes) == set(AXES), set(axes) == set(POSITION)
    if every and structure(chain, link) is not None:
        return True
    return (every or position) and decoupled(chain, link, position=position) is not None


def _search(query: _Query, form: Structure | None, outside: list[IkSolution]) -> IkResult:
    """Solutions of the numeric method, before those of the closed form outside the limits."""
    chain, how = query.chain, query.options
    starts = max(numeric.STARTS if how.most == 1 else _STARTS_FOR_SEVERAL, _STARTS_EACH * how.most)
    gap = _reach_gap(query, form)
    if gap is not None:
        starts = _STARTS_BEYOND_REACH
    result = numeric.solve(
        chain, query.target, numeric.SearchOptions(how.seed, starts, axes=how.axes),
        link=query.link, seed_joints=query.near, solutions=how.most,
    )  # fmt: skip
    solutions = outside
    if result.solutions and form is not None and form.redundant and how.parameters is None:
        # The parameter's window was narrower than the grid: the numeric method hit it.
        value = parameter(chain, result.solutions[0].joints, query.link)
        more = _solutions(_closed_form_branches(query, form, [value])[0], how.outside_limits)
        solutions = [*more, *outside] if how.method != "numeric" else outside
    if not any(solution.within_limits for solution in solutions) and how.method != "analytic":
        solutions = [*result.solutions, *solutions]
    if solutions:
        return _best_first(query, solutions, result.starts)
    if not gap:
        return result
    return result._replace(advice=f"{_beyond(gap)} {result.advice}", out_of_reach=gap)


def _reach_gap(query: _Query, form: Structure | None) -> float | None:
    """Distance by which a pose without a branch is out of reach [m]; None where it may have one.

    It is 0 where there is no branch, but how far away one is can't be told from the triangle alone.
    """
    if query.options.method == "numeric" or (form is not None and form.miss > EXACT):
        return None
    gap = out_of_reach(query.chain, query.target, query.link, query.options.axes)
    if gap is not None and gap > _EDGE:
        return gap
    if form is None or form.redundant:
        return None
    # Beside two singularities at once a branch is refined to no more than about this [m], [rad].
    rough = branches(query.chain, query.target, link=query.link, tolerance=1e-4)
    return None if len(rough.joints) > 0 else 0.0


def _beyond(gap: float) -> str:
    """Advice for a target whose triangle does not close."""
    return (
        f"The wrist centre is out of reach by {gap:.4g} m: |D| > 1, upper arm and forearm make no "
        "triangle with it. Bring the target nearer to the shoulder's reach, or turn it."
    )


def _closed_form_branches(
    query: _Query, form: Structure, parameters: ArrayLike | None
) -> tuple[Branches, bool]:
    """Branches of the closed form, and whether there are no others."""
    chain, link, how = query.chain, query.link, query.options
    values = parameters
    if parameters is None and form.redundant:
        values = parameter_grid(chain, form, parameter(chain, query.near, link))
    enough = 1 if how.most == 1 and not how.outside_limits else None
    table = branches(
        chain, query.target, link=link, seed_joints=query.near, parameters=values, enough=enough,
        tolerance=CLOSE,
    )  # fmt: skip
    exact = how.most > 1 and not form.redundant and form.miss <= EXACT
    complete = exact and not table.table[:, table.n + GROUP].any()
    return table, complete


def _in_order(table: Branches) -> list[int]:
    """Rows of a table: by shoulder, elbow and wrist where a wrist's form finds them by roots."""
    if table.form.kind != "spherical" or table.form.redundant:
        return list(range(len(table.table)))
    order: list[int] = table.table[:, table.n + CODE].argsort(kind="stable").tolist()
    return order


def _solutions(table: Branches, outside_limits: bool) -> list[IkSolution]:
    inside = table.within_limits
    return [_solution(table, i) for i in _in_order(table) if inside[i] or outside_limits]


def _solution(table: Branches, row: int) -> IkSolution:
    values, n = table.table[row], table.n
    q = values[:n].copy()
    q.setflags(write=False)
    position, orientation, inside = values[n : n + 3].tolist()
    return IkSolution(q, position, orientation, 0, table.label(row), inside != 0.0)


def _best_branches(query: _Query, table: Branches, *, complete: bool) -> IkResult:
    """The best branches inside the limits, then those outside, if they are asked for.

    Only those that are answered become solutions with names.

    Args:
        query: The pose and what is asked.
        table: All branches, one at least inside the limits.
        complete: Whether there are no others.
    """
    how, inside = query.options, table.within_limits.nonzero()[0]
    ranked = order(query.chain, table.joints[inside], how.ranking, query.near, query.link)
    rows = inside[ranked].tolist()
    if how.outside_limits:
        rows += [i for i in _in_order(table) if not table.within_limits[i]]
    best = tuple(_solution(table, row) for row in rows[: how.most])
    return IkResult(best, best[0], 0, complete=complete, found=len(rows))


@bounded_cache(maxsize=256)
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
    return frozen(values[np.argsort(away, kind="stable")])


def _best_first(
    query: _Query, solutions: list[IkSolution], starts: int = 0, *, complete: bool = False
) -> IkResult:
    """The best of the solutions inside the limits, then those outside."""
    chain, how = query.chain, query.options
    inside = [solution for solution in solutions if solution.within_limits]
    if how.all_turns:
        inside = [
            IkSolution(frozen(q), s.position_error, s.orientation_error, s.iterations, s.branch)
            for s in inside
            for q in whole_turns(chain, s.joints, how.most, query.near)
        ]
    joints = np.array([solution.joints for solution in inside]).reshape(-1, chain.n)
    ranked = [inside[i] for i in order(chain, joints, how.ranking, query.near, query.link)]
    rest = [solution for solution in solutions if not solution.within_limits]
    every = (*ranked, *rest)
    best = every[: how.most]
    return IkResult(best, best[0], starts, complete=complete, found=len(every))


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
    query = _Query(chain, T, link, near, how)
    solutions: list[IkSolution | None] = [None] * len(T)
    form = structure(chain, link)
    if form is not None and how.method != "numeric" and how.all_axes:
        for first in range(0, len(T), _CHUNK):
            part = T[first : first + _CHUNK]
            solutions[first : first + len(part)] = _closed_form_solutions(
                query, form, part, threads
            )
    left = [i for i, solution in enumerate(solutions) if solution is None]
    if left and how.method != "analytic":
        for i, solution in zip(left, _search_batch(query, T[left], threads), strict=True):
            solutions[i] = solution
    return solutions


def _search_batch(query: _Query, targets: Array, threads: int | None) -> list[IkSolution | None]:
    """The numeric method's solution for each pose."""
    how = query.options
    result = numeric.solve_many(
        query.chain, targets, numeric.SearchOptions(how.seed, _STARTS, axes=how.axes),
        link=query.link, seed_joints=query.near, threads=threads,
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
    query: _Query, form: Structure, targets: Array, threads: int | None
) -> list[IkSolution | None]:
    """The best branch inside the limits for each of some poses."""
    chain, link, values = query.chain, query.link, query.options.parameters
    if values is None and form.redundant:
        values = parameter_grid(chain, form, parameter(chain, query.near, link))
    table = branches(
        chain, targets, link=link, seed_joints=query.near, parameters=values, enough=1,
        tolerance=CLOSE, threads=threads,
    )  # fmt: skip
    return [_best_branch(query, table, i) for i in range(len(targets))]


def _best_branch(query: _Query, table: Branches, pose: int) -> IkSolution | None:
    """The best branch of one pose inside the limits."""
    assert table.counts is not None
    own = table._replace(table=table.table[pose, : table.counts[pose]], counts=None)
    row, inside = own.nearest(query.near)
    if not inside:
        return None
    ranking = query.options.ranking
    if inside > 1 and ranking != "nearest":
        rows = own.within_limits.nonzero()[0]
        row = rows[order(query.chain, own.joints[rows], ranking, query.near, query.link)[0]]
    return _solution(own, row)
