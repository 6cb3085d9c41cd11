"""Bounds of the fields of requests: the last value that is taken, and the first that is not."""

import math
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel

from armwright_wire.base import MAX_BATCH, MAX_COORDINATE, MAX_JOINTS, MAX_NUMBER
from armwright_wire.goals.goal import MAX_CONSTRAINTS, MAX_GOALS
from armwright_wire.goals.tool_motion import MAX_TIMED_MOTIONS, TimedToolMotions
from armwright_wire.motions.retime import MAX_WAYPOINTS, ConvertRequest, RetimeRequest
from armwright_wire.motions.simulation import SimulateRequest
from armwright_wire.motions.trajectory import MAX_COEFFICIENTS
from armwright_wire.plans.batch import BatchRequest
from armwright_wire.plans.plan import PlanRequest, ValidateRequest
from armwright_wire.robots.kinematics import (
    MAX_PARAMETERS,
    MAX_POSES,
    MAX_SOLUTIONS,
    MAX_TWISTS,
    FkRequest,
    IkRequest,
    VelocityRequest,
)
from armwright_wire.robots.potential import PotentialRequest
from armwright_wire.robots.robot import RobotBody
from armwright_wire.scenes.check import CheckRequest
from armwright_wire.scenes.scene import NamedScene
from tests.service.schemas.bodies import (
    ATTACHED,
    BRIEF,
    CONSTRAINTS,
    DH_ROW,
    MOTIONS,
    POSE,
    SEGMENTS,
)
from tests.service.schemas.changes import Path, changed, refusals, written

IK = {"pose": POSE, "gradient": {"gain": 1.0}}
CHECK = {"robot": "r", "joints": [0.0]}
SPHERE = {"id": "a", "shape": {"type": "sphere", "radius": 0.1}, "pose": POSE}
STORED = {"name": "s", "obstacles": [SPHERE]}
RETIME = {"path": {"joints": [[0.0], [1.0]]}, "timing": {}}
VELOCITY = {"joints": [0.0], "twist": [0.0] * 6}
FIELD = {"joints": [0.0], "goal_joints": [1.0], "options": {"attractive_cap": 0.1}}
RUN = {
    "robot": "r", "trajectory": SEGMENTS,
    "controller": {"type": "computed_torque", "natural_frequency": 1.0},
}  # fmt: skip
HELD = {"robot": "r", "trajectory": SEGMENTS, "constraints": CONSTRAINTS}
TABLE = {"name": "arm", "dh": {"convention": "standard", "rows": [DH_ROW]}}
CONVERT = {"trajectory": SEGMENTS, "sample_period": 0.01}


def above(x: float) -> float:
    return float(np.nextafter(x, math.inf))


def below(x: float) -> float:
    return float(np.nextafter(x, -math.inf))


def assert_refused_at(path: Path, problems: dict[str, str]) -> None:
    """The field is named; and what it is a part of, where that has other forms too."""
    assert written(path) in problems
    assert all(written(path).startswith(where) for where in problems)


