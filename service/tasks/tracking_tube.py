"""Clearance and limits of a tracked motion, from its tube and the reference's certificate."""

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeVar

import numpy as np

from kinematics.chain import Limits
from kinematics.interpolation import interpolate
from kinematics.trajectory import Trajectory
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Scene
from planning.deadline import Deadline
from planning.proof.certificate import Certificate, certify
from tracking.limit_use import limit_uses
from tracking.result import SimulationOutcome, SimulationResult
from tracking.tube import Displacement, tube

_Part = TypeVar("_Part", str, tuple[str, str])

#: Between samples this close [s] the cubic misses an arm's motion by micrometres.
_DENSE = 0.0101
#: Shorter pieces of time are rounding errors [s].
_NO_TIME = 1e-9
#: Parts that lose more than this share of a clearance get a clearance of their own.
_LARGE_LOSS = 0.5


class Clearance(NamedTuple):
    """Clearance of some parts of a robot along the reference.

    Args:
        distance: A lower bound [m], infinite with nothing to hit.
        pair: The pair that comes nearest.
    """

    distance: float
    pair: tuple[str, str] | None


class Remaining(NamedTuple):
    """The parts whose clearance is left the least by the displacement.

    Args:
        clearance: Of the reference [m].
        pair: The pair that this clearance is of.
        displacement: Of the part that is displaced the most of those it holds for [m].
        displaced: The link that is displaced.
        seen_from: The link that sees it; None for the base.
        distance: Clearance less displacement [m].
    """

    clearance: float
    pair: tuple[str, str] | None
    displacement: float
    displaced: str | None
    seen_from: str | None
    distance: float


def tube_answer(
    arm: RobotGeometry,
    scene: Scene,
    motion: Trajectory,
    result: SimulationResult,
    deadline: Deadline,
) -> dict[str, Any]:
    """Tracking tube, with the clearance that it leaves of the reference's.

    Args:
        arm: The robot with what it holds.
        scene: The obstacles.
        motion: The reference.
        result: How it was tracked.
        deadline: When to give up proving.
    """
    # Only clearance matters here: /v1/validate holds motions to limits.
    chain = dataclasses.replace(arm.chain, limits=Limits.unlimited(arm.chain.n))
    free = dataclasses.replace(arm, chain=chain)
    certificate = certify(motion, free, scene, deadline=deadline)
    around = tube(arm, result.bounds)

    def from_obstacles(links: Mapping[str, Displacement]) -> Clearance:
        """Clearance of some links from obstacles, told at least as far as they are displaced."""
        far = max(item.distance for item in links.values())
        some = _only_links(free, set(links))
        proof = certify(motion, some, scene, margin=far, deadline=deadline)
        known = proof.violation is None or proof.violation.kind == "collision"
        return Clearance(proof.min_obstacle_clearance if known else 0.0, proof.obstacle_pair)

    def among_links(pairs: Mapping[tuple[str, str], Displacement]) -> Clearance:
        """Clearance of some pairs of the robot's own links."""
        proof = certify(motion, _only_pairs(free, set(pairs)), Scene(()), deadline=deadline)
        known = proof.proved.collisions
        return Clearance(proof.min_self_clearance if known else 0.0, proof.self_pair)

    obstacle = Clearance(certificate.min_obstacle_clearance, certificate.obstacle_pair)
    own = Clearance(certificate.min_self_clearance, certificate.self_pair)
    is_certified = certificate.proved.collisions
    obstacles = remaining(obstacle, around.links, from_obstacles if is_certified else None)
    own_links = remaining(own, around.pairs, among_links if is_certified else None)
    reasons = _reasons(result, certificate, obstacles, own_links)
    return {
        "joint_error": around.joint_error.tolist(),
        "reach": around.reach.tolist(),
        "displacement": around.displacement,
        "reference_clearance": _finite(certificate.min_clearance),
        "remaining_clearance": _finite(min(obstacles.distance, own_links.distance)),
        "obstacles": _remaining_answer(obstacles),
        "own_links": _remaining_answer(own_links),
        "limits": {
            name: {"ratio": use.ratio, "joint": chain.joint_names[use.joint]}
            for name, use in limit_uses(result.bounds, arm.chain.limits).items()
        },
        "tracked_clearance": _tracked_clearance(free, scene, result, deadline),
        "clears": not reasons,
        "reason": "; ".join(reasons) or None,
    }


