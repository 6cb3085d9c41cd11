"""Forward and inverse kinematics and Jacobians as requests ask for them.

What is cheap is called by the server itself, on chains it keeps; all else runs in workers.
"""

from typing import Any

import numpy as np
from pydantic_core import to_json

from kinematics.chain import Array, Chain
from kinematics.errors import NotAvailable
from kinematics.forward import forward, link_poses
from kinematics.ik import numeric
from kinematics.ik.solution import IkResult, IkSolution
from kinematics.jacobian import analytic_zyz, geometric
from kinematics.pose import to_quaternions
from obstacles.world import World
from service import library, translate
from service.answering import answering
from service.references import Absent, Reference, Refusal, builtin_reference
from service.schemas.kinematics import FkRequest, IkRequest, JacobianRequest

#: Configurations looked for where all are wanted but no number is given: a six-joint arm has up to
#: 8, and several times as many where joints turn more than once.
_ALL = 16
#: Candidates among which one is looked for that collides with nothing.
_CANDIDATES = 12
#: Starts spent on each configuration that is looked for, and at least on all together.
_STARTS_EACH, _LEAST_STARTS = 40, 200
_METHODS = ("auto", "numeric")


def fk(chain: Chain, body: FkRequest) -> bytes:
    """Answer a request for forward kinematics.

    Raises:
        InvalidRobotState: Wrong length.
        InvalidLinkName: No such link.
    """
    wanted = chain.link(body.link or chain.tip_link).name
    poses = link_poses(chain, body.joints)
    answers = _poses(poses)
    links = {
        link.name: answers[i] if poses.ndim == 3 else [row[i] for row in answers]
        for i, link in enumerate(chain.links)
    }
    return to_json({"pose": links[wanted], "links": links})


def _poses(poses: Array) -> Any:
    positions = poses[..., :3, 3].tolist()
    quaternions = to_quaternions(poses[..., :3, :3]).tolist()
    if poses.ndim == 3:
        return _zipped(positions, quaternions)
    return [_zipped(*row) for row in zip(positions, quaternions, strict=True)]


def _zipped(positions: Any, quaternions: Any) -> list[dict[str, Any]]:
    return [
        {"position": p, "quaternion_xyzw": q} for p, q in zip(positions, quaternions, strict=True)
    ]


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
    singular = np.linalg.svd(J, compute_uv=False)
    # As numpy.linalg.matrix_rank has it.
    least = singular.max(axis=-1, keepdims=True) * max(6, chain.n) * np.finfo(np.float64).eps
    answer = {
        "jacobian": J.tolist(),
        "rank": (singular > least).sum(axis=-1).tolist(),
        "singular_values": singular.tolist(),
        "manipulability": singular.prod(axis=-1).tolist(),
    }
    return to_json(answer)


@answering
def fk_batch(reference: Reference, body: bytes) -> bytes:
    """`fk` in a worker."""
    return fk(library.chain(reference), FkRequest.model_validate_json(body))


@answering
def jacobian_batch(reference: Reference, body: bytes) -> bytes:
    """`jacobian` in a worker."""
    return jacobian(library.chain(reference), JacobianRequest.model_validate_json(body))


# -------------------------------------------------------------------------------- inverse


@answering
def ik(robot: Reference, scene: Reference | None, content: bytes) -> bytes | Refusal | Absent:
    """Answer a request for inverse kinematics.

    Args:
        robot: The robot.
        scene: The scene, where the request names a stored one.
        content: The request.

    Raises:
        InvalidRobotState: The seed has the wrong length.
        InvalidLinkName: No such link.
        InvalidScene: The inline scene is not valid.
        NotAvailable: The method is not built yet.
    """
    body = IkRequest.model_validate_json(content)
    _check_method(body)
    prepared = library.robot(robot)
    chain = prepared.chain
    wanted = body.max_solutions or (_ALL if body.all_solutions else 1)
    looked_for = wanted if body.scene is None else max(wanted, _CANDIDATES)
    found = numeric.solve(
        chain,
        translate.transform(body.pose),
        link=body.link,
        seed_joints=body.seed_joints,
        seed=body.seed,
        solutions=looked_for,
        starts=max(_LEAST_STARTS, _STARTS_EACH * looked_for),
    )
    link = chain.link(body.link or chain.tip_link).name
    if not found.solutions:
        return _unreachable(chain, link, found)
    answers = [_solution(chain, solution) for solution in found.solutions]
    if body.scene is not None:
        inline = None if isinstance(body.scene, str) else body.scene
        world = World(prepared.geometry, library.scene(scene or inline))
        for answer in answers:
            _judge(world, answer)
        answers.sort(key=lambda answer: not answer["collision_free"])
        if not body.all_solutions:
            free = [answer for answer in answers if answer["collision_free"]]
            if not free:
                return _all_collide(link, answers)
            answers = free
    return to_json({"solutions": answers[:wanted]})


def _check_method(body: IkRequest) -> None:
    if body.method not in _METHODS:
        raise NotAvailable(
            f"inverse kinematics by the method {body.method!r} is not built yet",
            hint=f"There are: {', '.join(_METHODS)}.",
            methods=list(_METHODS),
        )
    if body.constraints:
        raise NotAvailable(
            "constraints of inverse kinematics are not built yet",
            hint="Leave constraints out; scene keeps solutions out of collision.",
        )


def _solution(chain: Chain, solution: IkSolution) -> dict[str, Any]:
    q = solution.joints
    inside = (q >= chain.limits.lower).all() and (q <= chain.limits.upper).all()
    return {
        "joints": q.tolist(),
        "branch": solution.branch,
        "position_error": solution.position_error,
        "orientation_error": solution.orientation_error,
        "within_limits": bool(inside),
        "collision_free": None,
        "rejected_because": None,
    }


def _judge(world: World, answer: dict[str, Any]) -> None:
    collisions = world.collisions(answer["joints"])
    answer["collision_free"] = not collisions
    if collisions:
        a, b = collisions[0].pair
        answer["rejected_because"] = f"{a!r} and {b!r} overlap by {collisions[0].depth:.4g} m"


def _unreachable(chain: Chain, link: str, found: IkResult) -> Refusal:
    nearest = found.nearest
    return Refusal(
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


def _all_collide(link: str, answers: list[dict[str, Any]]) -> Refusal:
    return Refusal(
        "NO_IK_SOLUTION",
        f"each of the {len(answers)} configurations found that bring {link!r} to the pose is in "
        f"collision; of the nearest one {answers[0]['rejected_because']}",
        "Move the pose or the obstacle; with all_solutions the colliding ones are answered too.",
        {"stage": "collision", "rejected": answers},
    )


def warm() -> None:
    """Make the kernels ready that the server calls itself."""
    chain = library.chain(builtin_reference("planar_rr"))
    for joints in ([0.1, 0.2], [[0.1, 0.2], [0.3, 0.4]]):
        fk(chain, FkRequest.model_validate({"joints": joints}))
        jacobian(chain, JacobianRequest.model_validate({"joints": joints}))
