"""Stages of a task that put what is held down and grasp it again."""

from collections.abc import Sequence
from typing import Any

from armwright_wire.plans import stages as schema
from armwright_wire.plans.stages import SingleStage
from kinematics.errors import InvalidOption

_DOWN = [0.0, 0.0, -1.0]


def regrasp_stages(
    body: schema.RegraspStage, before: Sequence[schema.StageUnion]
) -> list[SingleStage]:
    """Stages that put the object down somewhere and grasp it again as it was grasped before.

    Args:
        body: Where it is put down, and the grasps then.
        before: Stages of the same list before it.

    Raises:
        InvalidOption: No grasp and attach of one object are among those, or it is let go again.
    """
    numbers = [k for k, one in enumerate(before) if isinstance(one, schema.GraspStage)]
    held = [one for one in before if isinstance(one, schema.AttachStage | schema.DetachStage)]
    if not numbers or not held or not isinstance(held[-1], schema.AttachStage):
        raise InvalidOption(
            "regrasp: nothing is grasped and attached before it in its list of stages",
            hint="Put it after the attach or the lift of the object.",
        )
    k = numbers[-1]
    grasp = before[k]
    assert isinstance(grasp, schema.GraspStage)
    first = k - 2 if k > 1 and isinstance(before[k - 1], schema.ApproachStage) else k
    own = [one for one in before[first:] if not isinstance(one, schema.RegraspStage)]
    pick: list[Any] = [one.model_copy(update={"name": None}) for one in own]
    change: dict[str, Any] = {"support": body.supports or body.support}
    if body.grasps is not None:
        change |= {"grasps": body.grasps, "region": None}
    elif isinstance(grasp.grasps, schema.FoundGrasps):
        search = grasp.grasps.top or grasp.grasps.side
        if search is not None:
            change["grasps"] = schema.FoundGrasps(antipodal=search)
    pick[k - first] = pick[k - first].model_copy(update=change)
    opened = [one for one in before[:k] if isinstance(one, schema.OpenStage)]
    put = schema.PlaceStage(
        object=held[-1].object,
        poses=body.poses,
        region=body.region,
        resting=None if body.supports is None else schema.RestingPlaces(),
        support=body.supports or body.support,
    )
    return [
        schema.MoveStage(),
        schema.ApproachStage(distance=body.distance, direction=_DOWN, frame="root"),
        put,
        *([opened[-1].model_copy(update={"name": None})] if opened else [schema.OpenStage()]),
        schema.DetachStage(),
        schema.RetreatStage(distance=body.distance),
        *pick,
    ]
