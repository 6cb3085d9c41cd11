"""Plans and proofs over HTTP: against the domain, and against sampling of what came back."""

import json
import threading
import time
from typing import Any

import httpx
import numpy as np
import pytest
from numpy.polynomial import polynomial

from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.pose import from_rpy
from kinematics.robots import builtin_chain
from obstacles.fcl_distance import FclWorld
from planning import pipeline
from planning.options import Options
from planning.problem import JointGoal, Problem
from planning.result import Plan
from service.schemas.certificate import CertificateAnswer
from service.schemas.plan import PlanAnswer
from service.schemas.scene import Scene
from service.storage import worker_cache
from service.storage.cache_key import builtin_reference
from service.translate import poses
from tests.service.robots import (
    ACCELERATIONS,
    ASIDE,
    FLOOR,
    HOME,
    POST,
    answer,
    bench,
    problem,
    scene,
)

PLACE = scene(POST, FLOOR)
BODY: dict[str, Any] = {
    "robot": "panda",
    "scene": PLACE,
    "start": {"joints": HOME},
    "goal": {"joints": ASIDE},
    "timeout": 20.0,
}


def plan(client: httpx.Client, **changes: Any) -> dict[str, Any]:
    found = answer(client.post("/v1/plan", json=BODY | changes))
    PlanAnswer.model_validate(found)
    return found


def positions(trajectory: dict[str, Any], count: int = 400) -> Array:
    """Samples of a trajectory by numpy's polynomials, from the answer alone."""
    rows = []
    for t in np.linspace(0.0, trajectory["duration"], count):
        segment = next(s for s in trajectory["segments"] if t <= s["t1"] + 1e-12)
        rows.append([polynomial.polyval(t - segment["t0"], c) for c in segment["coefficients"]])
    return np.array(rows)


def world(place: dict[str, Any] = PLACE) -> FclWorld:
    geometry = worker_cache.robot(builtin_reference("panda")).geometry
    return FclWorld(geometry, poses.scene(Scene.model_validate(place)))


def test_a_plan_around_an_obstacle_is_what_it_says(client: httpx.Client) -> None:
    found = plan(client)
    assert found["status"] == "success"
    outcomes = {stage["name"]: stage["outcome"] for stage in found["stages"]}
    assert outcomes["straight_line"] == "failed"
    assert outcomes[found["planner"]] == outcomes["certificate"] == "succeeded"
    trajectory, certificate = found["trajectory"], found["certificate"]
    assert trajectory["joint_names"] == list(builtin_chain("panda").joint_names)
    assert trajectory["samples"] is None
    np.testing.assert_allclose(found["path"]["joints"][0], HOME)
    np.testing.assert_allclose(found["path"]["joints"][-1], ASIDE)
    q = positions(trajectory)
    np.testing.assert_allclose(q[0], HOME, atol=1e-12)
    np.testing.assert_allclose(q[-1], ASIDE, atol=1e-9)
    exact = world()
    nearest = min(exact.clearance(row).distance for row in q)
    assert certificate["verified"] is True
    assert 0.0 < certificate["min_clearance"] <= nearest + 1e-9
    assert certificate["min_clearance"] > 0.5 * nearest
    for use in certificate["limits"].values():
        assert use is None or 0.0 < use["worst_ratio"] <= 1.0 + 1e-9
    ends = [found["trajectory"]["segments"][k] for k in (0, -1)]
    assert ends[0]["t0"] == 0.0
    assert ends[1]["t1"] == trajectory["duration"]


def test_it_is_what_the_domain_plans(client: httpx.Client) -> None:
    found = plan(client, seed=3)
    geometry = worker_cache.robot(builtin_reference("panda")).geometry
    obstacles = poses.scene(Scene.model_validate(PLACE))
    made = Problem(geometry, obstacles, np.array(HOME), (JointGoal(np.array(ASIDE)),))
    direct = pipeline.plan(made, Options(timeout=20.0, seed=3))
    assert isinstance(direct, Plan)
    assert found["planner"] == direct.planner
    told = [segment["coefficients"] for segment in found["trajectory"]["segments"]]
    np.testing.assert_array_equal(np.array(told), direct.trajectory.coefficients)
    told_breaks = [segment["t1"] for segment in found["trajectory"]["segments"]]
    assert told_breaks == direct.trajectory.breaks[1:].tolist()
    assert found["reproducibility"]["robot_hash"] == geometry.content_hash
    assert found["reproducibility"]["scene_hash"] == obstacles.content_hash


