"""Tours as requests ask for them, in workers."""

from dataclasses import asdict
from functools import partial
from typing import Any, Literal

import numpy as np
from pydantic_core import to_json

from armwright_wire.goals.goal import SingleGoal
from armwright_wire.plans import tour as schema
from armwright_wire.plans.tour import TourRequest
from armwright_wire.scenes.scene import Scene as SceneBody
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from obstacles.robots.allowed_pairs import deepest
from obstacles.robots.robot_geometry import RobotGeometry
from planning.options import MAX_TIMEOUT, Options
from planning.problem import Goal
from planning.result import Failure
from planning.tours import problem as domain
from planning.tours.planner import plan_tour
from planning.tours.result import Leg, Tour
from planning.values.preferences import PreferredClearance
from service.endpoints.attached_objects import RobotInScene, robot_in_scene
from service.endpoints.plan.task import refusal, reproducibility
from service.endpoints.tasks.translation import reach_tolerance
from service.fields import picked
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference
from service.translate import certificates, problems, timings, trajectories
from service.translate.constraints import constraint_set
from service.translate.contacts import allowed_answer
from service.translate.frames import (
    Frames,
    configuration,
    constraints_in_root_frame,
    single_goal_in_root_frame,
    with_state,
)
from service.translate.poses import rounding_notes
from service.workers import current
from service.workers.answer import in_frame
from service.workers.result import TaskProblem, timed_out
from service.workers.task import GRACE, task


def tour_problem(
    body: schema.TourRequest,
    cell: RobotInScene,
    start: Array | None,
) -> domain.TourProblem:
    """The domain's tour, for a robot with what it holds.

    Raises:
        InvalidGoal: A goal or constraint is malformed, or the order contradicts itself.
        InvalidRobotState: A joint vector has the wrong length, or there is no such state.
        InvalidLinkName: A frame is unknown, or moves.
        InvalidOption: A tolerance has no sense.
    """
    robot, chain = cell.robot, cell.robot.chain
    frames = Frames(chain, start, body.frame)
    goals = tuple(
        domain.TourGoal(
            str(i) if goal.id is None else goal.id,
            tuple(_alternatives(goal, robot, frames, f"goals[{i}]")),
            reach_tolerance(goal.tolerance),
            goal.dwell,
            goal.group,
        )
        for i, goal in enumerate(body.goals)
    )
    end: Literal["any", "start"] | Array
    if isinstance(body.end, str):
        end = body.end
    else:
        end = configuration(body.end, chain, robot.states, "end")
    least = None if body.clearance is None else body.clearance.least
    return domain.TourProblem(
        robot,
        cell.scene,
        goals,
        start,
        end,
        tuple((pair[0], pair[1]) for pair in body.precedence),
        body.margin if least is None else least,
        body.start_state_tolerance,
        constraint_set(constraints_in_root_frame(body.constraints, frames), cell.chain),
    )


def tour_options(body: schema.TourRequest, chain: Chain, timeout: float) -> domain.TourOptions:
    """Options of planning a tour, with a timeout [s].

    Raises:
        InvalidOption: A value is out of its range.
    """
    preferred = 0.0 if body.clearance is None else body.clearance.preferred
    planning = Options(
        timing=timings.timing_options(body.timing, several=True),
        limits=timings.given_limits(body.limits, chain.joint_names),
        timeout=min(timeout, MAX_TIMEOUT),
        seed=body.seed,
        goal_costs=problems.goal_costs(body.goal_costs),
        clearance=PreferredClearance(preferred),
        stops=body.stops,
    )
    return domain.TourOptions(planning, body.rounds, body.leg_timeout, body.allow_partial)


def tour_answer(
    tour: Tour,
    problem: domain.TourProblem,
    sample_period: float | None,
    scene: str | SceneBody | None = None,
) -> dict[str, Any]:
    """The order, the visits and the legs of a tour on the wire."""
    names = problem.names
    origins, targets, begins = _ends_of_legs(tour, names)
    return {
        "status": "complete" if tour.reaches_end and not tour.unvisited else "partial",
        "order": [names[k] for k in tour.order],
        "time": tour.time,
        "dwell_time": tour.dwell,
        "lower_bound": tour.lower_bound if tour.lower_bound > 0.0 else None,
        "gap": tour.gap if tour.lower_bound > 0.0 else None,
        "visits": [
            {
                "id": names[visit.index],
                **picked(visit, "index", "alternative"),
                "joints": visit.joints.tolist(),
                **picked(visit, "arrival", "departure"),
                "configuration": None
                if visit.configuration is None
                else asdict(visit.configuration),
            }
            for visit in tour.visits
        ],
        "legs": [
            {"origin": origin, "target": target, "begins": time, **_leg(leg, sample_period, scene)}
            for origin, target, time, leg in zip(origins, targets, begins, tour.legs, strict=True)
        ],
        "unvisited": [
            picked(one, "id", "index", "code", "message") | {"details": problems.plain(one.details)}
            for one in tour.unvisited
        ],
        "search": asdict(tour.search),
        "joint_names": list(problem.robot.chain.joint_names),
        "allowed_collisions": allowed_answer(
            deepest(*(leg.certificate.allowed_collisions for leg in tour.legs))
        ),
        "notes": list(tour.notes),
    }


