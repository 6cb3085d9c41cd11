"""Forward and inverse kinematics and Jacobians as requests ask for them.

What is cheap is called by the server itself, on chains it keeps; all else runs in workers.
"""

from collections.abc import Callable, Mapping
from typing import Any, cast

import numpy as np
from pydantic_core import from_json, to_json

from kinematics.arrays import Array
from kinematics.chain import Chain
from kinematics.errors import InvalidOption
from kinematics.forward import forward, link_poses
from kinematics.ik.gradient import GradientOptions, Trace, follow
from kinematics.ik.inverse import Method, inverse_kinematics
from kinematics.ik.numeric import AXES
from kinematics.ik.ranking import outside
from kinematics.ik.solution import IkResult, IkSolution
from kinematics.ik.structure import structure
from kinematics.jacobian import analytic_zyz, geometric
from kinematics.pose import to_axis_angle, to_quaternions, to_rpy, to_zyz
from kinematics.velocity import (
    DAMPED_BELOW,
    JointVelocities,
    SingularDirections,
    joint_velocities,
    link_twist,
    singular_directions,
)
from obstacles.checker import Checker
from obstacles.fcl_distance import FclWorld
from obstacles.robot_geometry import RobotGeometry
from obstacles.scene import Scene
from service.schemas.kinematics import (
    MAX_SOLUTIONS,
    FkRequest,
    IkRequest,
    JacobianRequest,
    VelocityRequest,
)
from service.schemas.pose import Orientation, Pose
from service.storage import worker_cache
from service.storage.cache_key import CacheMiss, Reference, TaskProblem, builtin_reference
from service.tasks import constrained_ik as constrained_ik_tasks
from service.tasks.answer import answering
from service.tasks.attached_objects import holding
from service.translate import poses

#: Configurations looked for where all are wanted but no number is given, and candidates among
#: which one is looked for that collides with nothing: of a closed form, and by search.
_ALL_CLOSED, _ALL_SEARCHED = MAX_SOLUTIONS, 16
_CANDIDATES_CLOSED, _CANDIDATES_SEARCHED = 200, 12
#: Rejected configurations that a refusal carries.
_TOLD = 32
#: Collisions of one request whose depth is measured.
_MEASURED = 8
#: Points of a trace.
_POINTS = 500


def fk(chain: Chain, body: FkRequest) -> bytes:
    """Answer a request for forward kinematics.

    Raises:
        InvalidRobotState: Wrong length.
        InvalidLinkName: No such link.
    """
    wanted = chain.link(body.link or chain.tip_link).name
    poses = link_poses(chain, body.joints)
    answers = _poses(poses, body.orientation)
    links = {
        link.name: answers[i] if poses.ndim == 3 else [row[i] for row in answers]
        for i, link in enumerate(chain.links)
    }
    return to_json({"pose": links[wanted], "links": links})


def _poses(poses: Array, form: Orientation) -> Any:
    positions = poses[..., :3, 3].tolist()
    turns = _orientations(poses[..., :3, :3], form).tolist()
    if poses.ndim == 3:
        return _zipped(positions, turns, form)
    return [_zipped(*row, form) for row in zip(positions, turns, strict=True)]


def _axis_and_angle(rotation: Array) -> Array:
    axis, angle = to_axis_angle(rotation)
    return np.append(axis, angle)


#: Of one rotation matrix, for forms that there is no batch of.
_CONVERSIONS: Mapping[str, Callable[[Array], Array]] = {
    "euler_zyz": to_zyz,
    "rpy": to_rpy,
    "axis_angle": _axis_and_angle,
}


def _orientations(rotations: Array, form: Orientation) -> Array:
    if form == "quaternion_xyzw":
        return to_quaternions(rotations)
    if form == "rotation_matrix":
        return rotations
    convert = _CONVERSIONS[form]
    turns = np.array([convert(R) for R in rotations.reshape(-1, 3, 3)])
    return turns.reshape(*rotations.shape[:-2], -1)


def _zipped(positions: Any, turns: Any, form: Orientation) -> list[dict[str, Any]]:
    return [{"position": p, form: turn} for p, turn in zip(positions, turns, strict=True)]


def jacobian(chain: Chain, body: JacobianRequest) -> bytes:
    """Answer a request for Jacobians.

    Raises:
        InvalidRobotState: Wrong length.
        InvalidLinkName: No such link.
        InvalidOption: The zyz rates do not exist at a configuration.
    """
    J = geometric(chain, body.joints, body.link, body.point)
    if body.kind == "analytic_zyz":
        flat = J.reshape(-1, 6, chain.n)
        turns = forward(chain, body.joints, body.link)[..., :3, :3].reshape(-1, 3, 3)
        J = np.array([analytic_zyz(*pair) for pair in zip(flat, turns, strict=True)]).reshape(
            J.shape
        )
    found = singular_directions(J)
    answer = {
        "jacobian": J.tolist(),
        "rank": found.rank.tolist(),
        "singular_values": found.values.tolist(),
        "manipulability": found.values.prod(axis=-1).tolist(),
    }
    return to_json(answer)


