"""Inverse kinematics of many poses in one call of the batch kernels."""

from collections.abc import Sequence
from typing import Any, cast

import numpy as np

from armwright_wire.kinematics import IkRequest
from armwright_wire.pose import Pose
from kinematics.ik.closed_form.structure import structure
from kinematics.ik.inverse import IkOptions, Method
from kinematics.ik.inverse_batch import inverse_kinematics_batch
from kinematics.ik.numeric.numeric import AXES
from kinematics.model.chain import Chain
from service.endpoints.ik.answers import add_sides, solution_answer
from service.translate import poses

#: Methods that have batch kernels.
_METHODS = {"auto", "analytic", "numeric"}


def fits_batch(body: IkRequest) -> bool:
    """Whether one solution a pose is wanted that the batch kernels can find.

    They know nothing of constraints, of copies by whole turns and of solutions outside the limits.
    """
    one_each = not body.all_solutions and not body.all_turns and (body.max_solutions or 1) == 1
    return body.method in _METHODS and not body.constraints and one_each


def solve_batch(
    chain: Chain, body: IkRequest, targets: Sequence[Pose]
) -> list[dict[str, Any] | None]:
    """The answer to each pose, None for those that the single search must look at.

    Args:
        chain: The robot.
        body: The request.
        targets: Its poses.

    Raises:
        InvalidPose: An orientation is no rotation.
        InvalidRobotState: The seed has the wrong length.
    """
    closed = body.axes is None and structure(chain, body.link) is not None
    if body.method == "analytic" and not closed:
        return [None] * len(targets)
    if body.choice != "nearest" and (body.method == "numeric" or not closed):
        return [None] * len(targets)  # a choice among several, of which a batch finds one
    options = IkOptions(
        method=cast(Method, body.method),
        seed=body.seed,
        ranking=body.choice,
        parameters=body.parameters,
        axes=AXES if body.axes is None else body.axes,
    )
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
