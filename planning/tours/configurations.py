"""Configurations of the goals of a tour: every branch that is free, or why there is none."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array
from kinematics.ik.closed_form.analytic import branches
from kinematics.ik.closed_form.structure import structure
from kinematics.ik.numeric import numeric
from kinematics.model.chain import Chain
from obstacles.collision.checker import Checker
from planning.constrained.path_constraints import end_violation
from planning.goal_choice.goal_order import is_at_limit
from planning.planner import TOUCHING
from planning.preflight.goals import find_goals
from planning.preflight.limits import goal_onto_limits
from planning.preflight.pose_configurations import inner_turns, with_inner_limits
from planning.problem import JointGoal, PoseGoal, Problem
from planning.reach.evaluation import parameter_values
from planning.result import Failure
from planning.tours.problem import MAX_CONFIGURATIONS, TourGoal, TourProblem
from planning.values.deadline import Deadline


class Configurations(NamedTuple):
    """Free configurations of one stop of a tour.

    Args:
        joints: Shape (k, n) [rad or m].
        alternatives: Number of the alternative each of them reaches, k numbers.
        clearances: Clearances of each of them, margins taken off, shape (k,) [m].
        posed: Whether each of them is of a pose, not asked for as joints, shape (k,).
    """

    joints: Array
    alternatives: tuple[int, ...]
    clearances: Array
    posed: NDArray[np.bool_]


class _Found(NamedTuple):
    """A free configuration (n,), the number of its alternative, and its clearance [m]."""

    joints: Array
    alternative: int
    clearance: float


def _together(goal: TourGoal, found: Sequence[_Found]) -> Configurations:
    """Configurations of a goal as arrays."""
    joints, alternatives, clearances = zip(*found, strict=True)
    posed = [isinstance(goal.alternatives[number], PoseGoal) for number in alternatives]
    return Configurations(
        np.array(joints), alternatives, np.array(clearances), np.array(posed, dtype=np.bool_)
    )


def find_configurations(
    problem: TourProblem, goal: TourGoal, checker: Checker, near: Array, seed: int,
    deadline: Deadline,
) -> Configurations | Failure:  # fmt: skip
    """Free configurations of a goal, or why there is none.

    Args:
        problem: The tour.
        goal: One of its goals.
        checker: The exact robot in the scene with its margins.
        near: Configuration that whole turns are to be near, shape (n,).
        seed: Seed of inverse kinematics.
        deadline: Time at which to check no more alternatives.
    """
    found: list[_Found] = []
    for number, alternative in enumerate(goal.alternatives):
        if isinstance(alternative, JointGoal):
            q, violation = goal_onto_limits(
                problem.robot.chain, alternative.joints, problem.start_state_tolerance
            )
            candidates = [q] if violation is None else []
        else:
            candidates = _of_pose(problem, goal, alternative, near, seed)
        for q in candidates:
            if end_violation(problem.constraints, "goal", q) is not None:
                continue
            # Configurations nearer than this in every joint are the same [rad or m].
            if any(np.abs(q - other.joints).max() <= 1e-6 for other in found):
                continue
            clearance = checker.clearance(q)[0]
            if clearance > TOUCHING:
                found.append(_Found(q, number, clearance))
    # Configurations of one goal: more hardly shorten a tour.
    most = max(min(32, MAX_CONFIGURATIONS // len(problem.goals)), 1)
    if found:
        joints = np.array([one.joints for one in found])
        chosen = _inside_first(problem.robot.chain, joints, near, most)
        return _together(goal, [found[k] for k in chosen])
    return _search_around_obstacles(problem, goal, checker, near, seed, deadline)


def _search_around_obstacles(
    problem: TourProblem, goal: TourGoal, checker: Checker, near: Array, seed: int,
    deadline: Deadline,
) -> Configurations | Failure:  # fmt: skip
    """Configurations of a goal found with the obstacles in sight, or why there is none."""
    found: list[_Found] = []
    failures: list[Failure] = []
    for number, alternative in enumerate(goal.alternatives):
        single = Problem(
            problem.robot, problem.scene, near, (alternative,), problem.margin,
            problem.start_state_tolerance,
        )  # fmt: skip
        answer = find_goals(single, checker, near, seed, deadline)
        if isinstance(answer, Failure):
            failures.append(answer)
            continue
        # Configurations taken of those that are found with the obstacles in sight.
        for candidate in answer[:4]:
            violation = end_violation(problem.constraints, "goal", candidate.joints)
            if violation is not None:
                failures.append(violation)
            else:
                found.append(_Found(candidate.joints, number, candidate.clearance))
    return _together(goal, found) if found else failures[0]


def _of_pose(
    problem: TourProblem, goal: TourGoal, pose: PoseGoal, near: Array, seed: int
) -> list[Array]:
    """Configurations of a pose with all its deviations, inside the limits."""
    chain = problem.robot.chain
    targets = pose.T_base_tip @ goal.tolerance.deviations()
    form = structure(chain)
    if form is not None:
        values = parameter_values(chain, form) if form.redundant else None
        answer = branches(chain, targets, seed_joints=near, parameters=values, threads=1)
        assert answer.counts is not None
        rows = [
            np.array(answer.joints[i, k])
            for i, count in enumerate(answer.counts)
            for k in range(count)
            if answer.within_limits[i, k]
        ]
        return [*rows, *_turned_inwards(chain, rows)]
    # Starts of inverse kinematics spent on them.
    options = numeric.SearchOptions(seed=seed, starts=60)
    # Deviations from a pose that such arms try: each takes milliseconds.
    searched_deviations = 4
    step = max(len(targets) // searched_deviations, 1)
    rows = []
    for T in targets[::step][:searched_deviations]:
        found = _searched(chain, T, options, near)
        if found and is_at_limit(chain, np.array(found)).any():
            found += _searched(with_inner_limits(chain), T, options, near)
        rows += found
    return [*rows, *_turned_inwards(chain, rows)]


def _searched(chain: Chain, T: Array, options: numeric.SearchOptions, near: Array) -> list[Array]:
    # Configurations searched for at each deviation from a pose, of arms without a closed form.
    found = numeric.solve(chain, T, options, seed_joints=near, solutions=8).solutions
    return [np.array(solution.joints) for solution in found]


def _turned_inwards(chain: Chain, rows: list[Array]) -> list[Array]:
    """Copies of configurations that a whole turn takes away from a limit."""
    return list(inner_turns(chain, np.array(rows))) if rows else []


def _inside_first(chain: Chain, joints: Array, near: Array, most: int) -> list[int]:
    """Numbers of configurations that stand for all of them, those away from limits first."""
    at_limit = is_at_limit(chain, joints)
    inside, outside = np.flatnonzero(~at_limit), np.flatnonzero(at_limit)
    chosen: list[int] = []
    for rows in (inside, outside):
        if len(rows) and len(chosen) < most:
            chosen += [int(rows[k]) for k in _spread(joints[rows], near, most - len(chosen))]
    return sorted(chosen)


def _spread(joints: Array, near: Array, most: int) -> list[int]:
    """Numbers of configurations that stand for all of them, the nearest one to ``near`` first.

    Each next one is the farthest from those chosen already.

    Args:
        joints: Shape (k, n).
        near: Shape (n,).
        most: How many at most.
    """
    if len(joints) <= most:
        return list(range(len(joints)))
    chosen = [int(np.abs(joints - near).max(axis=1).argmin())]
    distance = np.abs(joints - joints[chosen[0]]).max(axis=1)
    while len(chosen) < most:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.abs(joints - joints[chosen[-1]]).max(axis=1))
    return sorted(chosen)
