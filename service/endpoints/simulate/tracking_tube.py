"""Clearance and limits of a tracked motion, from its tube and the reference's certificate."""

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeVar

import numpy as np

from kinematics.model.chain import Limits
from kinematics.trajectory.trajectory import Trajectory, interpolate
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene
from planning.proof.certificate import Certificate, certify
from planning.values.deadline import Deadline
from service.fields import picked
from tracking.simulation.integrators.global_error import LOST
from tracking.simulation.result import SimulationOutcome, SimulationResult
from tracking.tube.tube import Displacement, limit_uses, tube

_Part = TypeVar("_Part", str, tuple[str, str])

#: Between samples this close [s] the cubic misses an arm's motion by micrometres.
_DENSE = 0.0101
#: Shorter pieces of time are rounding errors [s].
_NO_TIME = 1e-9
#: Links are made thicker by so much at most [m]: a displacement beyond it leaves nothing clear.
_THICKEST = 1.0
#: An error of the integrator beyond this [rad or m] is not one of first order any more.
_LARGEST_ERROR = 1e-3
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
        clearance: Clearance of the reference [m].
        pair: The pair that this clearance is of.
        displacement: Displacement of the part that is displaced the most of those it holds for [m].
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
        result: Result of the simulation that tracked the motion.
        deadline: Deadline of all proofs.
    """
    # Only clearance matters here: /v1/validate holds motions to limits.
    chain = dataclasses.replace(arm.chain, limits=Limits.unlimited(arm.chain.n))
    free = dataclasses.replace(arm, chain=chain)
    certificate = certify(motion, free, scene, deadline=deadline)
    around = tube(arm, result.bounds)

    def from_obstacles(links: Mapping[str, Displacement]) -> Clearance:
        """Clearance of some links from obstacles, told at least as far as they are displaced."""
        far = max(item.distance for item in links.values())
        if not math.isfinite(far):
            return obstacle  # nothing is left of any clearance
        some = _only_links(free, set(links))
        proof = certify(motion, some, scene, margin=far, deadline=deadline)
        known = proof.violation is None or proof.violation.kind == "collision"
        return Clearance(proof.min_obstacle_clearance if known else 0.0, proof.obstacle_pair)

    def among_links(pairs: Mapping[tuple[str, str], Displacement]) -> Clearance:
        """Clearance of some pairs of the robot's own links."""
        return own_clearance(motion, free, pairs, deadline)

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
        "reference_clearance": certificate.min_clearance,
        "remaining_clearance": min(obstacles.distance, own_links.distance),
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


def own_clearance(
    motion: Trajectory,
    robot: RobotGeometry,
    pairs: Mapping[tuple[str, str], Displacement],
    deadline: Deadline,
) -> Clearance:
    """Clearance of some pairs of a robot's own links, told at least as far as they are displaced.

    A proof tells clearances up to a few centimetres. So one link of each pair is made thicker by
    the largest displacement: what is proved of the thick links holds for the real ones with this
    much more.

    Args:
        motion: The reference.
        robot: The robot.
        pairs: Pairs of links, and the displacement of the second as the first one sees it.
        deadline: Deadline of all proofs.
    """
    some = _only_pairs(robot, set(pairs))
    far = max(item.distance for item in pairs.values())
    thick = _thickened(some, {link for _, link in pairs}, far)
    if thick is not None:
        proof = certify(motion, thick, Scene(()), deadline=deadline)
        if proof.proved.collisions:
            return Clearance(proof.min_self_clearance + far, proof.self_pair)
    proof = certify(motion, some, Scene(()), deadline=deadline)
    return Clearance(proof.min_self_clearance if proof.proved.collisions else 0.0, proof.self_pair)


def _thickened(robot: RobotGeometry, links: set[str], by: float) -> RobotGeometry | None:
    """The robot with a ball added to some links; None where a mesh can't be made thicker.

    Args:
        robot: The robot.
        links: Names of the links.
        by: Radius of the ball [m].
    """
    chosen = [name in links for name in robot.links]
    parts = [piece for piece, is_chosen in zip(robot.pieces, chosen, strict=True) if is_chosen]
    if by > _THICKEST or any(piece.surface is not None for piece in parts):
        return None
    pieces = tuple(
        dataclasses.replace(piece, offset_radius=piece.offset_radius + by) if is_chosen else piece
        for piece, is_chosen in zip(robot.pieces, chosen, strict=True)
    )
    return dataclasses.replace(robot, pieces=pieces)


def remaining(
    clearance: Clearance,
    displacements: Mapping[_Part, Displacement],
    clearance_of: Callable[[Mapping[_Part, Displacement]], Clearance] | None,
) -> Remaining:
    """The least clearance that displacements leave of that of some parts of the robot.

    A part that is displaced by little is held against the clearance of its group, at first all;
    those that are displaced by much become a group of their own, whose clearance may be far
    larger: a hand moves more than the shoulder that is near the floor. A group of nothing else is
    cut into halves by displacement.

    Args:
        clearance: Clearance of all parts.
        displacements: Displacements by part: a link, or a pair of links.
        clearance_of: The clearance of some of the parts; None to take that of all for each.
    """
    worst = Remaining(clearance.distance, clearance.pair, 0.0, None, None, clearance.distance)
    groups = [(clearance, dict(displacements))]
    while groups:
        shared, parts = groups.pop()
        limit = _LARGE_LOSS * shared.distance
        large = {name: item for name, item in parts.items() if item.distance > limit}
        if clearance_of is None or len(parts) == 1:
            large = {}
        settled = {name: item for name, item in parts.items() if name not in large}
        if settled:
            name = max(settled, key=lambda name: settled[name].distance)
            worst = min(worst, _loss(shared, name, settled[name]), key=lambda item: item.distance)
        if large and clearance_of is not None:
            halves = [large] if settled else _halves(large)
            groups += [(clearance_of(half), half) for half in halves]
    return worst


def _halves(parts: Mapping[_Part, Displacement]) -> list[dict[_Part, Displacement]]:
    """The parts that are displaced less, and those that are displaced more."""
    order = sorted(parts, key=lambda name: parts[name].distance)
    middle = len(order) // 2
    return [{name: parts[name] for name in half} for half in (order[:middle], order[middle:])]


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
    error = float(result.bounds.global_error[0].max())
    if error > _LARGEST_ERROR:
        size = f"more than {LOST:g}" if error >= LOST else f"{error:.1g}"
        reason = (
            f"the closed loop amplifies errors of the integrator, which may have grown to {size} "
            "rad (or m): nothing is proved of an unstable loop; change the gains or simulate a "
            "shorter motion"
        )
        return [reason]
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
    told = picked(left, "clearance", "pair", "displacement")
    more = {"displaced_link": left.displaced, "seen_from": left.seen_from}
    return told | more | {"remaining": left.distance}


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