def velocity(chain: Chain, body: VelocityRequest) -> bytes:
    """Answer a request for velocity kinematics, forward or inverse.

    Raises:
        InvalidRobotState: Wrong length.
        InvalidLinkName: No such link.
        InvalidOption: Lists of different lengths.
    """
    if body.twist is None:
        assert body.joint_velocities is not None
        _same_length(body.joints, body.joint_velocities, "joint_velocities")
        rates = chain.configuration(body.joint_velocities, "joint_velocities")
        twist = link_twist(chain, body.joints, rates, body.link, body.point)
        found = singular_directions(geometric(chain, body.joints, body.link, body.point))
        rates = np.broadcast_to(rates, (*twist.shape[:-1], chain.n))
        gains = np.ones_like(found.values)
        solved = JointVelocities(rates, np.zeros_like(twist), gains, found)
    else:
        _same_length(body.joints, body.twist, "twist")
        if body.nullspace is not None:
            _same_length(body.joints, body.nullspace, "nullspace")
        below = DAMPED_BELOW if body.damped_below is None else body.damped_below
        solved = joint_velocities(
            chain, body.joints, body.twist, nullspace=body.nullspace, link=body.link,
            point=body.point, damped_below=below,
        )  # fmt: skip
        twist = np.array(body.twist) - solved.residual
    return to_json(
        {
            "twist": twist.tolist(),
            "joint_velocities": solved.joint_velocities.tolist(),
            "residual": solved.residual.tolist(),
            "rank": solved.directions.rank.tolist(),
            "singular_values": solved.directions.values.tolist(),
            "damped": _damped(solved),
        }
    )


def _same_length(joints: Any, others: Any, name: str) -> None:
    """Lists go with lists of the same length; one value goes with any number of configurations."""
    q, x = np.ndim(joints), np.ndim(others)
    if x == 2 and (q == 1 or len(joints) != len(others)):
        count = 1 if q == 1 else len(joints)
        raise InvalidOption(
            f"{name} holds {len(others)} rows for {count} configuration(s) in joints",
            hint=f"Give as many rows of {name} as of joints, or one row for all.",
        )


def _damped(solved: JointVelocities) -> Any:
    found = solved.directions
    if solved.gains.ndim == 1:
        return [
            {
                "singular_value": found.values[i],
                "gain": solved.gains[i],
                "twist": found.twists[:, i].tolist(),
                "joint_velocities": found.motions[i].tolist(),
            }
            for i in np.flatnonzero(solved.gains < 1.0)
        ]
    return [
        _damped(
            JointVelocities(
                rates, residual, gains, SingularDirections(values, twists, motions, rank)
            )
        )
        for rates, residual, gains, values, twists, motions, rank in zip(
            solved.joint_velocities,
            solved.residual,
            solved.gains,
            found.values,
            found.twists,
            found.motions,
            found.rank,
            strict=True,
        )
    ]


@answering
def fk_batch(reference: Reference, body: bytes) -> bytes:
    """`fk` in a worker."""
    return fk(worker_cache.chain(reference), FkRequest.model_validate_json(body))


@answering
def jacobian_batch(reference: Reference, body: bytes) -> bytes:
    """`jacobian` in a worker."""
    return jacobian(worker_cache.chain(reference), JacobianRequest.model_validate_json(body))


@answering
def velocity_batch(reference: Reference, body: bytes) -> bytes:
    """`velocity` in a worker."""
    return velocity(worker_cache.chain(reference), VelocityRequest.model_validate_json(body))


# -------------------------------------------------------------------------------- inverse


@answering
def ik(
    robot: Reference, scene: Reference | None, content: bytes
) -> bytes | TaskProblem | CacheMiss:
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
    _check_method(body)
    if body.poses is None:
        return _ik(robot, scene, body, body.pose)
    each = [_ik(robot, scene, body, pose) for pose in body.poses or ()]
    return next((item for item in each if isinstance(item, CacheMiss)), None) or _together(each)


def _together(each: list[bytes | TaskProblem | CacheMiss]) -> bytes:
    """The answers to many poses as one."""
    told = [from_json(item) if isinstance(item, bytes) else {"solutions": []} for item in each]
    answer: dict[str, Any] = {"solutions": [item["solutions"] for item in told]}
    answer["unsolved"] = [
        {"index": i, "code": item.code, "detail": item.message, "hint": item.hint}
        for i, item in enumerate(each)
        if isinstance(item, TaskProblem)
    ]
    if allowed := next((i["allowed_collisions"] for i in told if "allowed_collisions" in i), None):
        answer["allowed_collisions"] = allowed
    return to_json(answer)