@pytest.mark.parametrize("planner", ["auto", "rrt_connect", "potential_field"])
def test_the_same_request_gives_the_same_bytes(client: httpx.Client, planner: str) -> None:
    answers = [plan(client, seed=11, planner=planner) for _ in range(4)]
    first = json.dumps([answers[0][key] for key in ("trajectory", "path", "certificate")])
    for other in answers[1:]:
        assert json.dumps([other[key] for key in ("trajectory", "path", "certificate")]) == first
        assert other["reproducibility"] == answers[0]["reproducibility"]
    versions = answers[0]["reproducibility"]["versions"]
    assert {"armwright", "ompl", "numpy", "python-fcl"} <= set(versions)


def test_stored_and_inline_scenes_plan_alike(client: httpx.Client) -> None:
    answer(client.post("/v1/scenes", json={"name": "planned", **PLACE}), 201)
    stored, inline = plan(client, scene="planned"), plan(client)
    assert stored["trajectory"] == inline["trajectory"]
    hashes = [found["reproducibility"]["scene_hash"] for found in (stored, inline)]
    assert hashes[0] == hashes[1]


def test_a_pose_is_reached_within_its_tolerance(client: httpx.Client) -> None:
    goal = {"pose": {"position": [0.4, -0.3, 0.4], "rpy": [3.1, 0.1, 0.0]}}
    found = plan(client, goal=goal)
    reached = forward(builtin_chain("panda"), positions(found["trajectory"])[-1])
    np.testing.assert_allclose(reached[:3, 3], [0.4, -0.3, 0.4], atol=1e-4)
    np.testing.assert_allclose(reached[:3, :3], from_rpy([3.1, 0.1, 0.0]), atol=1e-3)


def test_any_of_several_goals(client: httpx.Client) -> None:
    unreachable = {"pose": {"position": [3.0, 0.0, 0.0]}}
    found = plan(client, goal={"any_of": [unreachable, {"joints": ASIDE}]})
    np.testing.assert_allclose(found["path"]["joints"][-1], ASIDE)


def test_samples_only_on_request(client: httpx.Client) -> None:
    found = plan(client, timing={"sample_period": 0.05})
    samples = found["trajectory"]["samples"]
    times = np.array(samples["time"])
    assert times[0] == 0.0
    assert times[-1] == found["trajectory"]["duration"]
    np.testing.assert_allclose(np.diff(times)[:-1], 0.05)
    segments = found["trajectory"]["segments"]
    for i, t in enumerate(times):
        segment = next(s for s in segments if t < s["t1"] or s is segments[-1])
        for order, name in enumerate(("position", "velocity", "acceleration")):
            expected = [
                polynomial.polyval(t - segment["t0"], polynomial.polyder(c, order))
                for c in segment["coefficients"]
            ]
            np.testing.assert_allclose(samples[name][i], expected, atol=1e-9)


def test_scaling_slows_down(client: httpx.Client) -> None:
    slow = plan(client, timing={"velocity_scaling": 0.2, "acceleration_scaling": 0.1})
    limits = slow["certificate"]["limits"]
    assert limits["velocity"]["worst_ratio"] <= 1.0 + 1e-9
    assert slow["trajectory"]["duration"] > 2.0 * plan(client)["trajectory"]["duration"]
    request = {"robot": "panda", "scene": PLACE, "trajectory": slow["trajectory"]}
    proved = answer(client.post("/v1/validate", json=request))
    assert proved["limits"]["velocity"]["worst_ratio"] <= 0.2 + 1e-9
    assert proved["limits"]["acceleration"]["worst_ratio"] <= 0.1 + 1e-9


def test_the_toppra_package_times_plans_and_its_cost_is_told(client: httpx.Client) -> None:
    found = plan(client, timing={"method": "toppra", "solver": "toppra"})
    assert found["certificate"]["verified"] is True
    for quantity in ("velocity", "acceleration"):
        assert found["certificate"]["limits"][quantity]["worst_ratio"] <= 1.0 + 1e-9
    assert any("toppra's answer" in note for note in found["notes"])
    assert not any("toppra's answer" in note for note in plan(client)["notes"])


