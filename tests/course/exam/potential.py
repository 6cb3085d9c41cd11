"""Lectures 18 and 19: attraction, repulsion, their slope in joint space, descents."""

from collections.abc import Callable, Iterator
from functools import partial
from math import pi
from typing import Any

import numpy as np

from tests.course.exam.arms import Arm, Array, planar, random_arm
from tests.course.exam.question import At, Question, split

#: A point (link, point on it) that is pulled and pushed.
Point = tuple[int, tuple[float, float, float]]


#: An obstacle as the request has it, and the projection onto it.
Obstacle = tuple[dict[str, Any], Callable[[Array], Array]]


def ball(centre: Any, radius: float) -> Obstacle:
    c = np.asarray(centre, dtype=float)
    shape = {"shape": {"type": "sphere", "radius": radius}, "pose": {"position": c}}
    return {"id": "ball"} | shape, lambda p: c + radius * (p - c) / np.linalg.norm(p - c)


def box(centre: Any, size: float) -> Obstacle:
    c, edges = np.asarray(centre, dtype=float), np.array([1.0, 0.7, 1.4]) * size
    shape = {"shape": {"type": "box", "size": edges}, "pose": {"position": c}}
    return {"id": "box"} | shape, lambda p: np.clip(p, c - edges / 2, c + edges / 2)


def wall(centre: Any, _size: float) -> Obstacle:
    """All points behind a plane through the centre, seen from the origin."""
    c = np.asarray(centre, dtype=float)
    normal = -c / np.linalg.norm(c)
    shape = {"type": "halfspace", "normal": normal, "offset": normal @ c}
    obstacle = {"id": "wall", "shape": shape, "pose": {"position": [0, 0, 0]}}
    return obstacle, lambda p: p - normal * (normal @ (p - c))


class Field:
    """U and its forces on the origins of an arm, or on points of its own.

    Args:
        arm: The arm.
        goal: Configuration at the goal.
        weights: c and η of each point.
        cap: d, where the attraction no longer grows.
        reach: ρ₀.
        obstacles: Projections onto them.
        points: Pulled and pushed, the origins if left out.
    """

    def __init__(
        self, arm: Arm, goal: Any, weights: Any, cap: float, reach: float, *obstacles: Any,
        points: list[Point] | None = None,
    ) -> None:  # fmt: skip
        self.arm, self.goal, self.cap, self.reach, self.obstacles = arm, goal, cap, reach, obstacles
        self.points = points or [(i + 1, (0.0, 0.0, 0.0)) for i in range(arm.n)]
        self.c, self.eta = (np.broadcast_to(w, len(self.points)) for w in weights)

    def places(self, q: Any) -> Array:
        links = self.arm.chain(q)[1]
        return np.array([links[i][:3, 3] + links[i][:3, :3] @ np.array(p) for i, p in self.points])

    def attraction(self, q: Any) -> Array:
        e = self.places(q) - self.places(self.goal)
        far = np.linalg.norm(e, axis=1)
        return -self.c[:, None] * e * np.minimum(1.0, self.cap / np.maximum(far, 1e-300))[:, None]

    def repulsion(self, q: Any) -> Array:
        F = np.zeros((len(self.points), 3))
        for i, p in enumerate(self.places(q)):
            for project in self.obstacles:
                away = p - project(p)
                rho = np.linalg.norm(away)
                if rho <= self.reach:
                    F[i] += self.eta[i] * (1 / rho - 1 / self.reach) / rho**3 * away
        return F

    def potential(self, q: Any) -> float:
        total = 0.0
        ends = self.places(self.goal)
        for i, p in enumerate(self.places(q)):
            e = float(np.linalg.norm(p - ends[i]))
            total += self.c[i] * (e**2 / 2 if e <= self.cap else self.cap * e - self.cap**2 / 2)
            for project in self.obstacles:
                rho = float(np.linalg.norm(p - project(p)))
                total += self.eta[i] / 2 * max(0.0, 1 / rho - 1 / self.reach) ** 2
        return total

    def force(self, q: Any) -> Array:
        F = self.attraction(q) + self.repulsion(q)
        return sum(
            self.arm.jacobian(q, i, p)[:3].T @ f for (i, p), f in zip(self.points, F, strict=True)
        )

    def descend(self, q: Any, step: float, number: int) -> Array:
        """qᵏ of lecture 19 at a fixed step size."""
        for _ in range(number):
            q = q + step * self.force(q)
        return q


def points(key: str) -> Any:
    return lambda found: [p[key] for p in found["control_points"]]


def projections(rng: np.random.Generator) -> Iterator[Question]:
    """Projections onto convex sets."""
    arm, rest = planar([0.5, 0.4]), [0.0, 0.0]
    for make, size in ((ball, 0.2), (box, 0.3), (wall, 0.1)):
        for _ in range(2):
            q, (obstacle, project) = rng.uniform(-pi, 0.0, 2), make(rng.uniform(0.5, 0.9, 3), size)
            right = [project(H[:3, 3]) for H in arm.chain(q)[1][1:-1]]
            at, more = At(arm.table(), q), {"scene": {"obstacles": [obstacle]}}
            pick = points("projection")
            yield at(18, "projection", "potential", pick, right, goal_joints=rest, **more)


