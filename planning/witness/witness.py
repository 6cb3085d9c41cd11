"""Witness of a motion: one document from which a stranger proves it again, believing nothing.

It holds premises and hints. The premises (joints, solids, limits, polynomials, pairs that may
touch) are told exactly; the hints are directions that part solids over cells of time, and a wrong
one proves nothing. The format is defined in docs/witness.md.

Facts of a witness: for each pair of solids, directions that part them over cells of time.

A cell whose pairs are not all settled (``bound``) is halved, for those pairs alone: of most pairs a
few cells cover all of the motion.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array, Indices, typed
from kinematics.caches.bounded_cache import bounded_cache
from kinematics.errors import InvalidOption, InvalidTrajectory
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from obstacles.convex.piece import PieceArrays, PieceKind
from obstacles.robots.allowed_pairs import AllowedPair, allowed_pairs
from obstacles.robots.robot_geometry import RobotGeometry, sorted_pair
from obstacles.scenes.scene import Scene
from planning.constraints.constraint_set import ConstraintSet
from planning.proof.collision.pair_table import joints_of
from planning.proof.collision.proposals import ProposalRows, packed_pieces
from planning.proof.constraints.constraint_limits import constrained_margin
from planning.proof.limits.limits import check_limits
from planning.proof.premises import Premises
from planning.values.deadline import Deadline
from planning.values.limits import MotionLimits
from planning.witness.bound import SETTLED, Search, Solids, search
from planning.witness.compact import Packed, Witness, packed

_CONE = int(PieceKind.CONE)
#: Cells are halved at most so often.
MAX_DEPTH = 16


class Pairs(NamedTuple):
    """Pairs of solids that have to stay apart (m pairs).

    Args:
        rows: The solids of each pair, the robot's first, shape (m, 2).
        needs: Distance to keep beyond 0, shape (m,) [m].
    """

    rows: Indices
    needs: Array


class Facts(NamedTuple):
    """Facts found (f of them).

    Args:
        cells: Begin and end of each cell, shape (c, 2) [s].
        rows: Two solids, cell, and direction in the frame of the body where both bodies meet, whole
            numbers, shape (f, 6).
        known: Whether the direction settles the pair; else nothing does, shape (f,).
    """

    cells: Array
    rows: Indices
    known: NDArray[np.bool_]


def solids_of(robot: RobotGeometry, scene: Scene) -> Solids:
    """Solids of a robot, each in the frame of its body, and behind them those of a scene."""
    blocks = robot.arrays, scene.pieces()[0]
    kinds, sizes, poses, centers, radii = (
        np.concatenate([getattr(block, name) for block in blocks])
        for name in ("kinds", "sizes", "poses", "centers", "radii")
    )
    columns = np.ascontiguousarray(np.concatenate([block.vertices for block in blocks]).T)
    starts = np.concatenate([blocks[0].starts, blocks[1].starts[1:] + blocks[0].starts[-1]])
    # Balls as checkers have them: a cone's is that of a cylinder.
    for k in np.flatnonzero(kinds == _CONE):
        centers[k], radii[k] = poses[k, :3, 3], np.hypot(*sizes[k, :2]) + sizes[k, 2]
    packed, e = packed_pieces(robot, scene, frozenset()), len(kinds)
    body, numbers = np.full(e, -1, dtype=np.int64), np.arange(e, dtype=np.int64)
    body[: len(robot.pieces)] = robot.joints
    return Solids(
        *joints_of(robot.chain), body, kinds, starts, columns, sizes, poses, centers, radii,
        ProposalRows(packed.rows, numbers, np.full(e, -1), packed.corners, packed.tables),
    )  # fmt: skip


def pairs_of(robot: RobotGeometry, scene: Scene, margin: float) -> Pairs:
    """All pairs of solids that neither robot nor scene allows to touch.

    Args:
        robot: The robot.
        scene: Scene around the robot.
        margin: Distance to keep from obstacles beyond their own margins [m].
    """
    _, owners, margins = scene.pieces()
    own, apart = _apart(robot, scene.ids, scene.allowed_collisions)
    first, second = np.nonzero(apart[:, owners])
    rows = np.empty((len(own) + len(first), 2), dtype=np.int64)
    rows[: len(own)], rows[len(own) :, 0] = own, first
    rows[len(own) :, 1] = second + len(robot.pieces)
    needs = np.zeros(len(rows))
    needs[len(own) :] = margins[second] + margin
    return Pairs(rows, needs)


@bounded_cache(maxsize=8)
def _apart(
    robot: RobotGeometry, ids: tuple[str, ...], allowed: frozenset[tuple[str, str]]
) -> tuple[Indices, NDArray[np.bool_]]:
    """Pairs of pieces (m, 2) that have to stay apart, and obstacles from pieces that move."""
    names = robot.links
    kept = [sorted_pair(names[a], names[b]) not in allowed for a, b in robot.self_pairs]
    rows = [[sorted_pair(link, name) not in allowed for name in ids] for link in names]
    apart = np.array(rows, dtype=np.bool_).reshape(len(names), len(ids))
    own = robot.self_pairs[np.array(kept, dtype=np.bool_)]
    return own, apart & (robot.joints >= 0)[:, None]


def facts_of(
    trajectory: Trajectory,
    solids: Solids,
    pairs: Pairs,
    deadline: Deadline | None = None,
) -> Facts:
    """Facts that settle pairs over all of a motion, and the cells where none was found.

    Args:
        trajectory: The motion.
        solids: The solids.
        pairs: The pairs.
        deadline: Instant from which on cells are left as they are.
    """
    motion, none = (trajectory.breaks, trajectory.coefficients), np.zeros(len(pairs.rows), np.int64)
    state = Search(
        0, none, np.arange(len(none)), np.zeros((len(none), 3)), np.empty((64, 2)),
        np.empty((1024, 7), np.int64), (0, 0),
    )  # fmt: skip
    while state.depth <= MAX_DEPTH and len(state.rows):
        late = deadline is not None and deadline.passed
        last = state.depth if late else MAX_DEPTH
        state = search(solids, motion, pairs.rows, pairs.needs, Search(*state), last)
    facts, (f, c) = state.facts, state.told
    return Facts(trajectory.duration * state.cells[:c], facts[:f, :6], facts[:f, 6] == SETTLED)


FORMAT, VERSION = "armwright-witness", 2
#: A frame is a rotation where no entry of R'R - 1 is larger.
_RIGID = 1e-12
_HALFSPACE = int(PieceKind.HALFSPACE)
_JOINT_KINDS = ("revolute", "prismatic")
_SOLID_KINDS = {
    PieceKind.POLYTOPE: "hull",
    PieceKind.CYLINDER: "cylinder",
    PieceKind.CONE: "cone",
    PieceKind.HALFSPACE: "half-space",
}
_QUANTITIES = ("velocity", "acceleration", "jerk")


@typed
def witness(
    trajectory: Trajectory,
    robot: RobotGeometry,
    scene: Scene,
    *,
    margin: float = 0.0,
    limits: MotionLimits | None = None,
    constraints: ConstraintSet | None = None,
    untold: Mapping[str, int] | None = None,
    deadline: Deadline | None = None,
) -> Witness:
    """Witness of a motion, in the format of docs/witness.md: ``compact`` bytes or a ``document``.

    Nothing is proved here: what a checker can't follow is not covered, or told in ``unwitnessed``.

    Args:
        trajectory: Trajectory of all joints of the robot, in its order.
        robot: The arm with its geometry and what it holds.
        scene: The obstacles.
        margin: Distance to keep from obstacles beyond their own margins [m].
        limits: Limits in place of the robot's.
        constraints: Constraints of the path; they are counted, not witnessed, but for clearance.
        untold: Counts of what else was proved of the motion and the format has no words for.
        deadline: Instant from which on no more directions are looked for.

    Raises:
        InvalidTrajectory: It is not of the joints of the robot, in its order.
        InvalidOption: The margin is negative, or frames of joints are no rotations.
    """
    wanted = limits or MotionLimits()
    scene.check_placed()
    _check(trajectory, robot.chain, margin)
    margin = constrained_margin(margin, constraints)
    solids, pairs = solids_of(robot, scene), pairs_of(robot, scene, margin)
    facts = facts_of(trajectory, solids, pairs, deadline)
    premises, ends = Premises.of_cell(robot, scene, margin), [0.0, trajectory.duration]
    start, goal = trajectory.sample(ends)
    bounds, broken = _limits(trajectory, robot.chain, wanted)
    effort = wanted.effort
    counts = {
        "jerk": trajectory.n if broken else 0,
        "constraints": len(constraints.constraints) if constraints else 0,
        "torque": 0 if effort is None or effort.effort is None else len(effort.effort),
        "tool_speed": int(effort is not None and effort.tool_speed is not None),
        "solids": len(robot.unseen) if robot.has_solids else 1,
        "touch_depth": sum(item.limited for item in allowed_pairs(robot, scene)),
        **(untold or {}),
    }
    fields = {
        "format": FORMAT,
        "version": VERSION,
        "hashes": {
            "robot": premises.robot_hash,
            "scene": premises.scene_hash,
            "trajectory": trajectory.content_hash,
        },
        "joints": _joints(robot.chain),
        "solids": [*_links(robot), *_obstacles(scene, margin)],
        "may_touch": _may_touch(allowed_pairs(robot, scene)),
        "limits": bounds,
        "knots": trajectory.breaks,
        "polynomials": trajectory.coefficients,
        "start": start,
        "goal": goal,
        "cells": facts.cells,
        "facts": _facts(facts, solids),
        "unwitnessed": [
            *_unsettled(facts, robot, scene),
            *({"what": what, "count": count} for what, count in counts.items() if count),
        ],
    }
    return Witness(fields)


def _check(trajectory: Trajectory, chain: Chain, margin: float) -> None:
    if trajectory.joint_names != chain.joint_names:
        raise InvalidTrajectory(
            f"the trajectory is of the joints {', '.join(map(str, trajectory.joint_names))}",
            hint=f"Robot {chain.name!r} has, in this order: {', '.join(chain.joint_names)}.",
            joint_names=list(chain.joint_names),
        )
    if not 0.0 <= margin < np.inf:
        raise InvalidOption(f"margin is {margin}", hint="Give 0 or more [m].")
    if not _rigid(chain):
        raise InvalidOption(
            f"a joint's frame in robot {chain.name!r} is no rotation to 12 digits",
            hint="Give rotations of the description with all their digits.",
        )


@bounded_cache(maxsize=8)
def _rigid(chain: Chain) -> bool:
    R = np.array([*chain.offsets, *(m.T_parent_joint for m in chain.mimic_joints)])[:, :3, :3]
    return bool(np.abs(R.swapaxes(1, 2) @ R - np.eye(3)).max() <= _RIGID)


@bounded_cache(maxsize=8)
def _joints(chain: Chain) -> Packed:
    """Joints, each the mover of the body of its number."""
    parents = range(-1, chain.n - 1)
    joints = zip(chain.joint_names, chain.joint_types, parents, chain.offsets, strict=True)
    followers = [
        _joint(mimic.name, mimic.joint_type, mimic.parent, mimic.T_parent_joint)
        | {"follows": [mimic.leader, float(mimic.multiplier), float(mimic.offset)]}
        for mimic in chain.mimic_joints
    ]
    return _packed([_joint(*joint) for joint in joints] + followers)


def _joint(name: str, kind: int, parent: int, T: Array) -> dict[str, Any]:
    transform = T[:3].reshape(-1)
    return {"name": name, "kind": _JOINT_KINDS[kind], "parent": parent, "transform": transform}


def _packed(value: Any) -> Packed:
    return Packed(value, packed(value))


@bounded_cache(maxsize=16)
def _may_touch(allowed: tuple[AllowedPair, ...]) -> Packed:
    return _packed([[*item.pair, item.reason] for item in allowed])


@bounded_cache(maxsize=8)
def _links(robot: RobotGeometry) -> tuple[Packed, ...]:
    """The robot's solids."""
    bodies, none = robot.joints.tolist(), [0.0] * len(robot.links)
    return tuple(_packed(row) for row in _solids(robot.arrays, robot.links, bodies, none))