#: Model, a body of it, the field; the least and the largest value that it takes. A bound that is
#: the smallest number above 0 says that 0 itself is refused.
TINY = 5e-324
PLAN = BRIEF | {
    "refine": {"objective": {"time": 1.0}, "duration": 3.0, "degree": 5, "control_points": 16,
               "rounds": 12},
}  # fmt: skip
TIMING = {"payload": {"mass": 1.5}}
NUMBERS: list[tuple[type[BaseModel], dict[str, Any], Path, float, float]] = [
    (FkRequest, {"joints": [0.0]}, ("joints", 0), -MAX_NUMBER, MAX_NUMBER),
    (NamedScene, STORED, ("obstacles", 0, "pose", "position", 2), -MAX_COORDINATE, MAX_COORDINATE),
    (NamedScene, STORED, ("obstacles", 0, "shape", "radius"), 1e-9, MAX_COORDINATE),
    (NamedScene, changed(STORED, ("obstacles", 0, "margin"), 0.0), ("obstacles", 0, "margin"),
     0.0, 10.0),
    (CheckRequest, CHECK | {"margin": 0.0}, ("margin",), 0.0, 10.0),
    (CheckRequest, CHECK | {"timeout": 1.0}, ("timeout",), TINY, 86_400.0),
    (IkRequest, IK, ("gradient", "gain"), TINY, MAX_NUMBER),
    (VelocityRequest, VELOCITY | {"damped_below": 0.0}, ("damped_below",), 0.0, MAX_NUMBER),
    (PlanRequest, BRIEF | {"start_state_tolerance": 0.0}, ("start_state_tolerance",), 0.0, 0.1),
    (PlanRequest, BRIEF | {"goal": {"pose": POSE, "position_tolerance": 1.0}},
     ("goal", "position_tolerance"), TINY, 10.0),
    (PlanRequest, BRIEF | {"timing": TIMING}, ("timing", "velocity_scaling"), TINY, 1.0),
    (PlanRequest, BRIEF | {"timing": TIMING}, ("timing", "acceleration_scaling"), TINY, 1.0),
    (PlanRequest, BRIEF | {"timing": TIMING}, ("timing", "jerk_scaling"), TINY, 1.0),
    (PlanRequest, BRIEF | {"timing": TIMING}, ("timing", "blend_tolerance"), 0.0, MAX_NUMBER),
    (PlanRequest, BRIEF | {"timing": TIMING}, ("timing", "tool_speed"), TINY, MAX_NUMBER),
    (PlanRequest, BRIEF | {"timing": TIMING}, ("timing", "sample_period"), 1e-4, 60.0),
    (PlanRequest, BRIEF | {"timing": TIMING}, ("timing", "payload", "mass"), TINY, MAX_NUMBER),
    (PlanRequest, PLAN, ("refine", "duration"), TINY, MAX_NUMBER),
    (PlanRequest, PLAN, ("refine", "objective", "time"), 0.0, MAX_NUMBER),
    (ValidateRequest, HELD, ("constraints", 0, "weight"), TINY, MAX_NUMBER),
    (ValidateRequest, HELD, ("constraints", 0, "tolerance_above"), 0.0, MAX_NUMBER),
    (ValidateRequest, HELD, ("constraints", 4, "region", "length"), 1e-9, MAX_COORDINATE),
    (ValidateRequest, HELD, ("constraints", 5, "cone_angle"), 0.0, math.pi),
    (ValidateRequest, HELD, ("constraints", 7, "angle"), 0.0, math.pi),
    (ValidateRequest, HELD, ("constraints", 8, "margin"), 0.0, MAX_NUMBER),
    (ValidateRequest, HELD, ("constraints", 10, "limit"), TINY, MAX_NUMBER),
    (ValidateRequest, HELD, ("constraints", 11, "limits", 1), TINY, MAX_NUMBER),
    (TimedToolMotions, {"motions": MOTIONS[:1], "max_deviation": 0.1}, ("max_deviation",), 1e-7,
     1.0),
    (PotentialRequest, FIELD, ("options", "attractive_cap"), TINY, MAX_NUMBER),
    (PotentialRequest, changed(FIELD, ("options", "attractive_weights"), [1.0]),
     ("options", "attractive_weights", 0), 0.0, 1e9),
    (ConvertRequest, CONVERT, ("sample_period",), 1e-4, 60.0),
    (SimulateRequest, RUN | {"sample_period": 0.1}, ("sample_period",), TINY, MAX_NUMBER),
    (SimulateRequest, RUN | {"relative_tolerance": 1e-3}, ("relative_tolerance",), 1e-13, 1e-2),
    (SimulateRequest, RUN | {"absolute_tolerance": 1e-3}, ("absolute_tolerance",), 1e-13, 1e-2),
    (SimulateRequest, RUN, ("controller", "natural_frequency"), TINY, MAX_NUMBER),
    (RobotBody, TABLE, ("dh", "rows", 0, "a"), -MAX_COORDINATE, MAX_COORDINATE),
    (RobotBody, TABLE, ("dh", "rows", 0, "alpha"), -MAX_NUMBER, MAX_NUMBER),
    (RobotBody, TABLE, ("dh", "rows", 0, "mass"), 0.0, MAX_NUMBER),
    (RobotBody, TABLE, ("dh", "rows", 0, "velocity"), TINY, MAX_NUMBER),
]  # fmt: skip


#: Model, a body of it, the field; the least and the largest integer that it takes.
INTEGERS: list[tuple[type[BaseModel], dict[str, Any], Path, int, int]] = [
    (PlanRequest, BRIEF | {"seed": 0}, ("seed",), 0, 2**32 - 1),
    (IkRequest, IK | {"max_solutions": 1}, ("max_solutions",), 1, MAX_SOLUTIONS),
    (IkRequest, IK, ("gradient", "steps"), 1, 100_000),
    (PlanRequest, PLAN, ("refine", "degree"), 3, 7),
    (PlanRequest, PLAN, ("refine", "control_points"), 8, 64),
    (PlanRequest, PLAN, ("refine", "rounds"), 1, 100),
]


@pytest.mark.parametrize(
    ("model", "body", "path", "least", "largest", "beyond"),
    [*((*n, (below(n[3]), above(n[4]))) for n in NUMBERS),
     *((*n, (n[3] - 1, n[4] + 1, float(n[3]), 10**400)) for n in INTEGERS)],
    ids=[written(n[2]) for n in (*NUMBERS, *INTEGERS)],
)  # fmt: skip
def test_a_number_is_taken_up_to_its_bounds_and_not_beyond(
    model: type[BaseModel], body: dict[str, Any], path: Path, least: float, largest: float,
    beyond: tuple[float, ...],
) -> None:  # fmt: skip
    for value in (least, largest):
        assert refusals(model, changed(body, path, value)) == {}
    for wrong in beyond:
        assert_refused_at(path, refusals(model, changed(body, path, wrong)))