def test_margins_are_kept(client: httpx.Client) -> None:
    found = plan(client, margin=0.01, scene=scene(POST | {"margin": 0.02}, FLOOR))
    exact = world(scene(POST))
    for row in positions(found["trajectory"], 100):
        exact.set_configuration(row)
        for k in range(len(exact.pairs)):
            if "post" in exact.pair_names(k):
                assert exact.distance(k) >= 0.03 - 1e-6


def test_what_is_held_is_planned_with(client: httpx.Client) -> None:
    rod = {
        "id": "rod",
        "shape": {"type": "cylinder", "radius": 0.02, "height": 0.3},
        "pose": {"position": [0.0, 0.0, 0.2]},
        "link": "panda_hand",
        "touch_links": ["panda_leftfinger", "panda_rightfinger"],
    }
    links = client.get("/v1/robots/panda").json()["links"]
    rod["touch_links"] = [name for name in links if "finger" in name]
    found = plan(client, attached=[rod])
    assert found["reproducibility"]["robot_hash"] != plan(client)["reproducibility"]["robot_hash"]


def test_a_start_a_hair_outside_is_snapped_and_told(client: httpx.Client) -> None:
    upper = float(builtin_chain("panda").limits.upper[3])
    start = [*HOME[:3], upper + 5e-7, 0.0, 1.571, 0.785]
    found = plan(client, start={"joints": start}, scene=None)
    assert found["notes"]
    assert found["path"]["joints"][0][3] == upper
    tolerance = {"start_state_tolerance": 1e-9}
    response = client.post("/v1/plan", json=BODY | {"start": {"joints": start}} | tolerance)
    details = problem(response, 422, "START_STATE_INVALID")["details"]
    assert details["joint"] == "panda_joint4"
    assert details["limit"] == upper


# ------------------------------------------------------------------------------- refusals


def test_a_start_in_collision_names_the_pair_and_the_depth(client: httpx.Client) -> None:
    box = POST | {"id": "crate", "pose": {"position": [0.3, 0.0, 0.0]}}
    document = problem(
        client.post("/v1/plan", json=BODY | {"scene": scene(box)}), 422, "START_STATE_IN_COLLISION"
    )
    assert document["stage"] == "start"
    assert "crate" in document["details"]["pair"]
    exact = world(scene(box)).collisions(HOME)
    assert document["details"]["depth"] == pytest.approx(exact[0].depth, abs=1e-9)
    assert document["details"]["stages"][0]["outcome"] == "failed"


def test_a_goal_in_collision(client: httpx.Client) -> None:
    hand = forward(builtin_chain("panda"), ASIDE)[:3, 3].tolist()
    box = POST | {"id": "crate", "pose": {"position": hand}}
    document = problem(
        client.post("/v1/plan", json=BODY | {"scene": scene(box)}), 422, "GOAL_IN_COLLISION"
    )
    assert "crate" in document["details"]["pair"]


def test_a_goal_out_of_reach_says_how_far(client: httpx.Client) -> None:
    goal = {"pose": {"position": [2.0, 0.0, 0.5]}}
    document = problem(client.post("/v1/plan", json=BODY | {"goal": goal}), 422, "NO_IK_SOLUTION")
    assert document["details"]["position_error"] > 0.5
    assert "reach" in document["hint"]


def test_a_motion_lasts_as_long_as_its_pieces_do_whatever_duration_says(
    client: httpx.Client,
) -> None:
    motion = plan(client, scene=None)["trajectory"]
    answers = [
        client.post("/v1/validate", json={"robot": "panda", "trajectory": motion | changed}).json()
        for changed in ({}, {"duration": 2.0 * motion["duration"]})
    ]
    assert answers[0]["verified"] is True
    assert answers[0] == answers[1]


def test_a_goal_beyond_a_limit(client: httpx.Client) -> None:
    goal = {"joints": [*ASIDE[:5], 9.0, 0.0]}
    document = problem(
        client.post("/v1/plan", json=BODY | {"goal": goal}), 422, "GOAL_STATE_INVALID"
    )
    assert document["details"]["joint"] == "panda_joint6"
    assert document["details"]["value"] == 9.0


