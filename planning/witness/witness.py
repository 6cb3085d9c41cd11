"""Witness of a motion: one document from which a stranger proves it again, believing nothing.

It holds premises and hints. The premises (joints, solids, limits, polynomials, pairs that may
touch) are told exactly; the hints are directions that part solids over cells of time, and a wrong
one proves nothing. The format is defined in docs/witness.md.
"""

from itertools import groupby
from operator import itemgetter
from typing import Any

import numpy as np

from kinematics.arrays import Array, typed
from kinematics.errors import InvalidOption, InvalidTrajectory
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from obstacles.convex.piece import PieceKind
from obstacles.robots.allowed_pairs import allowed_pairs
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.constraints.constraint_set import ConstraintSet
from planning.proof.certificate import has_solids
from planning.proof.constraints.constraint_limits import constrained_margin
from planning.proof.limits.limits import check_limits
from planning.proof.premises import Premises
from planning.values.deadline import Deadline
from planning.values.limits import MotionLimits
from planning.witness.bound import Solids
from planning.witness.facts import Facts, Pairs, facts_of, pairs_of, solids_of

FORMAT, VERSION = "armwright-witness", 1
#: A frame is a rotation where no entry of R'R - 1 is larger.
_RIGID = 1e-12
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
    tool_motions: int = 0,
    deadline: Deadline | None = None,
) -> dict[str, Any]:
    """Witness of a motion, as a JSON document of the format in docs/witness.md.

    Nothing is proved here: what a checker can't follow is not covered, or told in ``unwitnessed``.

    Args:
        trajectory: Trajectory of all joints of the robot, in its order.
        robot: The arm with its geometry and what it holds.
        scene: The obstacles.
        margin: Distance to keep from obstacles beyond their own margins [m].
        limits: Limits in place of the robot's.
        constraints: Constraints of the path; they are counted, not witnessed, but for clearance.
        tool_motions: Number of motions that the tool has to keep to; they are counted likewise.
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
    facts = facts_of(trajectory, robot, scene, pairs, deadline)
    premises = Premises.of_cell(robot, scene, margin)
    bounds, untold = _limits(trajectory, robot.chain, wanted)
    effort = wanted.effort
    counts = {
        "jerk": trajectory.n if untold else 0,
        "constraints": len(constraints.constraints) if constraints else 0,
        "tool_motions": tool_motions,
        "torque": 0 if effort is None or effort.effort is None else len(effort.effort),
        "tool_speed": int(effort is not None and effort.tool_speed is not None),
        "solids": len(robot.unseen) if has_solids(robot) else 1,
        "touch_depth": sum(item.limited for item in allowed_pairs(robot, scene)),
    }
    return {
        "format": FORMAT,
        "version": VERSION,
        "hashes": {
            "robot": premises.robot_hash,
            "scene": premises.scene_hash,
            "trajectory": trajectory.content_hash,
        },
        "joints": _joints(robot.chain),
        "solids": _solids(robot, scene, solids, margin),
        "may_touch": [[*item.pair, item.reason] for item in allowed_pairs(robot, scene)],
        "limits": bounds,
        "knots": trajectory.breaks.tolist(),
        "polynomials": trajectory.coefficients.tolist(),
        "start": trajectory.start.tolist(),
        "goal": trajectory.end.tolist(),
        "cells": [list(cell) for cell in facts.cells],
        "facts": _facts(facts, pairs, solids),
        "unwitnessed": [
            *_unsettled(facts, pairs, robot, scene),
            *({"what": what, "count": count} for what, count in counts.items() if count),
        ],
    }


def _check(trajectory: Trajectory, chain: Chain, margin: float) -> None:
    if trajectory.joint_names != chain.joint_names:
        raise InvalidTrajectory(
            f"the trajectory is of the joints {', '.join(map(str, trajectory.joint_names))}",
            hint=f"Robot {chain.name!r} has, in this order: {', '.join(chain.joint_names)}.",
            joint_names=list(chain.joint_names),
        )
    if not 0.0 <= margin < np.inf:
        raise InvalidOption(f"margin is {margin}", hint="Give 0 or more [m].")
    frames = [*chain.offsets, *(mimic.T_parent_joint for mimic in chain.mimic_joints)]
    for T in frames:
        R = T[:3, :3]
        if not np.abs(R.T @ R - np.eye(3)).max() <= _RIGID:
            raise InvalidOption(
                f"a joint's frame in robot {chain.name!r} is no rotation to 12 digits",
                hint="Give rotations of the description with all their digits.",
            )


def _transform(T: Array) -> list[float]:
    return [float(value) for value in T[:3].reshape(-1)]


def _joints(chain: Chain) -> list[dict[str, Any]]:
    """Joints, each the mover of the body of its number."""
    own = [
        {
            "name": name,
            "kind": _JOINT_KINDS[kind],
            "parent": j - 1,
            "transform": _transform(chain.offsets[j]),
        }
        for j, (name, kind) in enumerate(zip(chain.joint_names, chain.joint_types, strict=True))
    ]
    followers = [
        {
            "name": mimic.name,
            "kind": _JOINT_KINDS[mimic.joint_type],
            "parent": mimic.parent,
            "transform": _transform(mimic.T_parent_joint),
            "follows": [mimic.leader, float(mimic.multiplier), float(mimic.offset)],
        }
        for mimic in chain.mimic_joints
    ]
    return own + followers


def _solids(
    robot: RobotGeometry, scene: Scene, solids: Solids, margin: float
) -> list[dict[str, Any]]:
    _, owners, margins = scene.pieces()
    names = [*robot.links, *(scene.ids[k] for k in owners)]
    keep = [0.0] * len(robot.links) + (margins + margin).tolist()
    rows = []
    for k, (name, body) in enumerate(zip(names, solids.body.tolist(), strict=True)):
        kind = PieceKind(int(solids.kinds[k]))
        radius, half_height, rounding = solids.sizes[k].tolist()
        row = {"name": name, "body": body, "kind": _SOLID_KINDS[kind]}
        row["transform"] = _transform(solids.poses[k])
        if kind == PieceKind.POLYTOPE:
            row["vertices"] = solids.columns[:, solids.starts[k] : solids.starts[k + 1]].T.tolist()
        elif kind != PieceKind.HALFSPACE:
            row |= {"radius": radius, "half_height": half_height}
        row["rounding"] = rounding
        rows.append(row if k < len(robot.links) else {**row, "margin": keep[k]})
    return rows


def _limits(
    trajectory: Trajectory, chain: Chain, wanted: MotionLimits
) -> tuple[dict[str, list[Any]], bool]:
    """Limits of each joint, None where there is none, and whether a jerk limit is left out."""
    limits = chain.limits
    told: dict[str, list[Any]] = {
        "position": [
            [_known(low), _known(high)]
            for low, high in zip(limits.lower, limits.upper, strict=True)
        ]
    }
    for name in _QUANTITIES:
        told[name] = [_known(v) for v in wanted.bounds.get(name, getattr(limits, name))]
    limited = any(value is not None for value in told["jerk"])
    reports, _, exceeded = check_limits(trajectory, limits, wanted)
    kept = "jerk" in reports and not exceeded
    if not kept:
        told["jerk"] = [None] * chain.n
    return told, limited and not kept


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _facts(facts: Facts, pairs: Pairs, solids: Solids) -> dict[str, list[Any]]:
    """Facts by their kind, those of a pair together."""
    order = np.lexsort([facts.within, facts.pairs])
    order = order[facts.known[order]]
    halfspace = (solids.kinds == PieceKind.HALFSPACE).tolist()
    both, cells = pairs.rows.tolist(), facts.within[order].tolist()
    ways = facts.directions[order].astype(np.int64).tolist()
    told: dict[str, list[Any]] = {"plane": [], "half-space": []}
    facts_of_pairs = groupby(
        zip(facts.pairs[order].tolist(), cells, ways, strict=True), key=itemgetter(0)
    )
    for number, group in facts_of_pairs:
        a, b = both[number]
        if halfspace[b]:
            told["half-space"].append([a, b, [cell for _, cell, _ in group]])
        else:
            told["plane"].append([a, b, [[cell, *way] for _, cell, way in group]])
    return told


def _unsettled(
    facts: Facts, pairs: Pairs, robot: RobotGeometry, scene: Scene
) -> list[dict[str, Any]]:
    """Pairs whose convex solids nothing parts over some cells: triangles decide, if anything."""
    names = [*robot.links, *(scene.ids[k] for k in scene.pieces()[1])]
    left = ~facts.known
    rows = []
    for number in np.unique(facts.pairs[left]):
        cells = facts.within[left & (facts.pairs == number)].tolist()
        a, b = pairs.rows[number].tolist()
        told = {"pair": [a, b], "names": [names[a], names[b]], "cells": cells}
        rows.append({"what": "pair", "count": len(cells), **told})
    return rows