#: Model, a body of it, the list; one element, the least and the largest count of them.
LISTS: list[tuple[type[BaseModel], dict[str, Any], Path, Any, int, int]] = [
    (FkRequest, {}, ("joints",), 0.0, 1, MAX_JOINTS),
    (FkRequest, {}, ("joints",), [0.0], 1, MAX_BATCH),
    (IkRequest, {}, ("poses",), POSE, 1, MAX_POSES),
    (IkRequest, IK, ("parameters",), 0.1, 1, MAX_PARAMETERS),
    (IkRequest, IK, ("axes",), "x", 1, 6),
    (VelocityRequest, VELOCITY, ("twist",), [0.0] * 6, 1, MAX_TWISTS),
    (CheckRequest, CHECK, ("attached",), ATTACHED[1], 0, 100),
    (ValidateRequest, HELD, ("constraints",), CONSTRAINTS[8], 0, MAX_CONSTRAINTS),
    (PlanRequest, BRIEF, ("goal",), {"joints": [0.0]}, 1, MAX_GOALS),
    (PlanRequest, BRIEF, ("timing", "times"), 0.0, 2, 100),
    (ValidateRequest, HELD, ("trajectory", "segments", 0, "coefficients", 0), 0.0, 1,
     MAX_COEFFICIENTS),
    (RetimeRequest, RETIME, ("path", "joints"), [0.0], 1, MAX_WAYPOINTS),
    (RetimeRequest, RETIME, ("path", "knots"), 0.0, 2, MAX_WAYPOINTS),
    (BatchRequest, BRIEF, ("problems",), {}, 1, 500),
    (RobotBody, TABLE, ("dh", "rows"), DH_ROW, 1, MAX_JOINTS),
    (RobotBody, TABLE, ("dh", "rows", 0, "geometry"), DH_ROW["geometry"][0], 0, 100),
]  # fmt: skip
#: Lists that are bounded by the size of the body alone.
UNBOUNDED = {"problems", "timing.times"}


@pytest.mark.parametrize(
    ("model", "body", "path", "item", "least", "most"), LISTS, ids=[written(n[2]) for n in LISTS]
)
def test_a_list_is_taken_up_to_its_length_and_no_longer(
    model: type[BaseModel], body: dict[str, Any], path: Path, item: Any, least: int, most: int
) -> None:
    def of(count: int) -> dict[str, Any]:
        items = [item] * count
        whole = changed(body, ("timing",), {}) if path[0] == "timing" else body
        return changed(whole, path, {"any_of": items} if path == ("goal",) else items)

    for count in (least, most):
        assert refusals(model, of(count)) == {}
    wrong = [count for count in (least - 1, most + 1) if count >= 0]
    for count in wrong[: 1 if written(path) in UNBOUNDED else None]:
        problems = refusals(model, of(count))
        assert len(problems) == 1
        (where,) = problems
        assert where in (written(path), "goal.any_of")


def test_tool_motions_are_counted() -> None:
    line = MOTIONS[0]
    most = MAX_TIMED_MOTIONS
    for count, fits in ((1, True), (most, True), (most + 1, False)):
        body = {"motions": [line] * count, "ends": [float(i) for i in range(count)]}
        problems = refusals(TimedToolMotions, body)
        assert (problems == {}) == fits
        assert fits or set(problems) == {"motions", "ends"}


@pytest.mark.parametrize(
    ("name", "fits"),
    [("a", True), ("A_b.c-9", True), ("0", True), ("a" * 128, True), ("a" * 129, False),
     ("", False), (".a", False), ("-a", False), ("a/b", False), ("a b", False), ("é", False),
     ("a\n", False), ("a\x00", False)],
)  # fmt: skip
def test_names_can_stand_in_a_path_of_the_service(name: str, fits: bool) -> None:
    assert (refusals(NamedScene, {"name": name, "obstacles": []}) == {}) == fits
    assert (refusals(CheckRequest, CHECK | {"robot": name}) == {}) == fits
    assert (refusals(CheckRequest, CHECK | {"scene": name}) == {}) == fits


@pytest.mark.parametrize(
    ("label", "fits"),
    [("link 1/α", True), ("x" * 256, True), ("x" * 257, False), ("", False), ("a\tb", False),
     ("a\x7f", False), ("\n", False)],
)  # fmt: skip
def test_labels_of_others_are_anything_printable(label: str, fits: bool) -> None:
    assert (refusals(FkRequest, {"joints": [0.0], "link": label}) == {}) == fits
    pair = {"allowed_collisions": [["a", label]]}
    assert (refusals(CheckRequest, CHECK | pair) == {}) == fits


@pytest.mark.parametrize("words", [[], ["a"], ["a", "b", "c"], "ab", ["a", 1]])
def test_a_pair_is_two_names(words: Any) -> None:
    assert refusals(CheckRequest, CHECK | {"allowed_collisions": [words]})
    assert refusals(CheckRequest, CHECK | {"allowed_collisions": [["a", "b"]]}) == {}
