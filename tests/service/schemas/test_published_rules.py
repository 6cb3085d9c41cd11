"""Rules of several fields: the published schema allows what the service takes, and no more."""

import itertools
import json
import re
from collections.abc import Iterator
from typing import Any

import jsonschema
import numpy as np
import pytest
from pydantic import BaseModel, ValidationError

from armwright_wire.goals.goal import Goal
from armwright_wire.goals.tool_motion import TimedToolMotion, ToolMotion
from armwright_wire.motions.retime import RetimeRequest
from armwright_wire.plans.batch import BatchRequest
from armwright_wire.plans.task import TaskRequest
from armwright_wire.plans.tour import TourGoal
from armwright_wire.robots.kinematics import IkRequest, VelocityRequest
from armwright_wire.scenes.check import Attached
from armwright_wire.scenes.scene import Scene
from tests.service.schemas.drawn import DRAWING, KINDS, needed

JOINTS = {"joints": [0.0]}
POSE = {"position": [0.0, 0.0, 0.0]}
STATE = {"position": [0.0]}
PATH = {"joints": [[0.0], [1.0]]}
SINGLE: dict[str, Any] = {"joints": [0.0], "state": "home", "pose": POSE, "any_of": [JOINTS]}
ARC: dict[str, Any] = {"via": [0.1, 0.0, 0.0], "center": [0.0] * 3, "normal": [0.0, 0.0, 1.0]}
CORNER: dict[str, Any] = {"pose": POSE, "slope": 2.0}
TOLERANCES: dict[str, Any] = {"position_tolerance": 0.1, "frame": "base"}
#: Fields of each model that belong together in some way, what else it needs, and how many of all
#: bodies follow the rules.
CASES: dict[type[BaseModel], tuple[dict[str, Any], dict[str, Any], int]] = {
    Goal: (SINGLE | TOLERANCES | {"velocities": [0.0]}, {}, 400),
    TourGoal: (SINGLE | TOLERANCES | {"tolerance": {"free": ["rz"]}}, {}, 440),
    IkRequest: ({"pose": POSE, "poses": [POSE], "constraints": []}, {}, 12),
    VelocityRequest: (
        {"twist": [0.0] * 6, "joint_velocities": [0.0], "nullspace": [0.0], "damped_below": 0.1},
        JOINTS,
        26,
    ),
    Scene: ({"obstacles": [], "moveit": "x"}, {}, 4),
    RetimeRequest: (
        {"path": PATH, "from": STATE, "to": STATE, "synchronization": "time"},
        {"robot": "panda"},
        14,
    ),
    ToolMotion: (ARC, {"type": "circ", "pose": POSE}, 10),
    TimedToolMotion: (ARC | {"rounds": CORNER}, {"type": "corner", "pose": POSE}, 8),
    Attached: (
        {"pose": POSE, "grasp_joints": [0.0], "mass": 0.5, "center_of_mass": [0.0] * 3},
        {"id": "part", "link": "hand", "shape": {"type": "sphere", "radius": 0.1}},
        28,
    ),
}


