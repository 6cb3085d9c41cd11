"""Blocks of stages from wire to domain: stages for each of several objects, and alternatives."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pydantic import TypeAdapter

from armwright_wire.plans import stages as schema
from planning.sequence.blocks import Block, Each, Fallback

Blocks = Sequence[Block[schema.SingleStage]]
_STAGES: TypeAdapter[list[schema.StageUnion]] = TypeAdapter(list[schema.StageUnion])


def blocks(stages: Sequence[schema.StageUnion]) -> Blocks:
    """The stages of a request, those inside of ``for_each`` and ``fallback`` as blocks.

    Args:
        stages: Stages of the request, in order.
    """
    return [_block(stage) for stage in stages]


def _block(stage: schema.StageUnion) -> Block[schema.SingleStage]:
    match stage:
        case schema.ForEachStage():
            items = next(iter(stage.for_each.values()))
            return Each(items, _maker(stage), stage.order == "free")
        case schema.FallbackStage():
            return Fallback([blocks(alternative) for alternative in stage.fallback])
        case _:
            return stage


def _maker(stage: schema.ForEachStage) -> Callable[[Sequence[int]], Blocks]:
    """Maker of the stages for one item, after those that were before it."""
    body = [one.model_dump(mode="json", by_alias=True, exclude_unset=True) for one in stage.stages]
    objects = stage.for_each.get("object", next(iter(stage.for_each.values())))
    named = {one["name"] for one in body if one.get("name")}

    def stages(order: Sequence[int]) -> Blocks:
        item, number = order[-1], len(order) - 1
        values = {f"{{{name}}}": values[item] for name, values in stage.for_each.items()}
        below = objects[order[-2]] if number else None

        def made(part: Any, field: str = "") -> Any:
            if isinstance(part, dict):
                return {name: made(value, name) for name, value in part.items()}
            if isinstance(part, list):
                return [made(value, field) for value in part]
            if not isinstance(part, str):
                return part
            if field in ("name", "end_of") and part in named and "{" not in part:
                return f"{part} {objects[item]}"
            for name, value in values.items():
                part = part.replace(name, value)
            return part

        filled = [_filled(made(one), number, below) for one in body]
        return blocks(_STAGES.validate_python(filled))

    return stages


def _filled(stage: Mapping[str, Any], number: int, below: str | None) -> dict[str, Any]:
    """A stage whose places on a grid or stack are the next ones after some were taken."""
    filled = dict(stage)
    for name in ("grid", "stack"):
        if filled.get(name):
            first = filled[name].get("first", 0)
            filled[name] = {**filled[name], "first": first + number}
    if filled.get("stack") and below is not None:
        support = filled.get("support") or []
        filled["support"] = [*([support] if isinstance(support, str) else support), below]
    return filled
