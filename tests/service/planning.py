"""A post on a floor, and requests to plan around it."""

from typing import Any

import httpx

from armwright_wire.plans.plan import PlanAnswer
from armwright_wire.scenes.scene import Scene
from obstacles.collision.fcl_distance import FclWorld
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import builtin_reference
from service.translate import poses
from tests.service.robots import DETOUR, FLOOR, POST, answer, scene

PLACE = scene(POST, FLOOR)


BODY = DETOUR | {"timeout": 20.0}


def plan(client: httpx.Client, **changes: Any) -> dict[str, Any]:
    found = answer(client.post("/v1/plan", json=BODY | changes))
    PlanAnswer.model_validate(found)
    return found


def world(place: dict[str, Any] = PLACE) -> FclWorld:
    geometry = worker_cache.robot(builtin_reference("panda")).geometry
    return FclWorld(geometry, poses.scene(Scene.model_validate(place)))