def test_a_missing_acceleration_limit_names_joints_and_remedy(client: httpx.Client) -> None:
    answer(client.post("/v1/robots", json=bench("limitless", joint_limits=None)), 201)
    body = {
        "robot": "limitless",
        "start": {"joints": [0.0, 0.0]},
        "goal": {"joints": [0.5, 0.5]},
    }
    document = problem(client.post("/v1/plan", json=body), 422, "MISSING_LIMIT")
    assert document["details"]["joints"] == ["shoulder", "elbow"]
    assert document["details"]["quantity"] == "acceleration"
    assert "joint_limits" in document["hint"]
    motion = {"samples": {"time": [0, 9], "position": [[0, 0], [0.5, 0.5]]}}
    body = {
        "robot": "limitless",
        "trajectory": motion | {"interpolation": "clamped_spline"},
    }
    problem(client.post("/v1/validate", json=body), 422, "MISSING_LIMIT")
    body["limits"] = {"acceleration": [5.0, 5.0]}
    assert answer(client.post("/v1/validate", json=body))["verified"]


def test_uploaded_robots_plan(client: httpx.Client) -> None:
    answer(client.post("/v1/robots", json=bench("bench", joint_limits=ACCELERATIONS)), 201)
    ball = {"id": "ball", "shape": {"type": "sphere", "radius": 0.05}}
    body = {
        "robot": "bench",
        "scene": scene(ball | {"pose": {"position": [0.0, 0.0, 0.65]}}),
        "start": {"joints": [-0.8, 0.0]},
        "goal": {"joints": [0.8, 0.0]},
    }
    found = answer(client.post("/v1/plan", json=body))
    assert found["certificate"]["verified"]
    assert found["certificate"]["clearance_pair"] == ["upper", "ball"]


def test_no_way_at_all_is_told_in_time_with_what_was_tried(client: httpx.Client) -> None:
    answer(client.post("/v1/robots", json=bench("stuck")), 201)
    # The lower link has to pass through it: the shoulder can't turn the other way round.
    ball = {"id": "ball", "shape": {"type": "sphere", "radius": 0.02}}
    body = {
        "robot": "stuck",
        "scene": scene(ball | {"pose": {"position": [0.0, 0.0, 0.2]}}),
        "start": {"joints": [-1.5, 0.0]},
        "goal": {"joints": [1.5, 0.0]},
        "timeout": 0.8,
    }
    start = time.monotonic()
    document = problem(client.post("/v1/plan", json=body), 504, "TIMED_OUT")
    assert 0.5 < time.monotonic() - start < 2.0
    assert document["hint"]
    tried = [stage["name"] for stage in document["details"]["stages"]]
    assert tried == ["preflight", "straight_line", "potential_field", "rrt_connect", "diagnosis"]
    assert document["details"]["blocked_by"][0]["pair"] == ["lower", "ball"]
    assert document["details"]["would_unblock"] == ["ball"]


@pytest.mark.parametrize(
    ("change", "status", "code"),
    [
        ({"robot": "nobody"}, 404, "NOT_FOUND"),
        ({"scene": "nowhere"}, 404, "NOT_FOUND"),
        ({"start": {"joints": HOME[:6]}}, 422, "INVALID_ROBOT_STATE"),
        ({"goal": {"joints": [*ASIDE, 0.0]}}, 422, "INVALID_ROBOT_STATE"),
        (
            {"goal": {"joints": ASIDE, "pose": {"position": [0.4, 0.0, 0.4]}}},
            422,
            "VALIDATION_ERROR",
        ),
        ({"goal": {}}, 422, "VALIDATION_ERROR"),
        ({"goal": {"any_of": []}}, 422, "VALIDATION_ERROR"),
        ({"goal": {"joints": ASIDE, "position_tolerance": 0.1}}, 422, "VALIDATION_ERROR"),
        ({"planner": "teleport"}, 422, "VALIDATION_ERROR"),
        ({"planner": "rrt_connect", "planner_options": {"rang": 1}}, 422, "VALIDATION_ERROR"),
        ({"planner": "rrt_connect", "planner_options": {"range": -1}}, 422, "VALIDATION_ERROR"),
        ({"timing": {"times": [0.0, 1.0]}}, 422, "VALIDATION_ERROR"),
        ({"timing": {"method": "guess"}}, 422, "VALIDATION_ERROR"),
        ({"timing": {"method": "spline", "solver": "toppra"}}, 422, "VALIDATION_ERROR"),
        ({"timing": {"solver": "toppra"}, "refine": True}, 422, "VALIDATION_ERROR"),
        ({"timing": {"velocity_scaling": 0.0}}, 422, "VALIDATION_ERROR"),
        ({"timing": {"sample_period": 1e-4, "velocity_scaling": 1e-4}}, 422, "VALIDATION_ERROR"),
        ({"constraints": [{"type": "upright"}]}, 422, "VALIDATION_ERROR"),
        ({"timeout": 1e5}, 422, "VALIDATION_ERROR"),
        ({"timeout": 0.0}, 422, "VALIDATION_ERROR"),
        ({"margin": -0.1}, 422, "VALIDATION_ERROR"),
        ({"seed": -1}, 422, "VALIDATION_ERROR"),
        ({"speed": 1}, 422, "VALIDATION_ERROR"),
    ],
)
def test_what_is_refused(
    client: httpx.Client, change: dict[str, Any], status: int, code: str
) -> None:
    document = problem(client.post("/v1/plan", json=BODY | change), status, code)
    if change.get("planner") == "teleport":
        assert "rrt_connect" in document["hint"]