def _ik(
    robot: Reference, scene: Reference | None, body: IkRequest, pose: Pose | None
) -> bytes | TaskProblem | CacheMiss:
    """The answer for one pose, or for none where constraints say what is wanted."""
    prepared = worker_cache.robot(robot)
    chain = prepared.chain
    link = chain.link(body.link or chain.tip_link).name
    held = None
    if _wants_check(body):
        place = worker_cache.scene(scene or (None if isinstance(body.scene, str) else body.scene))
        held = holding(prepared.geometry, place, body.attached, body.allowed_collisions)
    if _constrained(body):
        return constrained_ik_tasks.answer(prepared.geometry, held, body, pose)
    assert pose is not None
    trace = None
    if body.method == "gradient":
        trace = _followed(chain, body, pose)
        if not trace.converged:
            return _not_converged(link, trace)
        found = IkResult((trace.solution,), trace.solution, 1)
    else:
        found = _found(chain, body, pose)
    if not found.solutions:
        return _unreachable(chain, link, found)
    answers = [_solution(chain, solution) for solution in found.solutions]
    if held is not None:
        answers = _judged(held.robot, held.scene, answers, everything=body.all_solutions)
        if not body.all_solutions and not answers[0]["collision_free"]:
            return _all_collide(link, answers)
    wanted = body.max_solutions or (len(answers) if body.all_solutions or body.all_turns else 1)
    if not body.all_solutions:
        answers = [item for item in answers if item["rejected_because"] is None] or answers[:1]
    answer: dict[str, Any] = {"solutions": answers[:wanted]}
    if held is not None and held.allowed:
        answer["allowed_collisions"] = held.allowed
    if body.gradient is not None and body.gradient.trace and trace is not None:
        answer["trace"] = _trace(trace)
    return to_json(answer)


def _constrained(body: IkRequest) -> bool:
    """Whether constraints decide: they are given, or the method is named."""
    return body.method == "constrained" or bool(body.constraints)


def _wants_check(body: IkRequest) -> bool:
    """Whether solutions are to be checked: a scene is given, or something is held."""
    return body.scene is not None or bool(body.attached)


def _check_method(body: IkRequest) -> None:
    if body.constraints and body.method not in {"auto", "constrained"}:
        raise InvalidOption(
            f"constraints do not go with the method {body.method!r}",
            hint='Ask for the method "constrained", or leave constraints out.',
        )
    if body.posture is not None and not _constrained(body):
        raise InvalidOption("posture goes with the method 'constrained'")
    if _constrained(body) and (body.parameters or body.all_turns):
        raise InvalidOption("parameters and all_turns do not go with the method 'constrained'")
    if body.poses is not None and body.gradient is not None and body.gradient.trace:
        raise InvalidOption("a trace goes with one pose, not with many")
    if body.gradient is not None and body.method != "gradient":
        raise InvalidOption("gradient goes with method 'gradient'")
    if body.method == "gradient" and (body.axes or body.parameters or body.all_turns):
        raise InvalidOption("axes, parameters and all_turns do not go with method 'gradient'")


def _check_parameters(chain: Chain, body: IkRequest) -> None:
    if body.parameters is None:
        return
    if body.method == "numeric" or body.axes is not None:
        raise InvalidOption("parameters go with a closed form, not with the numeric method or axes")
    form = structure(chain, body.link)
    if form is None or not form.redundant:
        raise InvalidOption(
            f"robot {chain.name!r} has no closed form with a parameter",
            hint="Arms of seven joints have one; leave parameters out.",
        )


def _found(chain: Chain, body: IkRequest, pose: Pose) -> IkResult:
    method = cast(Method, body.method)
    _check_parameters(chain, body)
    closed = method != "numeric" and body.axes is None and structure(chain, body.link) is not None
    many = body.all_solutions or body.all_turns
    most = body.max_solutions or 1
    if body.max_solutions is None and many:
        most = _ALL_CLOSED if closed else _ALL_SEARCHED
    if _wants_check(body):
        most = max(most, _CANDIDATES_CLOSED if closed else _CANDIDATES_SEARCHED)
    return inverse_kinematics(
        chain,
        poses.transform(pose),
        link=body.link,
        method=method,
        seed_joints=body.seed_joints,
        seed=body.seed,
        most=most,
        choice=body.choice,
        outside_limits=body.all_solutions,
        all_turns=body.all_turns,
        parameters=body.parameters,
        axes=AXES if body.axes is None else body.axes,
    )