def _ends_of_legs(tour: Tour, names: Any) -> tuple[list[str | None], list[str | None], list[float]]:
    """Names of the goals that each leg joins, and when it begins [s]."""
    visited: list[str | None] = [names[visit.index] for visit in tour.visits]
    leaves = [visit.departure for visit in tour.visits]
    if tour.visits[0].arrival > 0.0 or len(tour.legs) > len(tour.visits):
        visited, leaves = [None, *visited], [0.0, *leaves]
    count = len(tour.legs)
    return visited[:count], [*visited, None][1 : count + 1], leaves[:count]


def _leg(leg: Leg, sample_period: float | None, scene: str | SceneBody | None) -> dict[str, Any]:
    length = float(np.linalg.norm(np.diff(leg.waypoints, axis=0), axis=1).sum())
    return {
        "planner": leg.planner,
        "path": {"joints": leg.waypoints.tolist(), "length": length},
        "trajectory": trajectories.trajectory_answer(leg.trajectory, sample_period),
        "certificate": certificates.certificate_answer(leg.certificate, scene=scene)
        | certificates.stops_answer(leg.stops),
    }


def _alternatives(
    goal: schema.TourGoal, robot: RobotGeometry, frames: Frames, where: str
) -> list[Goal]:
    """The configurations and poses of a goal, in the root frame."""
    if goal.any_of is None:
        names = ("joints", "state", "pose", "frame", "position_tolerance", "orientation_tolerance")
        single = SingleGoal(**picked(goal, *names))
        return [_alternative(single, robot, frames, where)]
    return [
        _alternative(item, robot, frames, f"{where}.any_of[{k}]")
        for k, item in enumerate(goal.any_of)
    ]


def _alternative(item: SingleGoal, robot: RobotGeometry, frames: Frames, where: str) -> Goal:
    item = with_state(item, robot.states, where)
    moved = single_goal_in_root_frame(item, frames, where)
    return problems.single_goal(moved, robot.chain, f"{where}.joints")


def tour_cell(
    robot: Reference, scene: Reference | None, body: TourRequest
) -> tuple[RobotInScene, Array | None]:
    """The robot of a tour in its scene, and the configuration that it begins at, if it names one.

    Args:
        robot: The robot.
        scene: The stored scene, where the request names one.
        body: The request.
    """
    geometry, start = worker_cache.robot(robot).geometry, None
    if body.start is not None:
        start = configuration(body.start, geometry.chain, geometry.states, "start")
    return robot_in_scene(robot, scene, body, start), start


@task(grace=GRACE)
def tour(robot: Reference, scene: Reference | None, content: bytes) -> bytes | TaskProblem:
    """Answer a request for a tour.

    Args:
        robot: The robot.
        scene: The scene, where the request names a stored one.
        content: The request.

    Raises:
        ArmwrightError: The request is at fault.
    """
    body = TourRequest.model_validate_json(content)
    cell, start = tour_cell(robot, scene, body)
    problem = tour_problem(body, cell, start)
    deadline = current.deadline()
    if deadline.passed:
        return timed_out("the tour was begun", "configurations")
    options = tour_options(body, cell.robot.chain, deadline.remaining)

    def written(found: Tour) -> bytes:
        answer = tour_answer(found, problem, body.timing.sample_period, body.scene)
        answer["notes"] = [*rounding_notes(body), *cell.notes, *answer["notes"]]
        bounds = timings.given_limits(body.limits, cell.robot.chain.joint_names)
        for leg, told in zip(found.legs, answer["legs"], strict=True) if body.witness else ():
            told["certificate"]["witness"] = certificates.part_witness(
                leg.trajectory, (cell.robot, cell.scene), leg.certificate, bounds, deadline
            )
        answer |= in_frame(cell.robot.chain)
        answer["reproducibility"] = reproducibility(
            body, cell.robot, cell.scene, deterministic=found.deterministic
        )
        return to_json(answer, inf_nan_mode="null")

    outcome = plan_tour(
        problem, options, current.report, lambda found: current.offer(partial(written, found))
    )
    return refusal(outcome) if isinstance(outcome, Failure) else written(outcome)
