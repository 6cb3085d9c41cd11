"""Inverse kinematics as requests ask for it, in workers.

Solutions and refusals of inverse kinematics as answers give them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from pydantic_core import to_json

from armwright_wire.pose import Pose
from armwright_wire.robots.kinematics import MAX_SOLUTIONS, IkRequest
from armwright_wire.robots.kinematics import GradientOptions as RequestedGradient
from kinematics.errors import InvalidOption
from kinematics.ik.closed_form.arm_parts import arm_sides
from kinematics.ik.closed_form.structure import structure
from kinematics.ik.gradient import GradientOptions, Trace, follow
from kinematics.ik.inverse import (
    IkOptions,
    Method,
    has_closed_form,
    inverse_kinematics,
    inverse_kinematics_batch,
)
from kinematics.ik.numeric.numeric import AXES
from kinematics.ik.ranking import outside
from kinematics.ik.solution import IkResult, IkSolution
from kinematics.model.chain import Chain
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld, OverlapMeter
from service.endpoints.attached_objects import RobotInScene, robot_in_scene
from service.endpoints.ik import constrained
from service.fields import picked, shared
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import Reference
from service.translate import poses
from service.translate.contacts import allowed_answer
from service.translate.frames import (
    Frames,
    first_configuration,
    ik_in_root_frame,
    names_frame,
)
from service.workers.answer import in_frame
from service.workers.result import TaskProblem
from service.workers.task import GRACE, task

#: Rejected configurations that a refusal carries.
_MAX_REJECTED = 32
#: Points of a trace in a refusal, where none was asked for.
_MAX_POINTS = 500


def solution_answer(chain: Chain, solution: IkSolution) -> dict[str, Any]:
    """A solution that was not compared with a scene."""
    why = outside(chain, solution.joints)
    return {
        "joints": solution.joints.tolist(),
        **picked(solution, "branch", "position_error", "orientation_error"),
        "within_limits": why is None,
        "collision_free": None,
        "rejected_because": why,
    }


def add_sides(chain: Chain, link: str | None, answers: list[dict[str, Any]]) -> None:
    """Add the sides of the arm to answers with solutions, and what of it is singular."""
    if not answers:
        return
    sides = arm_sides(chain, np.array([item["joints"] for item in answers]), link)
    if sides is None:
        return
    for item, side in zip(answers, sides, strict=True):
        item["sides"] = picked(side, "shoulder", "elbow", "wrist")
        item["singular"] = list(side.singular)


def completeness(result: IkResult, found: int, count: int) -> dict[str, Any]:
    """Whether solutions are all there are, with a note on those that are left out.

    Args:
        result: The solutions.
        found: Number of them that fit what the request asks for.
        count: Number of them that the answer has at most.
    """
    left = max(result.found, found) - count
    notes = [f"max_solutions leaves out {left} of the solutions found"] if left > 0 else []
    return {"complete": result.complete and left <= 0} | ({"notes": notes} if notes else {})


def trace_answer(trace: Trace, body: IkRequest) -> dict[str, Any]:
    """The course of a gradient method: all points, or as many as are asked for.

    Args:
        trace: The course.
        body: The request; where it asks for no trace, a refusal has at most 500 points.
    """
    given, count = body.gradient, len(trace.times)
    most = _MAX_POINTS
    if given is not None and given.trace:
        most = given.trace_points or count
    # The first and the last point stay.
    shown = np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64))
    return {
        "time": trace.times[shown].tolist(),
        "joints": trace.joints[shown].tolist(),
        "axes": [axis for axis in AXES if body.axes is None or axis in body.axes],
        "error": trace.errors[shown].tolist(),
        "position_error": trace.position_error[shown].tolist(),
        "orientation_error": trace.orientation_error[shown].tolist(),
    }


def convergence_problem(link: str, trace: Trace, body: IkRequest) -> TaskProblem:
    """The refusal of a gradient that ended away from the pose."""
    last = trace.solution
    end = ", where it is stationary: Jᵀ K e = 0" if trace.stationary else ""
    return TaskProblem(
        "NO_IK_SOLUTION",
        f"after {last.iterations} steps the gradient has brought {link!r} to "
        f"{last.position_error:.4g} m and {last.orientation_error:.4g} rad from the pose{end}",
        "Start elsewhere (seed_joints), allow more steps, or take the method auto.",
        {
            "stage": "ik",
            **picked(last, "position_error", "orientation_error"),
            "nearest_joints": last.joints.tolist(),
            "stationary": trace.stationary,
            "trace": trace_answer(trace, body),
        },
    )


def unreachable(chain: Chain, link: str, result: IkResult) -> TaskProblem:
    """The refusal of a pose that no configuration reaches."""
    nearest, gap = result.nearest, result.out_of_reach
    details = {} if gap is None else {"out_of_reach_by": gap}
    beyond = "" if gap is None else f"the pose is out of reach by {gap:.4g} m: "
    return TaskProblem(
        "NO_IK_SOLUTION",
        f"{beyond}no configuration brings {link!r} to the pose: the nearest attempt stays "
        f"{nearest.position_error:.4g} m and {nearest.orientation_error:.4g} rad away",
        result.advice,
        {
            "stage": "ik",
            **picked(nearest, "position_error", "orientation_error"),
            "nearest_joints": nearest.joints.tolist(),
            "joint_names": list(chain.joint_names),
            "starts": result.starts,
            **details,
        },
    )


def all_in_collision(link: str, answers: list[dict[str, Any]]) -> TaskProblem:
    """The refusal of a pose that is reached in collision only."""
    return TaskProblem(
        "NO_IK_SOLUTION",
        f"each of the {len(answers)} configurations found that bring {link!r} to the pose is in "
        f"collision; of the nearest one {answers[0]['rejected_because']}",
        "Move the pose or the obstacle; with all_solutions the colliding ones are answered too.",
        {"stage": "collision", "rejected": answers[:_MAX_REJECTED]},
    )


def combined_answer(answers: list[dict[str, Any] | TaskProblem]) -> dict[str, Any]:
    """The answers to many poses as one, with the reason for each pose that has no solution."""
    combined: dict[str, Any] = {
        "solutions": [[] if isinstance(a, TaskProblem) else a["solutions"] for a in answers],
        "unsolved": [
            {"index": i, "code": answer.code, "detail": answer.message, "hint": answer.hint}
            for i, answer in enumerate(answers)
            if isinstance(answer, TaskProblem)
        ],
    }
    solved = [answer for answer in answers if isinstance(answer, dict)]
    if any("complete" in answer for answer in solved):
        combined["complete"] = all(answer.get("complete", False) for answer in solved)
    if notes := sorted({note for answer in solved for note in answer.get("notes", [])}):
        combined["notes"] = notes
    if not all(map(_is_deterministic, answers)):
        combined["deterministic"] = False
    for answer in answers:
        if isinstance(answer, dict) and "allowed_collisions" in answer:
            combined["allowed_collisions"] = answer["allowed_collisions"]
            break
    return combined


def _is_deterministic(answer: dict[str, Any] | TaskProblem) -> bool:
    told = answer.details if isinstance(answer, TaskProblem) else answer
    return bool(told.get("deterministic", True))


#: Methods that have batch kernels.
_METHODS = {"auto", "analytic", "numeric"}


def fits_batch(body: IkRequest) -> bool:
    """Whether one solution a pose is wanted that the batch kernels can find.

    They know nothing of constraints, of copies by whole turns and of solutions outside the limits.
    """
    one_each = not body.all_solutions and not body.all_turns and (body.max_solutions or 1) == 1
    return body.method in _METHODS and not body.constraints and one_each


def _options(body: IkRequest) -> IkOptions:
    """Options of one solution, the best within all limits."""
    return IkOptions(
        method=cast(Method, body.method),
        seed=body.seed,
        ranking=body.choice,
        parameters=body.parameters,
        axes=AXES if body.axes is None else body.axes,
    )


def solve_batch(
    chain: Chain, body: IkRequest, targets: Sequence[Pose]
) -> list[dict[str, Any] | None]:
    """The answer to each pose, None for those that the single search must look at.

    Args:
        chain: The robot.
        body: The request.
        targets: Poses of the request.

    Raises:
        InvalidPose: An orientation is no rotation.
        InvalidRobotState: The seed has the wrong length.
    """
    closed = body.axes is None and structure(chain, body.link) is not None
    if body.method == "analytic" and not closed:
        return [None] * len(targets)
    if body.choice != "nearest" and (body.method == "numeric" or not closed):
        return [None] * len(targets)  # a choice among several, of which a batch finds one
    options = _options(body)
    T = np.array([poses.transform(target) for target in targets])
    solutions = inverse_kinematics_batch(
        chain,
        T,
        options,
        link=body.link,
        seed_joints=body.seed_joints,
        threads=1,  # a worker is one of as many as there are processors
    )
    answers = [
        None if solution is None else solution_answer(chain, solution) for solution in solutions
    ]
    add_sides(chain, body.link, [item for item in answers if item is not None])
    return [None if item is None else {"solutions": [item]} for item in answers]


#: Collisions of one pose whose depth is measured: depths cost a thousand times as much as verdicts.
_MAX_DEPTHS = 8


class CollisionCheck:
    """A robot in a scene with which solutions are compared.

    Args:
        cell: The robot and its surroundings.
    """

    def __init__(self, cell: RobotInScene) -> None:
        self.cell = cell
        self._checker = Checker.of(cell.robot, cell.scene)
        self._world = FclWorld(cell.robot, cell.scene)
        self._meter = OverlapMeter(cell.robot, cell.scene)

    def told(self, answers: list[dict[str, Any]]) -> list[dict[str, Any]]:
        """Pairs that are not kept apart, with how deep they are in the deepest of some answers."""
        depths = [self._meter.depths(np.array(answer["joints"])) for answer in answers]
        return allowed_answer(self._meter.report(depths))

    def apply(self, answers: list[dict[str, Any]], *, everything: bool) -> list[dict[str, Any]]:
        """Solutions with their collisions, usable ones first.

        Args:
            answers: The solutions, best first; the result is written into them.
            everything: Check all of them, or stop at the first usable one.
        """
        checked: list[dict[str, Any]] = []
        depths = 0
        for answer in answers:
            q = np.array(answer["joints"])
            (clearance, pair), deep = self._checker.clearance(q), self._meter.too_deep(q)
            answer["collision_free"] = clearance > 0.0 and not deep
            why = deep[0][0].deeper(deep[0][1])[0] if deep else ""
            if clearance <= 0.0 and pair is not None:
                why = f"{pair[0]!r} and {pair[1]!r} overlap"
                if depths < _MAX_DEPTHS and (deepest := self._world.collisions(answer["joints"])):
                    a, b = deepest[0].pair
                    why = f"{a!r} and {b!r} overlap by {deepest[0].depth:.4g} m"
                    depths += 1
            if why:
                before = answer["rejected_because"]
                answer["rejected_because"] = why if before is None else f"{before}; {why}"
            checked.append(answer)
            if not everything and answer["collision_free"] and answer["within_limits"]:
                break
        checked.sort(key=lambda item: (not item["within_limits"], not item["collision_free"]))
        return checked


#: Solutions of a closed form where all are wanted but no number is given.
_ALL_CLOSED = MAX_SOLUTIONS
#: Solutions looked for by search where all are wanted but no number is given.
_ALL_SEARCHED = 16
#: Branches of a closed form among which one is looked for that collides with nothing.
_CANDIDATES_CLOSED = 200
#: Solutions by search among which one is looked for that collides with nothing.
_CANDIDATES_SEARCHED = 12


@dataclass(frozen=True, slots=True)
class _Query:
    """A request without its pose.

    Args:
        body: The request.
        reference: The robot.
        chain: The robot's chain.
        link: The link to bring to the pose.
        check: Present where solutions must be compared with a scene or with attached objects.
    """

    body: IkRequest
    reference: Reference
    chain: Chain
    link: str
    check: CollisionCheck | None


@task(grace=GRACE)
def ik(robot: Reference, scene: Reference | None, content: bytes) -> bytes | TaskProblem:
    """Answer a request for inverse kinematics.

    Args:
        robot: The robot.
        scene: The scene, where the request names a stored one.
        content: The request.

    Raises:
        InvalidRobotState: The seed has the wrong length.
        InvalidLinkName: No such link.
        InvalidScene: The inline scene is not valid.
        InvalidOption: Options that the method does not have.
        NotAvailable: The arm has no closed form.
    """
    body = IkRequest.model_validate_json(content)
    _check_options(body)
    chain = worker_cache.chain(robot)
    seed = first_configuration(chain, body.seed_joints)
    check = None
    if body.scene is not None or body.attached:
        check = CollisionCheck(robot_in_scene(robot, scene, body, seed))
        if body.link is not None and body.link not in chain.index:
            chain = check.cell.chain
    notes = poses.notes_of(body, () if check is None else check.cell.notes).get("notes", [])
    if names_frame(content):
        body = ik_in_root_frame(body, Frames(chain, seed, body.frame))
    query = _Query(body, robot, chain, chain.link(body.link or chain.tip_link).name, check)
    if body.poses is not None:
        answer: dict[str, Any] | TaskProblem = combined_answer(_many(query, body.poses))
    else:
        answer = _one(query, body.pose)
    if isinstance(answer, TaskProblem):
        return answer
    if notes := [*notes, *answer.get("notes", [])]:
        answer["notes"] = notes
    return to_json(answer | in_frame(chain))


def _many(query: _Query, targets: Sequence[Pose]) -> list[dict[str, Any] | TaskProblem]:
    """The answer to each of many poses: by the batch kernels where these do, else one by one."""
    solved: list[dict[str, Any] | None] = [None] * len(targets)
    if query.check is None and fits_batch(query.body):
        _check_parameters(query.chain, query.body)
        solved = solve_batch(query.chain, query.body, targets)
    return [
        _one(query, target) if answer is None else answer
        for answer, target in zip(solved, targets, strict=True)
    ]


def _one(query: _Query, pose: Pose | None) -> dict[str, Any] | TaskProblem:
    """The answer for one pose, or for none where constraints define the goal alone."""
    body, chain, check = query.body, query.chain, query.check
    if _uses_constraints(body):
        geometry = worker_cache.robot(query.reference).geometry
        return constrained.answer(geometry, check.cell if check else None, body, pose)
    assert pose is not None
    trace = None
    if body.method == "gradient":
        trace = _follow_gradient(chain, body, pose)
        flows = body.gradient is not None and body.gradient.duration is not None
        if not trace.converged and not flows:
            return convergence_problem(query.link, trace, body)
        result = IkResult((trace.solution,), trace.solution, 1)
    else:
        result = _solve(query, pose)
    if not result.solutions:
        return unreachable(chain, query.link, result)
    answers = [solution_answer(chain, solution) for solution in result.solutions]
    add_sides(chain, body.link, answers)
    if trace is not None and not trace.converged:
        answers[0]["rejected_because"] = "the flow is not at the pose at the end of its duration"
    if check is not None:
        answers = check.apply(answers, everything=body.all_solutions)
        if not body.all_solutions and not answers[0]["collision_free"]:
            return all_in_collision(query.link, answers)
    count = body.max_solutions or (len(answers) if body.all_solutions or body.all_turns else 1)
    if not body.all_solutions:
        answers = [item for item in answers if item["rejected_because"] is None] or answers[:1]
    answer: dict[str, Any] = {"solutions": answers[:count]}
    if body.all_solutions or body.all_turns or count > 1:
        answer |= completeness(result, len(answers), count)
    if check is not None:
        answer["allowed_collisions"] = check.told(answer["solutions"])
    if body.gradient is not None and body.gradient.trace and trace is not None:
        answer["trace"] = trace_answer(trace, body)
    if trace is not None and trace.damped:
        answer["notes"] = ["the inverse of the Jacobian was damped where the Jacobian loses rank"]
    return answer


def _uses_constraints(body: IkRequest) -> bool:
    """Whether constraints decide: they are given, or the method is named."""
    return body.method == "constrained" or bool(body.constraints)


def _check_options(body: IkRequest) -> None:
    """Refuse options that the method does not have."""
    if body.constraints and body.method not in {"auto", "constrained"}:
        raise InvalidOption(
            f"constraints do not apply to the method {body.method!r}",
            hint='Ask for the method "constrained", or leave constraints out.',
        )
    if body.posture is not None and not _uses_constraints(body):
        raise InvalidOption("posture needs the method 'constrained'")
    if _uses_constraints(body) and (body.parameters or body.all_turns):
        raise InvalidOption("parameters and all_turns do not apply to the method 'constrained'")
    if body.poses is not None and body.gradient is not None and body.gradient.trace:
        raise InvalidOption("a trace is given for one pose, not for many")
    if body.gradient is not None and body.method != "gradient":
        raise InvalidOption("gradient needs the method 'gradient'")
    if body.method == "gradient" and (body.parameters or body.all_turns):
        raise InvalidOption("parameters and all_turns do not apply to the method 'gradient'")
    if body.gradient is not None and body.gradient.trace_points and not body.gradient.trace:
        raise InvalidOption("trace_points needs trace", hint='Ask for it: "trace": true.')


def _check_parameters(chain: Chain, body: IkRequest) -> None:
    """Refuse parameters of a closed form where none is used or it has none."""
    if body.parameters is None:
        return
    if body.method == "numeric" or body.axes is not None:
        raise InvalidOption("parameters need a closed form; the numeric method and axes take none")
    form = structure(chain, body.link)
    if form is None or not form.redundant:
        raise InvalidOption(
            f"robot {chain.name!r} has no closed form with a parameter",
            hint="Arms of seven joints have one; leave parameters out.",
        )


def _solve(query: _Query, pose: Pose) -> IkResult:
    """The solutions of the closed form or of the search."""
    body, chain = query.body, query.chain
    _check_parameters(chain, body)
    closed = body.method != "numeric" and has_closed_form(chain, body.link, body.axes or AXES)
    count = body.max_solutions or 1
    if body.max_solutions is None and (body.all_solutions or body.all_turns):
        count = _ALL_CLOSED if closed else _ALL_SEARCHED
    # The first that a search finds is the best for none but the seed.
    if query.check is not None or (body.choice != "nearest" and not closed):
        count = max(count, _CANDIDATES_CLOSED if closed else _CANDIDATES_SEARCHED)
    options = replace(
        _options(body),
        most=count,
        outside_limits=body.all_solutions,
        all_turns=body.all_turns,
    )
    target = poses.transform(pose)
    return inverse_kinematics(chain, target, options, link=body.link, seed_joints=body.seed_joints)


def _follow_gradient(chain: Chain, body: IkRequest, pose: Pose) -> Trace:
    """The way of the gradient method from the seed towards the pose."""
    given = body.gradient or RequestedGradient()
    axes = AXES if body.axes is None else body.axes
    options = GradientOptions(**shared(given, GradientOptions, without=("axes",)), axes=axes)
    return follow(
        chain,
        poses.transform(pose),
        link=body.link,
        seed_joints=body.seed_joints,
        options=options,
    )