def fields(rng: np.random.Generator) -> Iterator[Question]:
    """The potential, its forces and its slope."""
    for kinds in ("RR", "RRR", "RRP", "PRR", "RRRRRR"):
        arm = random_arm(rng, kinds)
        q, goal = rng.uniform(-1, 1, (2, arm.n))
        at, tip, cap, reach = At(arm.table(), q), arm.tip(q)[:3, 3], 0.3, 0.6
        weights = rng.uniform(0.5, 2, arm.n), rng.uniform(0.001, 0.02, arm.n)
        options = {"attractive_cap": cap, "influence_distance": reach}
        both = ("attractive_weights", "repulsive_weights")
        weighted = options | dict(zip(both, weights, strict=True))
        round_, square, flat = (
            make(tip * far + [0.3, 0.1, 0.25], size)
            for make, far, size in ((ball, 1.0, 0.1), (box, 1.1, 0.2), (wall, 1.5, 0.0))
        )
        for chosen in ([round_], [round_, square], [flat]):
            field = Field(arm, goal, weights, cap, reach, *(project for _, project in chosen))
            more = {"goal_joints": goal, "options": weighted, "tolerance": 1e-7}
            more |= {"scene": {"obstacles": [one for one, _ in chosen]}}
            pick, right = points("repulsive_force"), partial(field.repulsion, q)
            yield at(18, "repulsive forces", "potential", pick, right, **more)
            pick, right = points("attractive_force"), partial(field.attraction, q)
            yield at(18, "attractive forces", "potential", pick, right, **more)
            yield at(18, "U", "potential", "potential", partial(field.potential, q), **more)
            yield at(19, "joint force", "potential", "joint_force", partial(field.force, q), **more)
        own: list[Point] = [(1, (0.05, 0.0, 0.1)), (arm.n, (-0.1, 0.05, 0.0))]
        field = Field(arm, goal, (1.0, 0.01), cap, reach, round_[1], points=own)
        named = [{"link": f"link_{i}", "point": p} for i, p in own]
        more["options"] = options | {"repulsive_weights": 0.01, "control_points": named}
        more |= {"scene": {"obstacles": [round_[0]]}, "issue": 1}
        right = partial(field.force, q)
        yield at(19, "control points of its own", "potential", "joint_force", right, **more)


def plan(kind: str, arm: Arm, ends: Any, obstacle: Any, pick: str, right: Any, **more: Any) -> Any:
    """A question of a descent by the planner of potential fields."""
    judged, asked = split(more)
    body = {"start": {"joints": ends[0]}, "goal": {"joints": ends[1]}, "robot": "{}"} | asked
    body |= {"planner": "potential_field", "scene": {"obstacles": [obstacle]}}
    table = arm.table(geometry={"capsules": 0.005}) if judged["issue"] == 5 else arm.table()
    return Question(19, kind, "plan", body, pick, right, table, **judged)


def descents(rng: np.random.Generator) -> Iterator[Question]:
    """Descents of tables without solids, and why they end."""
    step, number = 0.05, 6
    for kinds in ("RR", "RRR", "RRRR", "PR", "RRP"):
        arm = planar(rng.uniform(0.3, 0.6, len(kinds)))
        arm = random_arm(rng, kinds) if "P" in kinds else arm
        ends = q, goal = np.full(arm.n, -0.4), np.full(arm.n, 0.7)
        obstacle, project = ball(arm.tip(q)[:3, 3] + [0.1, 0.12, 0.15], 0.08)
        field = Field(arm, goal, (1.0, 2e-3), 0.2, 0.4, project)
        options = {"keep_path": True, "step_sizes": step, "longest_step": 10.0}
        options |= {"repulsive_weights": 2e-3, "influence_distance": 0.4, "max_iterations": number}
        for ignored in ({}, {"collisions": "ignore"}):
            # The few steps are used up: what was visited is in the details.
            more: Any = {"planner_options": options, "refused": True, "issue": 1} | ignored
            pick, right = f"details.potential_field.joints.{number}", field.descend(q, step, number)
            yield plan("descent without solids", arm, ends, obstacle, pick, right, **more)
            pick = f"details.potential_field.potentials.{number}"
            right = field.potential(right)
            yield plan("U without solids", arm, ends, obstacle, pick, right, **more)
            more |= {"planner_options": {"keep_path": True, "max_iterations": 4000}}
            away, pick = ball([0.0, 0.0, 1.9], 0.1)[0], "certificate.proved.collisions"
            if "P" not in kinds:
                more["refused"] = False
                yield plan("without solids not proved free", arm, ends, away, pick, False, **more)
    # Joint 1 is driven against its range, and nothing else pulls: a minimum inside the limits.
    for lengths, bend in (((0.6, 0.4), 0.9), ((0.5, 0.5), 0.7), ((0.4, 0.4, 0.3), 0.8)):
        arm, rest = planar(lengths, limits=(1.0, 3.0)), np.zeros(len(lengths) - 1)
        obstacle, _ = ball(arm.tip([1.0, *rest])[:3, 3] * 0.6 + [0.25, -0.3, 0.0], 0.1)
        stuck: Any = {"connect": False, "fallback": None, "repulsive_weights": 0.02}
        stuck |= {"influence_distance": 0.6, "max_iterations": 4000}
        more = {"planner_options": stuck, "refused": True, "issue": 5}
        ends = np.array([bend, *rest]), np.array([-0.9, *rest])
        kind, right = "a minimum inside the limits", "local_minimum"
        yield plan(kind, arm, ends, obstacle, "details.ending", right, **more)


def questions(rng: np.random.Generator) -> Iterator[Question]:
    for part in (projections, fields, descents):
        yield from part(rng)
