"""Configurations in which the tool is at a target, free of collision and inside the limits."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from kinematics.arrays import Array, numbers, typed
from kinematics.errors import InvalidOption
from kinematics.ik.closed_form.analytic import branches, middle
from kinematics.ik.closed_form.structure import Structure, structure
from kinematics.ik.inverse import CLOSE
from kinematics.ik.numeric import numeric
from kinematics.model.chain import Chain
from kinematics.pose import from_axis_angle, inverse, transform
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import overlap_meter
from planning.goal_choice.goal_order import is_at_limit
from planning.planner import TOUCHING
from planning.preflight.pose_configurations import inner_turns, with_inner_limits
from planning.problem import JointGoal
from planning.reach.evaluation import parameter_values
from planning.sequence.stage import Grasp, Move, Place, Stage
from planning.sequence.world import Contact, World
from planning.values.deadline import Deadline

#: Starts of the search away from limits, and configurations that it searches for.
_INNER_STARTS, _INNER = 60, 8


class Outcome(StrEnum):
    """Outcome of a target; each one came nearer than those before."""

    OUT_OF_REACH = "out_of_reach"
    OUTSIDE_LIMITS = "outside_limits"
    IN_COLLISION = "in_collision"
    REACHED = "reached"


class Verdict(NamedTuple):
    """A target that was checked.

    Args:
        outcome: Outcome of the target.
        pair: Two bodies that collide, where all of its configurations do.
        joints: The configuration in which they do, shape (n,).
        why: Fault there, where they may touch and are too deep.
    """

    outcome: Outcome
    pair: tuple[str, str] | None = None
    joints: Array | None = None
    why: str | None = None


class Target(NamedTuple):
    """One of a stage's alternatives.

    Args:
        number: Index in the stage's list.
        T: T_root_tool, shape (4, 4); None where the joints are given.
        joints: Shape (n,), where they are given.
        contact: Contact between the tool and an object.
    """

    number: int
    T: Array | None
    joints: Array | None
    contact: Contact | None


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Valid configurations of some targets.

    Args:
        targets: Target of each configuration, its target; length k.
        joints: Shape (k, n) [rad or m].
        outcomes: Outcomes of each target that was checked, by its number, what came of it.
        level: Level of the values of a redundant arm's parameter that were tried.
        complete: Whether all targets were checked before the deadline.
        colliding: Some of the configurations of targets that all collide, shape (m, n).
        checker: Checker of collisions.
    """

    targets: tuple[Target, ...]
    joints: Array
    outcomes: dict[int, Verdict] = field(default_factory=dict)
    level: int = 0
    complete: bool = True
    colliding: tuple[Array, ...] = ()
    checker: Checker | None = None

    def joints_of(self, target: Target) -> Array:
        """Configurations of one of the targets, shape (k, n)."""
        return self.joints[[one.number == target.number for one in self.targets]]

    def least_overlap(self) -> tuple[float, tuple[str, str]] | None:
        """The least deep of the collisions [m], and its pair; None where nothing collides."""
        if self.checker is None or not self.colliding:
            return None
        return self.checker.least_overlap(np.array(self.colliding))


def stage_targets(stage: Stage, world: World, history: dict[int, Array]) -> list[Target]:
    """The alternatives of a stage, as poses of the tool or configurations.

    Args:
        stage: A stage that says where the tool has to be.
        world: The world before it.
        history: Configuration at the end of each earlier stage, by number.
    """
    if isinstance(stage, Grasp):
        T_object = world.scene.obstacle(stage.object).T_world_obstacle
        tools = T_object @ stage.frames
        return [
            Target(i, T, None, Contact(stage.object, frame, stage.supports, stage.touch_depth))
            for i, (T, frame) in enumerate(zip(tools, stage.frames, strict=True))
        ]
    if isinstance(stage, Place):
        assert stage.object is not None
        places = stage.poses
        if stage.reference is not None:
            places = world.scene.obstacle(stage.reference).T_world_obstacle @ places
        tools = places @ inverse(world.T_tool_object(stage.object))
        return [
            Target(i, T, None, Contact(stage.object, place, stage.supports, stage.touch_depth))
            for i, (T, place) in enumerate(zip(tools, places, strict=True))
        ]
    assert isinstance(stage, Move)
    if stage.to_end_of is not None:
        return [Target(0, None, history[stage.to_end_of], None)]
    return [
        Target(i, None, np.array(goal.joints), None)
        if isinstance(goal, JointGoal)
        else Target(i, np.array(goal.T_base_tip), None, None)
        for i, goal in enumerate(stage.goals)
    ]


def target_count(stage: Stage) -> int:
    """Number of a stage's alternatives."""
    if isinstance(stage, Grasp):
        return len(stage.frames)
    if isinstance(stage, Place):
        return len(stage.poses)
    return max(len(stage.goals), 1) if isinstance(stage, Move) else 0