def bodies(fields: dict[str, Any], others: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Every choice of fields that are given, null or left out."""
    for kinds in itertools.product(("left out", "null", "given"), repeat=len(fields)):
        chosen = zip(fields.items(), kinds, strict=True)
        yield others | {
            name: None if kind == "null" else value
            for (name, value), kind in chosen
            if kind != "left out"
        }


def batches() -> Iterator[dict[str, Any]]:
    """Fields of plans beside the problems, with both of them, or with one."""
    fields: dict[str, Any] = {"robot": "panda", "start": JOINTS, "goal": JOINTS}
    for places in itertools.product(("none", "beside", "both", "one"), repeat=len(fields)):
        body: dict[str, Any] = {"problems": [{}, {}]}
        for (name, value), place in zip(fields.items(), places, strict=True):
            body |= {name: value} if place == "beside" else {}
            for problem in body["problems"][: {"both": 2, "one": 1}.get(place, 0)]:
                problem[name] = value
        yield body


def agree(model: type[BaseModel], cases: Iterator[dict[str, Any]]) -> list[bool]:
    """Whether each body is taken, where the published schema says the same of all."""
    published = jsonschema.Draft202012Validator(model.model_json_schema(by_alias=True))
    taken = []
    for body in cases:
        try:
            model.model_validate_json(json.dumps(body))
            taken.append(True)
        except ValidationError:
            taken.append(False)
        assert published.is_valid(body) == taken[-1], body
    return taken


@pytest.mark.parametrize("model", CASES, ids=lambda model: model.__name__)
def test_what_belongs_together_is_published(model: type[BaseModel]) -> None:
    fields, others, count = CASES[model]
    assert sum(agree(model, bodies(fields, others))) == count


def test_what_a_batch_needs_is_given_once_or_with_each_problem() -> None:
    assert sum(agree(BatchRequest, batches())) == 2**3


#: Refusals that no JSON schema can say: they compare numbers, count, or read texts.
BEYOND = re.compile(
    r"must be less than|is above|numbers, one for each axis that counts|lists of one length|"
    r"needs as many|must not descend|names vertex|must increase|each must be unique|is given twice|"
    r"no length|length 0|ascend|does not fit|is empty"
)
#: Bodies of each class.
COUNT = 20


def drawn_bodies(name: str) -> Iterator[dict[str, Any]]:
    """Bodies of a class with fields of any choice, most with those that it needs."""
    rng = np.random.default_rng([13, *name.encode()])
    fields = DRAWING._fields(name, DRAWING.definitions[name])
    required = {*needed(name, DRAWING.definitions[name])}
    tag = {*filter(None, [KINDS[name].tag])}
    for k in range(COUNT):
        share = (0.1, 0.3, 0.6)[k % 3]
        chosen = [
            field for field in fields
            if field in tag or rng.random() < (0.93 if field in required else share)
        ]  # fmt: skip
        values = ([*fields[field], None] for field in chosen)
        picks = (
            value[int(rng.integers(0, len(value) - (rng.random() < 0.85)))] for value in values
        )
        yield dict(zip(chosen, picks, strict=True)) | {
            field: fields[field][int(rng.integers(len(fields[field])))] for field in tag
        }


@pytest.mark.parametrize("name", sorted(KINDS))
def test_the_schema_and_the_service_take_the_same(name: str) -> None:
    kind = KINDS[name]
    published = jsonschema.Draft202012Validator(kind.model_json_schema(by_alias=True))
    for body in drawn_bodies(name):
        reasons = []
        try:
            kind.model_validate_json(json.dumps(body))
        except ValidationError as error:
            reasons = [item["msg"] for item in error.errors()]
        if reasons and all(BEYOND.search(reason) for reason in reasons):
            continue
        assert published.is_valid(body) == (not reasons), (body, reasons)


BLOCKS: list[dict[str, Any]] = [
    {"for_each": {"object": ["a"]}, "stages": [{"kind": "wait", "duration": 1.0}]},
    {"fallback": [[{"kind": "wait", "duration": 1.0}]]},
    {"regrasp": {"supports": ["bench"]}},
]


@pytest.mark.parametrize("stage", BLOCKS, ids=lambda stage: next(iter(stage)))
def test_stages_that_their_own_field_tells_need_no_kind(stage: dict[str, Any]) -> None:
    (own,) = {"for_each", "fallback", "regrasp"} & set(stage)
    inner = stage[own] if own == "regrasp" else stage
    stages = [
        stage,
        {"kind": own} | inner,
        {"kind": "wait"} | stage,
        stage | {"surprise": 1},
        inner,
        {},
    ]
    bodies = ({"robot": "panda", "start": JOINTS, "stages": [one]} for one in stages)
    assert agree(TaskRequest, bodies) == [True, True, False, False, own != "regrasp", False]