def _obstacles(scene: Scene, margin: float) -> Iterator[dict[str, Any]]:
    """The scene's solids."""
    arrays, owners, margins = scene.pieces()
    ids, count = scene.ids, len(arrays)
    names = [ids[owner] for owner in owners.tolist()]
    return _solids(arrays, names, [-1] * count, (margins + margin).tolist())


def _solids(
    arrays: PieceArrays, names: Sequence[str], bodies: list[int], margins: list[float]
) -> Iterator[dict[str, Any]]:
    transforms, sizes, starts = arrays.poses[:, :3].reshape(-1, 12), arrays.sizes, arrays.starts
    columns = zip(
        names, bodies, arrays.kinds.tolist(), transforms, sizes.tolist(), margins,
        pairwise(starts.tolist()), strict=True,
    )  # fmt: skip
    for name, body, kind, transform, (radius, half, rounding), margin, (first, last) in columns:
        row = {"name": name, "body": body, "kind": _SOLID_KINDS[kind], "transform": transform}
        if kind == PieceKind.POLYTOPE:
            row["vertices"] = arrays.vertices[first:last]
        elif kind != PieceKind.HALFSPACE:
            row |= {"radius": radius, "half_height": half}
        row["rounding"] = rounding
        if margin:
            row["margin"] = margin
        yield row