def find_candidates(
    chain: Chain, targets: list[Target], checker: Checker, deadline: Deadline, seed: int,
    level: int = 0,
) -> Candidates:  # fmt: skip
    """Valid configurations of targets: every branch of the closed form, or those of a search.

    Args:
        chain: The robot.
        targets: The alternatives.
        checker: Checker of the robot with what it holds, in its scene.
        deadline: Time at which to check no more targets.
        seed: Seed of the numeric search.
        level: Level of the values of a redundant arm's parameter that are tried.
    """
    rows: list[Array] = []
    owners: list[Target] = []
    outcomes: dict[int, Verdict] = {}
    colliding: list[Array] = []
    form = structure(chain)
    # Poses whose branches are tabulated at once.
    chunk = 64
    for first in range(0, len(targets), chunk):
        if deadline.passed:
            break
        part = targets[first : first + chunk]
        for target, (reached, joints) in zip(
            part, _solutions(chain, form, part, (seed, level)), strict=True
        ):
            valid, outcomes[target.number] = _assess(checker, reached, joints)
            rows += valid
            owners += [target] * len(valid)
            if outcomes[target.number].outcome is Outcome.IN_COLLISION:
                # Configurations that collide of which one list of targets keeps so many.
                colliding.extend(joints[: max(240 - len(colliding), 0)])
    joints = np.array(rows).reshape(-1, chain.n)
    complete = len(outcomes) == len(targets)
    return Candidates(tuple(owners), joints, outcomes, level, complete, tuple(colliding), checker)


def _solutions(
    chain: Chain, form: Structure | None, targets: list[Target], how: tuple[int, int]
) -> list[tuple[bool, Array]]:
    """For each target whether some branch reaches it, and the configurations inside the limits.

    Args:
        chain: The robot.
        form: Its closed form; None where it has none.
        targets: The alternatives.
        how: Seed of the numeric search, and level of a redundant arm's parameter.
    """
    answers: list[tuple[bool, Array]] = [
        (True, _inside(chain, np.atleast_2d(np.asarray(target.joints, dtype=np.float64))))
        if target.joints is not None
        else (False, np.zeros((0, chain.n)))
        for target in targets
    ]
    posed = [k for k, target in enumerate(targets) if target.T is not None]
    if posed:
        T = np.array([targets[k].T for k in posed])
        solved = (
            _by_search(chain, T, how[0])
            if form is None
            else _by_closed_form(chain, form, T, how[1])
        )
        for k, answer in zip(posed, solved, strict=True):
            answers[k] = answer
    return answers


def _by_closed_form(
    chain: Chain, form: Structure, T: Array, level: int
) -> list[tuple[bool, Array]]:
    values = parameter_values(chain, form, level) if form.redundant else None
    table = branches(chain, T, parameters=values, tolerance=CLOSE, threads=1)
    assert table.counts is not None
    answers = []
    for k, count in enumerate(table.counts):
        rows = table.table[k, :count]
        inside = rows[table.within_limits[k, :count], : chain.n]
        # A way along which a joint would go beyond its limit may be free a whole turn away.
        answers.append((count > 0, np.concatenate([inside, inner_turns(chain, inside)])))
    return answers


def _by_search(chain: Chain, T: Array, seed: int) -> list[tuple[bool, Array]]:
    low, high = chain.sampling_bounds()
    random = np.random.default_rng(seed)
    found: list[list[Array]] = [[] for _ in T]
    # Rounds of the numeric search for arms without a closed form, each from other starts.
    for k in range(4):
        begin = middle(chain) if k == 0 else random.uniform(low, high)
        # Starts of each round.
        batch = numeric.solve_many(
            chain, T, numeric.SearchOptions(seed + k, 30), seed_joints=begin, threads=1
        )
        for i in np.flatnonzero(batch.solved):
            q = batch.joints[i]
            # Configurations nearer than this to another one are the same [rad or m].
            if all(np.abs(q - other).max() > 1e-3 for other in found[i]):
                found[i].append(q)
    joints = [np.array(rows).reshape(-1, chain.n) for rows in found]
    return [
        (bool(len(rows)), np.concatenate([rows, _away_from_limits(chain, pose, rows, seed)]))
        for pose, rows in zip(T, joints, strict=True)
    ]


def _away_from_limits(chain: Chain, T: Array, found: Array, seed: int) -> Array:
    """More configurations of a pose, away from limits, where one that was found is at one, (m, n).

    Args:
        chain: The robot.
        T: T_base_tip, shape (4, 4).
        found: Configurations that were found, shape (k, n).
        seed: Seed of the search.
    """
    if not is_at_limit(chain, found).any():
        return found[:0]
    options = numeric.SearchOptions(seed, _INNER_STARTS)
    inner = with_inner_limits(chain)
    solutions = numeric.solve(
        inner, T, options, seed_joints=middle(inner), solutions=_INNER
    ).solutions
    rows = [inner_turns(chain, found), *(s.joints[None] for s in solutions)]
    return np.concatenate(rows)