def remaining(
    clearance: Clearance,
    displacements: Mapping[_Part, Displacement],
    clearance_of: Callable[[Mapping[_Part, Displacement]], Clearance] | None,
) -> Remaining:
    """The least clearance that displacements leave of that of some parts of the robot.

    A part that is displaced by little is held against the clearance of all; those that are
    displaced by much against their own, which may be far larger: a hand moves more than the
    shoulder that is near the floor.

    Args:
        clearance: Of all parts.
        displacements: By part: a link, or a pair of links.
        clearance_of: The clearance of some of the parts; None to take that of all for each.
    """
    worst = Remaining(clearance.distance, clearance.pair, 0.0, None, None, clearance.distance)
    parts, asked = dict(displacements), set[_Part]()
    while parts:
        limit = _LARGE_LOSS * clearance.distance
        large = {name: item for name, item in parts.items() if item.distance > limit}
        if clearance_of is None or set(large) == asked:
            large = {}
        settled = {name: item for name, item in parts.items() if name not in large}
        if settled:
            name = max(settled, key=lambda name: settled[name].distance)
            worst = min(
                worst, _loss(clearance, name, settled[name]), key=lambda item: item.distance
            )
        parts = large
        if large and clearance_of is not None:
            clearance, asked = clearance_of(large), set(large)
    return worst


def _loss(clearance: Clearance, part: str | tuple[str, str], moved: Displacement) -> Remaining:
    seen_from, link = (None, part) if isinstance(part, str) else part
    left = clearance.distance - moved.distance
    return Remaining(*clearance, moved.distance, link, seen_from, left)


def _only_links(robot: RobotGeometry, links: set[str]) -> RobotGeometry:
    """The robot with the solids of some links only, held against obstacles alone."""
    chosen = [k for k, name in enumerate(robot.links) if name in links]
    names = sorted(links)
    every = {(a, b): "same body" for i, a in enumerate(names) for b in names[i + 1 :]}
    return RobotGeometry(
        robot.chain,
        tuple(robot.pieces[k] for k in chosen),
        tuple(robot.links[k] for k in chosen),
        robot.joints[chosen],
        robot.solids[chosen],
        every,
    )


def _only_pairs(robot: RobotGeometry, pairs: set[tuple[str, str]]) -> RobotGeometry:
    """The robot with all pairs of its links allowed to touch but some."""
    names = sorted(set(robot.links))
    every = {(a, b): "same body" for i, a in enumerate(names) for b in names[i + 1 :]}
    for a, b in pairs:
        every.pop((min(a, b), max(a, b)), None)
    return dataclasses.replace(robot, allowed=every)


def _reasons(
    result: SimulationResult, certificate: Certificate, obstacles: Remaining, own: Remaining
) -> list[str]:
    """Why the tracked motion is not proved to clear everything, with the cure; empty if it is."""
    if result.outcome is not SimulationOutcome.COMPLETED:
        return [f"the simulation did not reach the end: {result.outcome.value}"]
    if certificate.violation is not None:
        return [f"the reference itself is not certified: {certificate.violation.message}"]
    reasons = []
    if not obstacles.distance > 0.0:
        reasons.append(
            f"{_numbers(obstacles)}: track better (higher gains, a better model), or plan with a "
            f"margin larger by more than {-obstacles.distance:.3g} m"
        )
    if not own.distance > 0.0:
        reasons.append(
            f"{_numbers(own)}: track better (higher gains, a better model), or choose a start, a "
            "goal or a path that keeps these links farther apart; a margin does not concern them"
        )
    return reasons


def _numbers(left: Remaining) -> str:
    """The clearance and the displacement of what may collide, as a clause."""
    pair = "what is nearest" if left.pair is None else f"{left.pair[0]!r} and {left.pair[1]!r}"
    return (
        f"{pair} may come within {left.clearance:.3g} m on the reference, and {left.displaced!r} "
        f"may be displaced by {left.displacement:.3g} m"
    )


def _remaining_answer(left: Remaining) -> dict[str, Any]:
    return {
        "clearance": _finite(left.clearance),
        "pair": left.pair,
        "displacement": left.displacement,
        "displaced_link": left.displaced,
        "seen_from": left.seen_from,
        "remaining": _finite(left.distance),
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _tracked_clearance(
    free: RobotGeometry, scene: Scene, result: SimulationResult, deadline: Deadline
) -> float | None:
    """Certified clearance of the cubic through the samples; None where they are too far apart."""
    steps = np.diff(result.times)
    if len(steps) == 0 or steps.max() > _DENSE:
        return None
    # The end may come right after the last regular sample: a piece of no length is none.
    kept = np.append(True, steps > _NO_TIME)
    tracked = interpolate(
        free.chain.joint_names,
        result.times[kept],
        result.position[kept],
        "cubic",
        result.velocity[kept],
    )
    certificate = certify(tracked, free, scene, deadline=deadline)
    violation = certificate.violation
    if violation is not None and violation.kind == "time":
        return None
    return certificate.min_clearance if math.isfinite(certificate.min_clearance) else None
