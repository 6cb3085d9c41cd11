"""Valid bodies of the endpoints of kept plans."""

from typing import Any

from pydantic import BaseModel

from armwright_wire.plans.kept_plan import Bundle, ReplayRequest

BUNDLE: dict[str, Any] = {
    "armwright_bundle": 1,
    "operation": "POST /v1/plan",
    "version": "0.1.0",
    "status": "succeeded",
    "seed": 1,
    "digest": "0" * 64,
    "robot": "arm",
    "robot_document": "{}",
    "scene": "table",
    "scene_document": "{}",
    "request": "{}",
    "answer": "{}",
}
KEPT_PLANS: list[tuple[type[BaseModel], Any]] = [
    (ReplayRequest, {"changes": {"margin": 0.1}, "documents": "current", "keep_replay": True}),
    (Bundle, BUNDLE),
]