def _inside(chain: Chain, joints: Array) -> Array:
    limits = chain.limits
    inside = ((joints >= limits.lower) & (joints <= limits.upper)).all(axis=1)
    return np.asarray(joints[inside])


def _assess(checker: Checker, reached: bool, joints: Array) -> tuple[list[Array], Verdict]:
    """The valid configurations of a target, and what came of it."""
    if not len(joints):
        outcome = Outcome.OUTSIDE_LIMITS if reached else Outcome.OUT_OF_REACH
        return [], Verdict(outcome)
    # Slack that configurations keep where any of their target does [m]: paths end there.
    touching, spacious = Checker(checker.model, TOUCHING), Checker(checker.model, 2e-4)
    valid = [q for q in joints if touching.valid(q)]
    meter = overlap_meter(checker.model.robot, checker.model.scene)
    deep = [meter.too_deep(q) for q in valid]
    if valid and all(deep):
        item, depth = deep[0][0]
        return [], Verdict(Outcome.IN_COLLISION, item.pair, valid[0], item.deeper(depth)[0])
    valid = [q for q, found in zip(valid, deep, strict=True) if not found]
    if not valid:
        return [], Verdict(Outcome.IN_COLLISION, checker.clearance(joints[0])[1], joints[0])
    return [q for q in valid if spacious.valid(q)] or valid, Verdict(Outcome.REACHED)


@typed
def grasp_region(
    T_object_tool: ArrayLike,
    axis: Sequence[float],
    angles: tuple[float, float],
    offsets: tuple[float, float] = (0.0, 0.0),
    samples: tuple[int, int] = (18, 1),
) -> Array:
    """Grasps about an axis of the object: T = Trans(d a) Rot(a, phi) T_object_tool.

    Args:
        T_object_tool: The grasp at angle 0 and offset 0, shape (4, 4).
        axis: Direction through the object's origin, in its frame, shape (3,).
        angles: Least and largest angle phi about it [rad].
        offsets: Least and largest way d along it [m].
        samples: Numbers of angles and of offsets.

    Returns:
        Shape (k, 4, 4), the angles change fastest.

    Raises:
        InvalidOption: The axis has no direction, a range is empty, or there are no samples.
    """
    direction = numbers(axis, "axis", (3,))
    length = float(np.linalg.norm(direction))
    if not length > 0.0:
        raise InvalidOption("the axis of a region has no direction", hint="Give a unit vector.")
    direction = direction / length
    base = numbers(T_object_tool, "T_object_tool", (4, 4))
    return np.array(
        [
            transform(from_axis_angle(direction, phi), d * direction) @ base
            for d, phi in product(_values(offsets, samples[1]), _angles(angles, samples[0]))
        ]
    )


@typed
def place_region(
    T_reference_object: ArrayLike,
    size: tuple[float, float],
    angles: tuple[float, float],
    samples: tuple[int, int, int] = (3, 3, 4),
) -> Array:
    """Poses of an object on a rectangle: T = T_reference_object Trans(x, y, 0) Rz(phi).

    Args:
        T_reference_object: The pose at the middle of the rectangle, its z across it, shape (4, 4).
        size: Lengths of the rectangle along x and y of that pose [m].
        angles: Least and largest angle phi about its z [rad].
        samples: Numbers along x, along y and of angles.

    Returns:
        Shape (k, 4, 4), nearest to the middle first.

    Raises:
        InvalidOption: A range is empty, or there are no samples.
    """
    base = numbers(T_reference_object, "T_reference_object", (4, 4))
    xs, ys = (
        _values((-0.5 * length, 0.5 * length), count)
        for length, count in zip(size, samples, strict=False)
    )
    offsets = sorted(product(xs, ys), key=lambda at: (at[0] ** 2 + at[1] ** 2, at))
    z = np.array([0.0, 0.0, 1.0])
    return np.array(
        [
            base @ transform(from_axis_angle(z, phi), [x, y, 0.0])
            for x, y in offsets
            for phi in _angles(angles, samples[2])
        ]
    )


def _values(ends: tuple[float, float], count: int) -> list[float]:
    low, high = numbers(ends, "a region's range", (2,)).tolist()
    if not low <= high:
        raise InvalidOption(f"a region's range is from {low:g} to {high:g}", hint="Swap its ends.")
    if count < 1:
        raise InvalidOption("a region needs one sample at least")
    if count == 1 or low == high:
        return [0.5 * (low + high)]
    return [float(value) for value in np.linspace(low, high, count)]


def _angles(ends: tuple[float, float], count: int) -> list[float]:
    low, high = numbers(ends, "a region's range", (2,)).tolist()
    # A range this near to a whole turn is one: both its ends are the same angle [rad].
    if high - low > 2.0 * np.pi - 1e-9 and count > 1:
        return _values((low, high - (high - low) / count), count)
    return _values(ends, count)