def _limits(
    trajectory: Trajectory, chain: Chain, wanted: MotionLimits
) -> tuple[dict[str, Array], bool]:
    """Limits of each joint, NaN where there is none, and whether a jerk limit is left out."""
    limits = chain.limits
    told = {"position": _known(np.column_stack([limits.lower, limits.upper]))}
    for name in _QUANTITIES:
        told[name] = _known(wanted.bounds.get(name, getattr(limits, name)))
    limited = not np.isnan(told["jerk"]).all()
    kept = limited
    if limited:
        reports, _, exceeded = check_limits(trajectory, limits, wanted)
        kept = "jerk" in reports and not exceeded
    if not kept:
        told["jerk"] = np.full(chain.n, np.nan)
    return told, limited and not kept


def _known(values: Array) -> Array:
    return np.where(np.isfinite(values), values, np.nan)


def _facts(facts: Facts, solids: Solids) -> dict[str, Indices]:
    """Facts by their kind."""
    rows = facts.rows if facts.known.all() else facts.rows[facts.known]
    along = (solids.kinds == _HALFSPACE)[rows[:, 1]]
    return {"plane": rows[~along] if along.any() else rows, "half-space": rows[along, :3]}


def _unsettled(facts: Facts, robot: RobotGeometry, scene: Scene) -> list[dict[str, Any]]:
    """Pairs whose convex solids nothing parts over some cells: triangles decide, if anything."""
    names = [*robot.links, *(scene.ids[k] for k in scene.pieces()[1])]
    left, told = facts.rows[~facts.known], list[dict[str, Any]]()
    if not len(left):
        return told
    for a, b in np.unique(left[:, :2], axis=0).tolist():
        cells = left[(left[:, 0] == a) & (left[:, 1] == b), 2]
        row = {"what": "pair", "count": len(cells), "pair": np.array([a, b])}
        told.append(row | {"names": [names[a], names[b]], "cells": cells})
    return told