def test_names_of_planners_are_read_kindly(client: httpx.Client) -> None:
    assert plan(client, planner="RRTConnect")["planner"] == "rrt_connect"


def test_a_deadline_too_short_is_a_timeout(client: httpx.Client) -> None:
    response = client.post("/v1/plan", json=BODY | {"timeout": 0.001, "planner": "rrt_connect"})
    document = problem(response, 504, "TIMED_OUT")
    assert document["hint"]


# ------------------------------------------------------------------------------- proofs


def validate(client: httpx.Client, trajectory: dict[str, Any], **more: Any) -> dict[str, Any]:
    body = {"robot": "panda", "scene": PLACE, "trajectory": trajectory} | more
    found = answer(client.post("/v1/validate", json=body))
    CertificateAnswer.model_validate(found)
    return found


def test_a_plan_proves_as_it_was_answered(client: httpx.Client) -> None:
    found = plan(client, timing={"sample_period": 0.1})
    proved = validate(client, found["trajectory"])
    assert proved["verified"] is True
    for key in ("min_clearance", "clearance_pair", "limits", "continuity"):
        assert proved[key] == found["certificate"][key]


def test_other_orders_of_joints_and_other_origins_of_time(client: httpx.Client) -> None:
    trajectory = plan(client)["trajectory"]
    order = [3, 1, 0, 2, 6, 5, 4]
    shuffled = {
        "joint_names": [trajectory["joint_names"][k] for k in order],
        "segments": [
            {
                "t0": segment["t0"] + 5.0,
                "t1": segment["t1"] + 5.0,
                "coefficients": [segment["coefficients"][k] for k in order],
            }
            for segment in trajectory["segments"]
        ],
    }
    proved, original = validate(client, shuffled), validate(client, trajectory)
    assert proved["verified"] is True
    assert proved["min_clearance"] == pytest.approx(original["min_clearance"])
    for name, use in original["limits"].items():
        told = proved["limits"][name]
        assert told["worst_ratio"] == pytest.approx(use["worst_ratio"])
        # A limit may be used as much at several times, by several joints: rounding picks one.
        assert 5.0 <= told["time"] <= 5.0 + trajectory["duration"]


def through_the_post(duration: float = 3.0) -> dict[str, Any]:
    return {
        "samples": {"time": [0.0, duration], "position": [HOME, ASIDE]},
        "interpolation": "clamped_spline",
    }


def test_a_collision_is_found_with_its_time(client: httpx.Client) -> None:
    found = validate(client, through_the_post())
    assert found["verified"] is False
    violation = found["violation"]
    assert violation["kind"] == "collision"
    assert "post" in violation["pair"]
    s = violation["time"] / 3.0
    q = np.array(HOME) + (3 * s**2 - 2 * s**3) * (np.array(ASIDE) - np.array(HOME))
    assert world().clearance(q).distance <= 1e-6


def test_what_is_too_fast_is_told_by_joint(client: httpx.Client) -> None:
    found = validate(client, through_the_post(0.2), scene=None)
    assert found["verified"] is False
    assert found["violation"]["kind"] in ("velocity", "acceleration")
    assert found["violation"]["joint"] == "panda_joint1"
    velocity = found["limits"]["velocity"]
    limit = builtin_chain("panda").limits.velocity[0]
    assert velocity["worst_ratio"] == pytest.approx(1.5 * 1.2 / 0.2 / limit)
    slow = validate(client, through_the_post(3.0), scene=None)
    assert slow["verified"] is True
    tight = validate(client, through_the_post(3.0), scene=None, limits={"velocity": [0.1] * 7})
    assert tight["violation"]["kind"] == "velocity"
    assert tight["limits"]["velocity"]["worst_ratio"] == pytest.approx(1.5 * 1.2 / 3.0 / 0.1)


