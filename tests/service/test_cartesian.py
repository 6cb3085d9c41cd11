"""Tool motions and seams over HTTP: what comes back, and what others prove once more."""

from typing import Any

import httpx
import numpy as np
import pytest

from armwright_client import (
    CartesianOptions,
    Pose,
    StraightOffset,
    TimedToolMotions,
    ToolMotion,
    ToolTolerance,
    Waypoint,
)
from armwright_client import Plan as ClientPlan
from armwright_wire.plans.plan import PlanAnswer
from kinematics.forward import forward
from kinematics.pose import to_quaternion
from kinematics.robots import builtin_chain, builtin_srdf, builtin_urdf
from tests.service.robots import HOME, answer, problem, scene, solid

CHAIN = builtin_chain("panda")
TIP = forward(CHAIN, HOME)
TURN = to_quaternion(TIP[:3, :3]).tolist()


def pose(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> dict[str, Any]:
    return {"position": (TIP[:3, 3] + [x, y, z]).tolist(), "quaternion_xyzw": TURN}


BODY: dict[str, Any] = {
    "robot": "panda",
    "start": {"joints": HOME},
    "goal": {"pose": pose(0.0, 0.2, 0.0)},
    "planner": "cartesian",
    "timeout": 20.0,
}


def plan(client: httpx.Client, **changes: Any) -> dict[str, Any]:
    found = answer(client.post("/v1/plan", json=BODY | changes))
    PlanAnswer.model_validate(found)
    ClientPlan.model_validate(found)
    return found


def test_a_goal_alone_is_one_line(client: httpx.Client) -> None:
    found = plan(client, timing={"sample_period": 0.01, "tool_speed": 0.2})
    assert (found["planner"], found["fraction"], found["stopped"]) == ("cartesian", 1.0, None)
    (motion,) = found["tool_motions"]
    assert (motion["type"], motion["begins"], motion["fraction"]) == ("lin", 0.0, 1.0)
    assert motion["length"] == pytest.approx(0.2)
    assert motion["ends"] == pytest.approx(found["trajectory"]["duration"])
    deviation = found["certificate"]["path_deviation"]
    assert 0.0 < deviation["position"] <= deviation["max_position"] == 1e-4
    assert 0.0 <= deviation["orientation"] <= deviation["max_orientation"] == 1e-3
    tool = forward(CHAIN, found["trajectory"]["samples"]["position"])[:, :3, 3] - TIP[:3, 3]
    assert np.abs(tool[:, [0, 2]]).max() <= deviation["position"]
    assert np.ptp(tool[:, 1]) == pytest.approx(0.2, abs=1e-6)
    assert [stage["name"] for stage in found["stages"]] == [
        "preflight", "cartesian", "timing", "certificate"]  # fmt: skip
    assert plan(client, timing={"sample_period": 0.01, "tool_speed": 0.2})["path"] == found["path"]


def test_a_way_that_ends_early(client: httpx.Client) -> None:
    wall = solid("wall", "box", (TIP[:3, 3] + [0.0, 0.3, 0.0]).tolist(), size=[0.4, 0.02, 0.4])
    body = BODY | {"goal": {"pose": pose(0.0, 0.4, 0.0)}, "scene": scene(wall)}
    document = problem(client.post("/v1/plan", json=body), 422, "PLANNING_FAILED")
    assert document["stage"] == "cartesian"
    details = document["details"]
    assert details["reason"] == "collision"
    assert "wall" in details["pair"]
    assert 0.0 < details["fraction"] < 0.75
    reached = forward(CHAIN, details["nearest"]["joints"])
    np.testing.assert_allclose(reached[:3, 3], details["nearest"]["pose"]["position"], atol=1e-9)
    partial = plan(client, **(body | {"planner_options": {"allow_partial": True}}))
    assert partial["fraction"] == pytest.approx(details["fraction"])
    assert partial["stopped"]["reason"] == "collision"
    assert partial["notes"]
    assert partial["certificate"]["verified"]


def test_what_breaks_a_constraint_on_the_way_is_told(client: httpx.Client) -> None:
    region = {"type": "box", "pose": pose(0.0, 0.1, 0.0), "size": [0.1, 0.21, 0.1]}
    arc = {"type": "circ", "pose": pose(0.0, 0.2, 0.0), "via": pose(0.0, 0.1, -0.08)["position"]}
    options = {"motions": [arc]}
    body = BODY | {"constraints": [{"type": "position", "region": region}]}
    response = client.post("/v1/plan", json=body | {"planner_options": options})
    document = problem(response, 422, "INVALID_MOTION_PLAN")
    assert document["details"]["kind"] == "path_constraint"
    assert "constraint" in document["hint"]


def test_rounded_corners_are_answered_as_motions_that_validation_takes(
    client: httpx.Client,
) -> None:
    ways = [pose(0.0, 0.1, 0.0), pose(0.0, 0.1, -0.1)]
    asked = CartesianOptions(
        motions=[ToolMotion.lin(Pose.model_validate(way)) for way in ways], blend=0.02
    )
    found = plan(
        client, goal={"pose": ways[-1]}, planner_options=asked.as_options(),
        timing={"tool_speed": 0.1},
    )  # fmt: skip
    reports = ClientPlan.model_validate(found).tool_motions
    assert reports is not None
    assert [(report.motion, report.blend) for report in reports] == [
        (0, False), (0, True), (1, False)]  # fmt: skip
    assert [report.type for report in reports] == ["lin", "corner", "lin"]
    assert reports[1].rounds is not None
    np.testing.assert_allclose(
        reports[1].rounds.pose.position, TIP[:3, 3] + [0.0, 0.1, 0.0], atol=1e-9
    )
    body = {
        "robot": "panda",
        "trajectory": found["trajectory"],
        "tool_motions": {
            "motions": [report.as_motion.model_dump(exclude_none=True) for report in reports],
            "ends": [report.ends for report in reports],
        },
    }
    certificate = answer(client.post("/v1/validate", json=body))
    assert certificate["verified"]
    deviation = certificate["path_deviation"]
    assert deviation["position"] == pytest.approx(
        found["certificate"]["path_deviation"]["position"], rel=0.3
    )


def test_the_longer_rotation_is_planned_and_proved_again(client: httpx.Client) -> None:
    # By 3.5 rad about the tool's own axis, or by 2.78 rad the other way round.
    turned = forward(CHAIN, [*HOME[:6], HOME[6] - 3.5])
    end = {
        "position": (turned[:3, 3] + [0.0, 0.1, 0.0]).tolist(),
        "quaternion_xyzw": to_quaternion(turned[:3, :3]).tolist(),
    }
    motion = {"type": "lin", "pose": end}
    lasts: list[float] = []
    for rotation, angle in (("shorter", 2.0 * np.pi - 3.5), ("longer", 3.5)):
        options = {"motions": [motion | {"rotation": rotation}]}
        found = plan(client, goal={"pose": end}, planner_options=options)
        reports = ClientPlan.model_validate(found).tool_motions
        assert reports is not None
        (report,) = reports
        assert report.rotation == rotation
        assert report.angle == pytest.approx(angle)
        lasts.append(found["path"]["joints"][-1][6])
    assert lasts[1] < HOME[6] - 1.0
    assert lasts[1] < lasts[0] - 1.0
    motions = [report.as_motion.model_dump(exclude_none=True)]
    held: dict[str, Any] = {"motions": motions, "ends": [report.ends]}
    body = {"robot": "panda", "trajectory": found["trajectory"], "tool_motions": held}
    assert answer(client.post("/v1/validate", json=body))["verified"]
    held["motions"][0]["rotation"] = "shorter"
    assert not answer(client.post("/v1/validate", json=body))["verified"]
    still = {"motions": [{"type": "lin", "pose": pose(0.0, 0.1), "rotation": "longer"}]}
    refused = client.post(
        "/v1/plan", json=BODY | {"goal": {"pose": pose(0.0, 0.1)}, "planner_options": still}
    )
    assert "does not turn" in problem(refused, 422, "INVALID_GOAL_CONSTRAINTS")["detail"]


POINTS = [[0.45 + 0.1 * np.sin(5.0 * y), float(y), 0.35] for y in np.linspace(-0.2, 0.2, 20)]
UP = [0.0, 0.0, 1.0]
SEAM: dict[str, Any] = {
    "robot": "panda",
    "start": {"joints": HOME},
    "planner": "cartesian",
    "timeout": 20.0,
}


def seam(**changes: Any) -> dict[str, Any]:
    options = {"waypoints": [{"point": p, "normal": UP} for p in POINTS], "tool_speed": 0.1}
    return SEAM | {"planner_options": options | changes}


def test_points_with_normals_are_followed_with_a_free_spin(client: httpx.Client) -> None:
    options = CartesianOptions(
        waypoints=[Waypoint.on(p, UP) for p in POINTS],
        tolerance=ToolTolerance(tilt=0.1),
        tool_speed=0.1,
        approach=StraightOffset(direction=UP, distance=0.05),
        retreat=StraightOffset(direction=UP, distance=0.05, frame="base"),
    )
    body = SEAM | {"planner_options": options.as_options(), "timing": {"sample_period": 0.01}}
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
    body = SEAM | {"planner_options": options.as_options()}
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
    body = SEAM | {"robot": "turns_once", "start": start}
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
