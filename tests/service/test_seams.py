"""Seams over HTTP: waypoints with tolerances, what is answered and what is refused."""

from typing import Any

import httpx
import numpy as np
import pytest

from armwright_client import (
    CartesianOptions,
    StraightOffset,
    TimedToolMotions,
    ToolTolerance,
    Waypoint,
)
from armwright_client import Plan as ClientPlan
from armwright_wire.plans.plan import PlanAnswer
from kinematics.forward import forward
from kinematics.robots import builtin_chain, builtin_srdf, builtin_urdf
from tests.service.robots import HOME, answer, problem

CHAIN = builtin_chain("panda")
POINTS = [[0.45 + 0.1 * np.sin(5.0 * y), float(y), 0.35] for y in np.linspace(-0.2, 0.2, 20)]
UP = [0.0, 0.0, 1.0]
BODY: dict[str, Any] = {
    "robot": "panda",
    "start": {"joints": HOME},
    "planner": "cartesian",
    "timeout": 20.0,
}


def seam(**changes: Any) -> dict[str, Any]:
    options = {"waypoints": [{"point": p, "normal": UP} for p in POINTS], "tool_speed": 0.1}
    return BODY | {"planner_options": options | changes}


def test_points_with_normals_are_followed_with_a_free_spin(client: httpx.Client) -> None:
    options = CartesianOptions(
        waypoints=[Waypoint.on(p, UP) for p in POINTS],
        tolerance=ToolTolerance(tilt=0.1),
        tool_speed=0.1,
        approach=StraightOffset(direction=UP, distance=0.05),
        retreat=StraightOffset(direction=UP, distance=0.05, frame="base"),
    )
    body = BODY | {"planner_options": options.as_options(), "timing": {"sample_period": 0.01}}
    found = answer(client.post("/v1/plan", json=body))
    PlanAnswer.model_validate(found)
    plan = ClientPlan.model_validate(found)
    assert plan.certificate.verified
    assert plan.certificate.tool_tolerance is not None
    assert plan.certificate.tool_tolerance.share <= 1.0
    assert plan.certificate.tool_speed is not None
    assert plan.certificate.tool_speed.most <= plan.certificate.tool_speed.high
    assert plan.tool_motions is not None
    assert [plan.tool_motions[0].part, plan.tool_motions[-1].part] == ["approach", "retreat"]
    times = np.array(found["trajectory"]["samples"]["time"])
    within = (times >= plan.tool_motions[1].begins) & (times <= plan.tool_motions[-2].ends)
    T = forward(CHAIN, np.array(found["trajectory"]["samples"]["position"])[within])
    assert T[:, 2, 2].max() <= -np.cos(0.1 + 1.1e-3)
    assert np.abs(T[:, 2, 3] - 0.35).max() <= 1.1e-4


def test_a_seam_is_checked_in_a_motion_that_anybody_made(client: httpx.Client) -> None:
    tilt, speed = 0.15, 0.1
    options = CartesianOptions(
        waypoints=[Waypoint.on(p, UP) for p in POINTS],
        tolerance=ToolTolerance(tilt=tilt),
        tool_speed=speed,
        approach=StraightOffset(direction=UP, distance=0.05),
    )
    body = BODY | {"planner_options": options.as_options()}
    found = answer(client.post("/v1/plan", json=body))
    plan = ClientPlan.model_validate(found)
    assert plan.tool_motions is not None
    asked = options.seam_in_time(plan.tool_motions)

    def judge(trajectory: Any, held: TimedToolMotions) -> dict[str, Any]:
        about = {"tool_motions": held.model_dump(mode="json", exclude_none=True)}
        return answer(
            client.post("/v1/validate", json={"robot": "panda", "trajectory": trajectory} | about)
        )

    proof = judge(found["trajectory"], asked)
    assert proof["verified"]
    for name in ("tool_tolerance", "tool_speed"):
        told = {key: value for key, value in found["certificate"][name].items() if key != "bands"}
        for key, value in told.items():
            assert proof[name][key] == pytest.approx(value, rel=1e-3, abs=1e-6)
    # With less tilt, or a slower tool, it is violated where dense samples say so.
    times = np.linspace(plan.tool_motions[1].begins, plan.tool_motions[-1].ends, 4001)
    motion = np.array(plan.trajectory.sample(times))
    T = forward(CHAIN, motion)
    tilts = np.arccos(np.clip(-T[:, 2, 2], -1.0, 1.0))
    tighter = ToolTolerance(tilt=0.9 * float(tilts.max()))
    less = options.model_copy(update={"tolerance": tighter}).seam_in_time(plan.tool_motions)
    refused = judge(found["trajectory"], less)
    assert not refused["verified"]
    at = np.interp(refused["violation"]["time"], times, tilts)
    assert at >= 0.85 * float(tilts.max())
    slow = judge(found["trajectory"], asked.model_copy(update={"tool_speed": 0.8 * speed}))
    assert slow["violation"]["kind"] == "tool_speed"
    assert slow["tool_speed"]["high"] == pytest.approx(0.88 * speed)
    # A motion somewhere else is outside the boxes.
    moved = [{**one.model_dump(mode="json", exclude_none=True)} for one in asked.motions]
    for one in moved:
        for pose in (one["pose"], one.get("start")):
            if pose is not None:
                pose["position"][2] += 0.002
    beside = judge(found["trajectory"], TimedToolMotions.of(**{**dict(asked), "motions": moved}))
    assert not beside["verified"]