def _followed(chain: Chain, body: IkRequest, pose: Pose) -> Trace:
    how = body.gradient
    options = GradientOptions()
    if how is not None:
        options = GradientOptions(how.rule, how.coordinates, how.gain, how.steps)
    return follow(
        chain, poses.transform(pose), link=body.link, seed_joints=body.seed_joints,
        options=options,
    )  # fmt: skip


def _trace(trace: Trace) -> dict[str, Any]:
    count = len(trace.times)
    # The first and the last point stay.
    kept = np.unique(np.linspace(0, count - 1, min(count, _POINTS)).astype(np.int64))
    return {
        "time": trace.times[kept].tolist(),
        "joints": trace.joints[kept].tolist(),
        "position_error": trace.position_error[kept].tolist(),
        "orientation_error": trace.orientation_error[kept].tolist(),
    }


def _solution(chain: Chain, solution: IkSolution) -> dict[str, Any]:
    why = outside(chain, solution.joints)
    return {
        "joints": solution.joints.tolist(),
        "branch": solution.branch,
        "position_error": solution.position_error,
        "orientation_error": solution.orientation_error,
        "within_limits": why is None,
        "collision_free": None,
        "rejected_because": why,
    }


def _judged(
    robot: RobotGeometry, place: Scene, answers: list[dict[str, Any]], *, everything: bool
) -> list[dict[str, Any]]:
    """Answers with their collisions, those that can be used first; all, or up to the first one."""
    checker, world = Checker.of(robot, place), FclWorld(robot, place)
    judged: list[dict[str, Any]] = []
    measured = 0
    for answer in answers:
        clearance, pair = checker.clearance(np.array(answer["joints"]))
        answer["collision_free"] = clearance > 0.0
        if clearance <= 0.0 and pair is not None:
            why = f"{pair[0]!r} and {pair[1]!r} overlap"
            # Depths cost a thousand times as much as verdicts.
            if measured < _MEASURED and (deepest := world.collisions(answer["joints"])):
                a, b = deepest[0].pair
                why = f"{a!r} and {b!r} overlap by {deepest[0].depth:.4g} m"
                measured += 1
            before = answer["rejected_because"]
            answer["rejected_because"] = why if before is None else f"{before}; {why}"
        judged.append(answer)
        if not everything and answer["collision_free"] and answer["within_limits"]:
            break
    judged.sort(key=lambda item: (not item["within_limits"], not item["collision_free"]))
    return judged


def _not_converged(link: str, trace: Trace) -> TaskProblem:
    last = trace.solution
    return TaskProblem(
        "NO_IK_SOLUTION",
        f"after {last.iterations} steps the gradient has brought {link!r} to "
        f"{last.position_error:.4g} m and {last.orientation_error:.4g} rad from the pose",
        "Start elsewhere (seed_joints), allow more steps, or take the method auto.",
        {
            "stage": "ik",
            "position_error": last.position_error,
            "orientation_error": last.orientation_error,
            "nearest_joints": last.joints.tolist(),
            "trace": _trace(trace),
        },
    )


def _unreachable(chain: Chain, link: str, found: IkResult) -> TaskProblem:
    nearest = found.nearest
    return TaskProblem(
        "NO_IK_SOLUTION",
        f"no configuration brings {link!r} to the pose: the nearest attempt stays "
        f"{nearest.position_error:.4g} m and {nearest.orientation_error:.4g} rad away",
        found.advice,
        {
            "stage": "ik",
            "position_error": nearest.position_error,
            "orientation_error": nearest.orientation_error,
            "nearest_joints": nearest.joints.tolist(),
            "joint_names": list(chain.joint_names),
            "starts": found.starts,
        },
    )


def _all_collide(link: str, answers: list[dict[str, Any]]) -> TaskProblem:
    return TaskProblem(
        "NO_IK_SOLUTION",
        f"each of the {len(answers)} configurations found that bring {link!r} to the pose is in "
        f"collision; of the nearest one {answers[0]['rejected_because']}",
        "Move the pose or the obstacle; with all_solutions the colliding ones are answered too.",
        {"stage": "collision", "rejected": answers[:_TOLD]},
    )


def warm() -> None:
    """Make the kernels ready that the server calls itself."""
    chain = worker_cache.chain(builtin_reference("planar_rr"))
    for joints in ([0.1, 0.2], [[0.1, 0.2], [0.3, 0.4]]):
        fk(chain, FkRequest.model_validate({"joints": joints}))
        jacobian(chain, JacobianRequest.model_validate({"joints": joints}))
        velocity(
            chain,
            VelocityRequest.model_validate({"joints": joints, "joint_velocities": joints}),
        )
