"""Certificates as answers: every field, in the clock of the request, as the schema says."""

import json
import math
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest
from pydantic_core import to_json

from armwright_wire.scenes.scene import Scene
from planning.proof.certificate import Certificate, Proved
from planning.proof.constraints.constraints import ConstraintReport
from planning.proof.limits.limits import LimitReport
from planning.proof.premises import Premises
from planning.proof.tool.tool_deviation import PathDeviation
from planning.proof.violation import Violation
from service.translate.certificates import certificate_answer

VALID = Certificate(
    verified=True,
    min_clearance=0.1,
    clearance_pair=("hand", "table"),
    min_obstacle_clearance=0.1,
    min_self_clearance=0.2,
    method="by hand",
    limits={"velocity": LimitReport(0.5, "elbow", 1.5)},
    continuity={"position": 1e-12, "velocity": 0.0},
    cells=17,
    proved=Proved(True, True),
    premises=Premises("arm", "0a" * 32, None, "1b" * 32, 2, ("cup",), "flange", 0.01),
)
REPORTS = (
    ConstraintReport(0, "upright", -0.1, "rad", 0.5, hard=True),
    ConstraintReport(1, "near", 0.3, "m", 0.25, hard=False),
)


def answer(begins: float = 0.0, **changes: Any) -> dict[str, Any]:
    return certificate_answer(replace(VALID, **changes), begins)


def written(**changes: Any) -> Any:
    """The answer as JSON has it, infinities as tasks write them."""
    return json.loads(to_json(answer(**changes), inf_nan_mode="null"))


def test_a_valid_motion_is_answered_with_all_that_was_proved() -> None:
    proved = {name: value for name, value in asdict(VALID).items() if value is not None}
    never = {"violation": None, "path_constraint_residual": None}
    assert written() == json.loads(to_json(proved)) | never


def test_the_name_of_a_stored_scene_is_told_and_no_scene_inside_of_a_request() -> None:
    assert certificate_answer(VALID, scene="table")["premises"]["scene"] == "table"
    inline = Scene.model_validate({"obstacles": []})
    assert certificate_answer(VALID, scene=inline)["premises"]["scene"] is None


@pytest.mark.parametrize("name", ["min_clearance", "min_obstacle_clearance", "min_self_clearance"])
def test_an_infinite_clearance_is_null(name: str) -> None:
    assert written(**{name: math.inf})[name] is None
    assert written(**{name: -0.01})[name] == -0.01


def test_a_ratio_to_a_limit_of_nothing_is_null() -> None:
    beyond = {"velocity": LimitReport(math.inf, "elbow", 0.0)}
    assert written(limits=beyond)["limits"]["velocity"]["worst_ratio"] is None


def test_constraints_are_answered_in_order_and_only_hard_ones_count() -> None:
    given = answer(path_constraints=REPORTS)
    assert [item["name"] for item in given["path_constraints"]] == ["upright", "near"]
    assert given["path_constraints"][1] == {
        "constraint": 1, "name": "near", "residual": 0.3, "unit": "m", "hard": False, "time": 0.25,
    }  # fmt: skip
    assert given["path_constraint_residual"] == 0.0
    broken = (replace(REPORTS[0], residual=0.02), REPORTS[1])
    assert answer(path_constraints=broken)["path_constraint_residual"] == 0.02
    assert answer(path_constraints=REPORTS[1:])["path_constraint_residual"] is None


def test_every_time_is_told_in_the_clock_of_the_request() -> None:
    violation = Violation("collision", 0.75, "hand penetrates table", {"pair": ["hand", "table"]})
    deviation = PathDeviation(1e-5, None, True, 0.5, 1e-4, None)
    changes: dict[str, Any] = {
        "violation": violation, "path_deviation": deviation, "path_constraints": REPORTS,
    }  # fmt: skip
    early, late = answer(**changes), answer(begins=100.0, **changes)

    def times(given: dict[str, Any]) -> list[float]:
        return [
            given["limits"]["velocity"]["time"],
            given["path_deviation"]["time"],
            given["violation"]["time"],
            *(item["time"] for item in given["path_constraints"]),
        ]

    assert times(early) == [1.5, 0.5, 0.75, 0.5, 0.25]
    assert times(late) == [101.5, 100.5, 100.75, 100.5, 100.25]


def test_a_violation_carries_plain_values() -> None:
    details = {"pair": ["hand", "table"], "depth": np.float64(0.012), "cell": np.int64(3)}
    violation = Violation("collision", 0.75, "hand penetrates table", details)
    given = answer(verified=False, violation=violation)["violation"]
    assert given == {
        "kind": "collision", "time": 0.75, "message": "hand penetrates table",
        "pair": ["hand", "table"], "depth": 0.012, "cell": 3,
    }  # fmt: skip
    assert (type(given["depth"]), type(given["cell"])) == (float, int)