def test_a_change_of_branch_is_answered_and_proved_again(client: httpx.Client) -> None:
    urdf = builtin_urdf("kr6_sixx").replace('"-2.96706" upper="2.96706"', '"-3.4" upper="3.4"')
    urdf = urdf.replace('lower="-3.316126"', 'lower="-1.7"')
    robot = {"name": "turns_once", "urdf": urdf, "srdf": builtin_srdf("kr6_sixx")}
    answer(client.post("/v1/robots", json=robot), 201)
    angles = np.radians(np.arange(150.0, 221.0))
    options = CartesianOptions(
        waypoints=[Waypoint.on([0.5 * np.cos(a), 0.5 * np.sin(a), 0.35], UP) for a in angles],
        tool_speed=0.2,
    )
    start = {"joints": [2.2, -1.2, 1.5, 0.1, 1.2, 0.1]}
    body = BODY | {"robot": "turns_once", "start": start}
    document = problem(
        client.post("/v1/plan", json=body | {"planner_options": options.as_options()}),
        422, "PLANNING_FAILED",
    )  # fmt: skip
    assert "branch_changes" in document["hint"]
    assert 30 <= document["details"]["reached_waypoint"] <= 45
    away = StraightOffset(direction=[0.0, 0.0, -1.0], distance=0.05)
    allowed = options.model_copy(update={"branch_changes": away})
    found = answer(client.post("/v1/plan", json=body | {"planner_options": allowed.as_options()}))
    plan = ClientPlan.model_validate(found)
    assert plan.tool_motions is not None
    assert "waypoints[" in plan.notes[0]
    asked = allowed.seam_in_time(plan.tool_motions)
    held = {"robot": "turns_once", "trajectory": found["trajectory"]}
    for motions, verified in ((asked, True), (_without_gaps(asked), False)):
        about = {"tool_motions": motions.model_dump(mode="json", exclude_none=True)}
        proof = answer(client.post("/v1/validate", json=held | about))
        assert proof["verified"] is verified


def _without_gaps(asked: TimedToolMotions) -> TimedToolMotions:
    """The same as if every motion followed the one before at once."""
    motions = asked.motions
    later = [one.model_copy(update={"begins": None}) for one in motions[1:]]
    return asked.model_copy(update={"motions": [motions[0], *later]})


def test_a_frame_moves_points_and_normals(client: httpx.Client) -> None:
    waypoints = [
        {"point": p, "normal": UP, "direction": [1, 0, 0], "frame": "panda_link0"} for p in POINTS
    ]
    found = answer(client.post("/v1/plan", json=seam(waypoints=waypoints)))
    ends = forward(CHAIN, found["path"]["joints"][-1])
    np.testing.assert_allclose(ends[:3, 3], POINTS[-1], atol=1e-6)
    np.testing.assert_allclose(ends[:3, 0], [1, 0, 0], atol=1e-3)


def test_the_deadline_of_a_seam_is_told(client: httpx.Client) -> None:
    told = problem(client.post("/v1/plan", json=seam() | {"timeout": 0.01}), 504, "TIMED_OUT")
    assert told["hint"]


def test_a_seam_out_of_reach_says_where_and_by_how_much(client: httpx.Client) -> None:
    far = [{"point": [x, 0.0, 0.4], "normal": UP} for x in np.linspace(0.5, 1.3, 17).tolist()]
    document = problem(client.post("/v1/plan", json=seam(waypoints=far)), 422, "PLANNING_FAILED")
    details = document["details"]
    assert 4 <= details["waypoint"] <= 12
    assert 0.2 < details["longest"]["fraction"] < 0.8
    assert details["reason"] in {"unreachable", "limit", "branch"}
    assert isinstance(details["would_help"], list)