def test_interpolations_of_samples(client: httpx.Client) -> None:
    middle = (0.5 * (np.array(HOME) + np.array(ASIDE))).tolist()
    still, moving = [0.0] * 7, [0.05] * 7
    samples: dict[str, Any] = {"time": [0.0, 3.0, 6.0], "position": [HOME, middle, ASIDE]}
    given = {"velocity": [still, moving, still], "acceleration": [still] * 3}
    for interpolation in ("cubic", "quintic"):
        body = {"samples": samples | given, "interpolation": interpolation}
        assert validate(client, body, scene=None)["verified"] is True
    for interpolation in ("natural_spline", "clamped_spline"):
        body = {"samples": samples, "interpolation": interpolation}
        assert validate(client, body, scene=None)["verified"] is True
    crooked = samples | {"position": [HOME, HOME, ASIDE]}
    found = validate(client, {"samples": crooked, "interpolation": "linear"}, scene=None)
    assert found["verified"] is False
    assert found["violation"]["kind"] == "continuity"
    assert found["violation"]["time"] == 3.0
    rows = np.array(HOME) + np.outer([0.0, 0.1, 0.0, 0.4], [1.0, 0, 0, 0, 0, 0, 0])
    zigzag = {"time": [0.0, 1.0, 2.0, 3.0], "position": rows.tolist()}
    found = validate(client, {"samples": zigzag, "interpolation": "linear"}, scene=None)
    assert found["violation"]["time"] == 1.0, "the first jump, not the largest"


@pytest.mark.parametrize(
    ("trajectory", "code"),
    [
        ({"samples": {"time": [0, 1], "position": [HOME, ASIDE]}}, "VALIDATION_ERROR"),
        (through_the_post() | {"interpolation": "cubic"}, "VALIDATION_ERROR"),
        (through_the_post() | {"interpolation": "akima"}, "VALIDATION_ERROR"),
        (through_the_post(0.0), "INVALID_MOTION_PLAN"),
        (through_the_post(-1.0), "INVALID_MOTION_PLAN"),
        (through_the_post() | {"joint_names": ["a"]}, "INVALID_MOTION_PLAN"),
        (
            {
                "samples": {"time": [0, 1], "position": [[0.0], [1.0]]},
                "interpolation": "linear",
            },
            "INVALID_MOTION_PLAN",
        ),
        ({"segments": [{"t0": 0, "t1": 1, "coefficients": [[0.0]]}]}, "INVALID_MOTION_PLAN"),
        (
            {
                "segments": [
                    {"t0": 0, "t1": 1, "coefficients": [[0.0]] * 7},
                    {"t0": 2, "t1": 3, "coefficients": [[0.0]] * 7},
                ]
            },
            "INVALID_MOTION_PLAN",
        ),
        ({"segments": [{"t0": 1, "t1": 1, "coefficients": [[0.0]] * 7}]}, "VALIDATION_ERROR"),
        ({}, "VALIDATION_ERROR"),
    ],
)
def test_motions_that_are_malformed(
    client: httpx.Client, trajectory: dict[str, Any], code: str
) -> None:
    body = {"robot": "panda", "scene": PLACE, "trajectory": trajectory}
    problem(client.post("/v1/validate", json=body), 422, code)


def test_limits_that_are_malformed(client: httpx.Client) -> None:
    for limits in ({"velocity": [1.0]}, {"velocity": [0.0] * 7}):
        body = {"robot": "panda", "trajectory": through_the_post(), "limits": limits}
        problem(client.post("/v1/validate", json=body), 422, "VALIDATION_ERROR")


# ---------------------------------------------------------------------------- side by side


def test_many_at_once_do_not_disturb_each_other(client: httpx.Client) -> None:
    expected = {seed: plan(client, seed=seed)["trajectory"] for seed in range(3)}
    wrong: list[int] = []

    def ask(seed: int) -> None:
        if plan(client, seed=seed)["trajectory"] != expected[seed]:
            wrong.append(seed)

    threads = [threading.Thread(target=ask, args=(k % 3,)) for k in range(12)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []
