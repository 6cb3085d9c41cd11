"""Timing of given paths and between two states over HTTP, motions in other people's shapes."""

import csv
import io
from typing import Any

import httpx
import numpy as np
import pytest

from tests.service.robots import HOME, answer, problem, solid

JOINTS = [[0.0, 0.0], [1.0, 0.2], [1.2, 1.0], [0.3, 1.4]]
LIMITS = {"velocity": [1.0, 1.5], "acceleration": [4.0, 3.0], "jerk": [40.0, 30.0]}
ASIDE = [0.6, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785]


def retimed(client: httpx.Client, **body: Any) -> dict[str, Any]:
    body.setdefault("path", {"joints": JOINTS})
    found = answer(client.post("/v1/retime", json={"limits": LIMITS} | body))
    is_verified = found["certificate"]["verified"]
    assert found["status"] == ("success" if is_verified else "unverified")
    return found


def test_times_that_are_too_short_are_told_and_stretched_on_request(client: httpx.Client) -> None:
    timing = {"method": "spline", "times": [0.0, 0.5, 1.0, 1.5]}
    told = retimed(client, timing=timing)
    assert told["certificate"]["verified"] is False
    assert told["certificate"]["violation"]["joint"] in {"joint1", "joint2"}
    assert told["trajectory"]["duration"] == 1.5
    scaled = retimed(client, timing=timing | {"scale_times": True})
    assert scaled["certificate"]["verified"] is True
    assert scaled["factor"] == pytest.approx(told["needed_factor"], rel=1e-9)
    assert scaled["trajectory"]["duration"] == pytest.approx(1.5 * scaled["factor"], rel=1e-12)
    worst = max(use["worst_ratio"] for use in scaled["certificate"]["limits"].values() if use)
    assert worst == pytest.approx(1.0, abs=1e-9)


def test_a_robot_brings_its_limits_and_torques(client: httpx.Client) -> None:
    path = {"joints": [HOME, ASIDE]}
    body: dict[str, Any] = {"path": path, "robot": "panda", "limits": None}
    free = retimed(client, **body)
    assert set(free["certificate"]["limits"]) >= {"position", "velocity", "acceleration"}
    timing = {"torque_limits": True, "payload": {"mass": 2.0}, "tool_speed": 0.3}
    loaded = retimed(client, **body, timing=timing)
    for name in ("torque", "tool_speed"):
        assert loaded["certificate"]["limits"][name]["worst_ratio"] <= 1.0 + 1e-9
    assert loaded["trajectory"]["duration"] > free["trajectory"]["duration"]
    slow = retimed(client, **(body | {"limits": {"velocity": [0.1] * 7}}))
    assert slow["trajectory"]["duration"] > free["trajectory"]["duration"]
    half = retimed(client, **body, timing={"velocity_scaling": 0.5})
    assert half["certificate"]["limits"]["velocity"]["worst_ratio"] == pytest.approx(1.0, abs=1e-6)


def test_motions_are_told_in_other_shapes(client: httpx.Client) -> None:
    trajectory = retimed(client, timing={"sample_period": 0.05})["trajectory"]
    body = {"trajectory": trajectory, "sample_period": 0.05}
    message = client.post("/v1/convert", json=body).json()
    assert message["joint_names"] == ["joint1", "joint2"]
    stamps = [p["time_from_start"] for p in message["points"]]
    ticks = [10**9 * stamp["sec"] + stamp["nanosec"] for stamp in stamps]
    assert (np.diff(ticks) > 0).all()
    assert ticks[-1] == pytest.approx(1e9 * trajectory["duration"], abs=1.0)
    samples = trajectory["samples"]
    np.testing.assert_allclose([p["positions"] for p in message["points"]], samples["position"])
    velocities = [p["velocities"] for p in message["points"]]
    np.testing.assert_allclose(velocities[:-1], samples["velocity"][:-1])
    assert velocities[-1] == [0.0, 0.0]
    table = client.post("/v1/convert", json=body | {"format": "csv"})
    assert table.headers["content-type"].startswith("text/csv")
    rows = list(csv.reader(io.StringIO(table.text)))
    kinds = ("position", "velocity", "acceleration")
    assert rows[0] == ["time", *(f"{kind}.joint{i}" for kind in kinds for i in (1, 2))]
    values = np.array(rows[1:], dtype=float)
    np.testing.assert_array_equal(values[:, 1:3], samples["position"])
    assert (np.diff(values[:, 0]) > 0.0).all()
    problem(client.post("/v1/convert", json=body | {"format": "xml"}), 422, "VALIDATION_ERROR")


STATES: dict[str, Any] = {
    "from": {"position": [0.0, 0.0], "velocity": [0.5, 0.0], "acceleration": [1.0, 0.0]},
    "to": {"position": [1.0, 0.5], "velocity": [0.0, 0.2]},
    "limits": {"velocity": [1.0, 1.0], "acceleration": [4.0, 4.0], "jerk": [40.0, 40.0]},
}


def test_two_states_are_joined_in_the_least_time(client: httpx.Client) -> None:
    body = STATES | {"timing": {"sample_period": 0.01}}
    found = answer(client.post("/v1/retime", json=body))
    certificate, samples = found["certificate"], found["trajectory"]["samples"]
    assert certificate["verified"] is True
    assert certificate["proved"]["collisions"] is False
    assert certificate["limits"]["jerk"]["worst_ratio"] == pytest.approx(1.0, rel=1e-8)
    for name in ("position", "velocity", "acceleration"):
        assert samples[name][0] == STATES["from"][name]
        expected = STATES["to"].get(name, [0.0, 0.0])
        np.testing.assert_allclose(samples[name][-1], expected, rtol=0, atol=1e-9)
    assert found["trajectory"]["joint_names"] == ["joint1", "joint2"]
    assert "no straight line" in found["notes"][0]


def test_a_path_is_told_by_its_fewest_waypoints(client: httpx.Client) -> None:
    body: dict[str, Any] = {"path": {"joints": [[0.0, 0.0], [0.5, 0.1004], [1.0, 0.2], [1.2, 1.0]]}}
    found = answer(client.post("/v1/paths/simplify", json=body | {"tolerance": 1e-3}))
    assert (found["status"], found["waypoints"], found["left_out"]) == ("success", [0, 2, 3], 1)
    assert found["deviation"] == pytest.approx(4e-4 / 1.04, rel=1e-9)
    assert found["certificate"] is None
    exact = client.post("/v1/paths/simplify", json=body | {"tolerance": 0.0}).json()
    assert exact["waypoints"] == [0, 1, 2, 3]
    joints = np.linspace(HOME, ASIDE, 50).round(4).tolist()
    about = {"path": {"joints": joints}, "robot": "panda", "tolerance": 1e-3}
    free = client.post("/v1/paths/simplify", json=about).json()
    assert (free["status"], free["waypoints"]) == ("success", [0, 49])
    assert free["certificate"]["proved"]["collisions"]
    wall = {"obstacles": [solid("wall", "box", [0.3, 0.0, 0.5], size=[0.1, 0.1, 1.0])]}
    hit = client.post("/v1/paths/simplify", json=about | {"scene": wall}).json()
    assert hit["status"] == "unverified"
    assert "wall" in hit["certificate"]["violation"]["message"]
    refused = client.post("/v1/paths/simplify", json=body | {"tolerance": 0.0, "scene": wall})
    assert "needs robot" in problem(refused, 422, "VALIDATION_ERROR")["detail"]
    refused = client.post("/v1/paths/simplify", json=body | {"tolerance": 0.0, "robot": "panda"})
    assert "path.joints[0]" in problem(refused, 422, "INVALID_MOTION_PLAN")["detail"]


def test_a_motion_keeps_to_the_tolerance_of_its_path(client: httpx.Client) -> None:
    u = np.linspace(0.0, 1.0, 400)[:, None]
    path = {"joints": (u * [1.0, 0.3] + 0.1 * np.sin(u * [9.0, 7.0])).tolist(), "tolerance": 1e-3}
    found = retimed(client, path=path)
    assert found["status"] == "success"
    assert "smooth curve" in found["notes"][0]
    response = client.post(
        "/v1/retime",
        json={"path": path, "limits": LIMITS, "timing": {"interpolation": "natural_spline"}},
    )
    assert "path.tolerance" in problem(response, 422, "VALIDATION_ERROR")["detail"]


def test_a_motion_takes_as_long_as_asked(client: httpx.Client) -> None:
    assert retimed(client, timing={"duration": 7.0})["trajectory"]["duration"] == 7.0
    short = {"path": {"joints": JOINTS}, "limits": LIMITS, "timing": {"duration": 0.5}}
    refused = problem(client.post("/v1/retime", json=short), 422, "INVALID_MOTION_PLAN")
    least = refused["details"]["least_duration"]
    assert f"{least:.9g} s" in refused["detail"]
    kept = retimed(client, timing={"duration": 0.5, "at_least": True})
    assert kept["trajectory"]["duration"] == pytest.approx(least)
    body: dict[str, Any] = {"robot": "panda", "start": {"joints": HOME}, "goal": {"joints": ASIDE}}
    planned = client.post("/v1/plan", json=body | {"timing": {"duration": 3.0}}).json()
    assert planned["trajectory"]["duration"] == 3.0
    tour = body | {"goals": [{"joints": ASIDE}, {"joints": HOME}], "timing": {"duration": 3.0}}
    del tour["goal"]
    assert (
        "several" in problem(client.post("/v1/tours", json=tour), 422, "VALIDATION_ERROR")["detail"]
    )


def test_few_cubics_stand_for_a_recorded_motion(client: httpx.Client) -> None:
    t = np.linspace(10.0, 13.0, 300)
    s = ((t - 10.0) / 3.0)[:, None]
    q = (np.array(HOME) + (np.array(ASIDE) - HOME) * s**2 * (3.0 - 2.0 * s)).round(4)
    body = {"samples": {"time": t.tolist(), "position": q.tolist()}, "tolerance": 1e-3}
    found = answer(client.post("/v1/paths/fit", json=body))
    assert found["deviation"] <= 1e-3
    assert found["certificate"] is None
    assert len(found["trajectory"]["segments"]) < 20
    assert found["trajectory"]["segments"][0]["t0"] == 10.0
    proved = client.post("/v1/paths/fit", json=body | {"robot": "panda", "rest": True}).json()
    assert proved["status"] == "success"
    assert proved["certificate"]["proved"]["collisions"]
    fast = body | {"samples": {"time": (t / 20.0).tolist(), "position": q.tolist()}}
    late = client.post("/v1/paths/fit", json=fast | {"robot": "panda"}).json()
    assert (late["status"], late["certificate"]["verified"]) == ("unverified", False)
    odd = body | {"samples": {"time": [0.0, 1.0], "position": [[0.0], [0.0, 1.0]]}}
    refused = client.post("/v1/paths/fit", json=odd)
    assert "samples.position[1]" in problem(refused, 422, "INVALID_MOTION_PLAN")["detail"]
    near = client.post("/v1/paths/fit", json=body | {"tolerance": 1e-9})
    assert "nearest" in problem(near, 422, "VALIDATION_ERROR")["detail"]


def test_limits_hold_along_a_stretch(client: httpx.Client) -> None:
    narrow = {"from": 1, "to": 2, "velocity": [0.2, 0.2]}
    free, slow = retimed(client), retimed(client, limits_at=[narrow])
    assert slow["trajectory"]["duration"] > free["trajectory"]["duration"] + 2.0
    (held,) = slow["timing"]["limits_at"]
    assert held["velocity"] == [0.2, 0.2]
    assert held["tool_speed"] is None
    for found in (free, slow):
        timing = found["timing"]
        duration = found["trajectory"]["duration"]
        assert timing["lower_bound"] <= duration
        assert timing["gap"] == pytest.approx(duration / timing["lower_bound"] - 1.0)
    states = {"from": {"position": [0.0]}, "to": {"position": [1.0]}, "limits_at": [narrow]}
    for body, said in (
        ({"path": {"joints": JOINTS}, "limits_at": [narrow | {"to": 4}]}, "the path at 3"),
        ({"path": {"joints": JOINTS}, "limits_at": [{"from": 0, "to": 1}]}, "has no limit"),
        (states, "limits_at belongs to a path"),
    ):
        wrong = client.post("/v1/retime", json={"limits": LIMITS} | body)
        assert wrong.status_code == 422
        assert said in wrong.text


def test_waypoints_are_passed_at_their_times(client: httpx.Client) -> None:
    timing = {"method": "jerk_limited", "times": [1.0, 2.5, 4.0, 5.5]}
    found = retimed(client, timing=timing | {"velocities": [None, [0.5, 0.4], None, None]})
    assert found["status"] == "success"
    trajectory = found["trajectory"]
    assert trajectory["segments"][0]["t0"] == 1.0
    (at,) = [one for one in trajectory["segments"] if one["t0"] == pytest.approx(2.5, abs=1e-12)]
    np.testing.assert_allclose([row[:2] for row in at["coefficients"]], [[1.0, 0.5], [0.2, 0.4]])
    short = timing | {"times": [1.0, 2.5, 3.0, 5.5]}
    body = {"path": {"joints": JOINTS}, "limits": LIMITS, "timing": short}
    refused = problem(client.post("/v1/retime", json=body), 422, "INVALID_MOTION_PLAN")
    assert refused["details"]["waypoints"] == [1, 2]
    assert 0.5 < refused["details"]["least_duration"] < 0.6


def test_so_many_samples_are_answered(client: httpx.Client) -> None:
    for count in (2, 7, 1000):
        found = retimed(client, timing={"sample_count": count})["trajectory"]
        times = found["samples"]["time"]
        assert len(times) == count
        np.testing.assert_allclose(np.diff(times), found["duration"] / (count - 1))
    body = {"path": {"joints": JOINTS}, "limits": LIMITS}
    both = body | {"timing": {"sample_count": 5, "sample_period": 0.1}}
    assert "Give one" in client.post("/v1/retime", json=both).text


def test_a_path_is_simplified_within_the_tools_tolerance(client: httpx.Client) -> None:
    bow = [[0.5 * k / 200, 0.3 + 0.1 * np.sin(k / 60)] for k in range(201)]
    body: dict[str, Any] = {"path": {"joints": bow}, "robot": "planar_rr"}
    within = {"position": 1e-3, "orientation": 0.01}
    found = answer(client.post("/v1/paths/simplify", json=body | {"tool_tolerance": within}))
    assert found["status"] == "success"
    assert len(found["joints"]) < 40
    for name, most in within.items():
        assert 0.0 < found["tool_deviation"][name] <= most
    for wrong, said in (
        ({}, "the tolerance is None"),
        ({"tool_tolerance": {}}, "the tool's tolerance is None"),
        ({"tool_tolerance": within, "robot": None}, "tool_tolerance needs robot"),
    ):
        refused = client.post("/v1/paths/simplify", json=body | wrong)
        assert refused.status_code == 422
        assert said in refused.text


@pytest.mark.parametrize("seed", range(4))
def test_geometry_of_a_record_is_timed_anew(client: httpx.Client, seed: int) -> None:
    rng = np.random.default_rng(seed)
    u = np.linspace(0.0, 1.0, 200)[:, None]
    record = np.array(HOME) + 0.4 * np.sin(u * rng.uniform(1.0, 4.0, 7)) * u
    record += rng.normal(0.0, 1e-4, record.shape)
    samples = {"time": (5.0 + 30.0 * u[:, 0]).tolist(), "position": record.tolist()}
    body = {"samples": samples, "tolerance": 2e-3, "robot": "panda"}
    kept = answer(client.post("/v1/paths/fit", json=body))
    assert kept["timing"] is None
    found = answer(client.post("/v1/paths/fit", json=body | {"retime": {}}))
    assert found["status"] == "success"
    assert found["certificate"]["verified"]
    assert found["certificate"]["proved"]["collisions"]
    assert found["certificate"]["path"]["deviation"] == found["deviation"] <= 2e-3
    assert found["trajectory"]["segments"][0]["t0"] == 5.0
    assert found["trajectory"]["duration"] < 0.2 * kept["trajectory"]["duration"]
    # The same motion as retime has.
    path = {"joints": record.tolist(), "tolerance": 2e-3}
    timed = answer(client.post("/v1/retime", json={"robot": "panda", "path": path}))
    assert timed["trajectory"]["duration"] == found["trajectory"]["duration"]
    assert timed["certificate"]["path"] == found["certificate"]["path"]
    slower = answer(client.post("/v1/paths/fit", json=body | {"retime": {"velocity_scaling": 0.1}}))
    assert slower["trajectory"]["duration"] > found["trajectory"]["duration"]
    bare = {key: body[key] for key in ("samples", "tolerance")} | {"retime": {}}
    limits = {"velocity": [1.0] * 7, "acceleration": [2.0] * 7}
    alone = answer(client.post("/v1/paths/fit", json=bare | {"limits": limits}))
    assert alone["status"] == "success"
    assert client.post("/v1/paths/fit", json=bare).json()["code"] == "MISSING_LIMIT"
    odd = (body | {"limits": limits}, body | {"retime": {"times": samples["time"]}})
    for refused in odd:
        assert client.post("/v1/paths/fit", json=refused).status_code == 422
