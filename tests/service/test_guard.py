"""The gate over HTTP: single proposals, and sessions over a WebSocket."""

import itertools
import json
import time
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from armwright_client import (
    ApiError,
    Box,
    Client,
    Conflict,
    Guard,
    GuardedActions,
    GuardState,
    InvalidArgument,
    Obstacle,
    Pose,
    Proposal,
    Scene,
)
from kinematics.pose import transform
from obstacles.scenes import scene as obstacles_scene
from obstacles.shapes import shape as obstacles_shape
from service.http.layer.connection import ConnectionLimits, connection_class
from tests.planning.stops.motions import arm, judge
from tests.service.robots import answer, problem
from tests.service.server import serving

READY = [0.0, -0.5, 0.0, -2.2, 0.0, 1.7, 0.8]
WALL = Obstacle(id="wall", shape=Box(size=(0.1, 2.0, 2.0)), pose=Pose.at(0.65, 0.0, 0.6))
JOG = Proposal(joint_velocities=[0.2, 0, 0, 0, 0, 0, 0], duration=0.2)
FORTH = np.array([0.0, 0.6, 0.0, 0.4, 0.0, 0.0, 0.0])


@pytest.fixture(scope="module")
def url(client: httpx.Client) -> str:
    return str(client.base_url).rstrip("/")


def _into_the_wall(period: float) -> Proposal:
    rows = READY + np.linspace(0.0, 1.0, 9)[1:, None] * FORTH
    return Proposal(samples=rows, period=period, interpolation="natural_spline")


def _fault(client: httpx.Client, body: dict[str, Any]) -> str:
    return str(problem(client.post("/v1/guard", json=body), 422, "VALIDATION_ERROR")["detail"])


def test_a_proposal_is_answered_with_its_stop(url: str) -> None:
    with Client(url) as client:
        verdict = client.guard("panda", READY, JOG, scene=Scene(obstacles=[WALL]), stop="both")
    assert (verdict.number, verdict.accepted_until, verdict.scale) == (1, 0.2, 1.0)
    assert verdict.violations == []
    assert verdict.trajectory is not None
    assert verdict.trajectory.sample([0.2], 1)[0][0] == pytest.approx(0.2)
    end = verdict.stop.trajectory.sample([verdict.stop.trajectory.duration], 1)[0]
    assert np.abs(end).max() < 1e-9
    stops = verdict.stop.certificate.stops
    assert stops is not None
    assert (stops.kind, stops.proved) == ("both", True)
    assert verdict.stop.certificate.verified
    assert verdict.clearance is not None
    assert verdict.clearance > 0.0


def test_a_refusal_tells_all_faults_and_has_the_stop_of_the_state(url: str) -> None:
    with Client(url) as client:
        verdict = client.guard("panda", READY, _into_the_wall(0.004), scene=Scene(obstacles=[WALL]))
    assert verdict.accepted_until < 0.1
    kinds = {fault.kind for fault in verdict.violations}
    assert {"collision", "velocity", "acceleration"} <= kinds
    hit = next(fault for fault in verdict.violations if fault.kind == "collision")
    assert hit.pair is not None
    assert "wall" in hit.pair
    assert hit.depth is not None
    assert hit.depth > 0.0
    assert verdict.stop.certificate.verified


def test_a_session_keeps_the_stop_that_was_accepted_last(url: str) -> None:
    with Guard("panda", url, scene=Scene(obstacles=[WALL]), arm="left") as guard:
        assert guard.ready.stop == "none"
        first = guard.propose(READY, JOG, scene_hash=guard.ready.scene_hash)
        assert (first.number, first.scale, first.stop.number) == (1, 1.0, 1)
        state = GuardState(positions=[0.02, *READY[1:]], elapsed=0.1)
        next_one = guard.propose(state, JOG, 0.05)
        assert (next_one.number, next_one.scale) == (2, 1.0)
        assert next_one.trajectory is not None
        # It begins where the first motion is 0.15 s after its begin, not where the state is.
        assert first.trajectory is not None
        assert np.allclose(
            next_one.trajectory.sample([0.0])[0], first.trajectory.sample([0.15])[0], atol=1e-12
        )
        refused = guard.propose(
            GuardState(positions=READY, elapsed=0.0), Proposal(
                samples=[[9.0] * 7], period=0.1, interpolation="linear")
        )  # fmt: skip
        assert (refused.accepted_until, refused.stop.number) == (0.0, 2)
        assert refused.stop == next_one.stop
        where = next_one.trajectory.sample([0.15])[0]
        assert guard.propose(GuardState(positions=where, elapsed=0.15), JOG).scale == 1.0
        off = guard.propose(GuardState(positions=where, elapsed=0.0), JOG)
        assert off.scale == 1.0
        assert guard.propose(GuardState(positions=READY, elapsed=0.1), JOG).scale >= 0.0
        late = guard.propose(GuardState(positions=READY, elapsed=0.05), JOG)
        assert "stale" in {fault.kind for fault in late.violations}
        with pytest.raises(Conflict, match="another session guards the arm 'left'"):
            Guard("panda", url, arm="left")
    # The connection is gone, and with it the session.
    Guard("panda", url, arm="left").close()


def test_a_changed_scene_proves_the_stop_or_voids_it(url: str) -> None:
    with Guard("panda", url) as guard:
        verdict = guard.propose(READY, _into_the_wall(0.5))
        assert verdict.scale == 1.0
        void = guard.change(add=[WALL])
        assert void.stop == "void"
        assert void.certificate is not None
        assert not void.certificate.verified
        assert void.scene_hash != guard.ready.scene_hash
        told = guard.propose(READY, JOG, scene_hash=guard.ready.scene_hash)
        assert [fault.kind for fault in told.violations] == ["scene"]
        assert not told.stop.certificate.verified
        assert guard.change(move={"wall": Pose.at(1.5, 0.0, 0.6)}).stop == "proved"
        assert guard.propose(READY, JOG).scale == 1.0
        assert guard.change(remove=["wall"]).scene_hash == guard.ready.scene_hash
        with pytest.raises(ApiError, match="no obstacle 'hall'"):
            guard.change(remove=["hall"])
        # The session goes on after what is malformed.
        with pytest.raises(ApiError, match="has 6 value"):
            guard.propose(READY[:6], JOG)
        assert guard.propose(READY, JOG).scale == 1.0


def test_robot_and_first_proposal_may_come_in_one_message(url: str) -> None:
    step = {"state": {"positions": READY}, "proposal": {"twist": [0.1, 0, 0, 0, 0, 0],
                                                        "duration": 0.1}}  # fmt: skip
    with connect(f"{url.replace('http', 'ws')}/v1/guard") as socket:
        socket.send(json.dumps({"robot": "panda", "stop": "joints"} | step))
        assert json.loads(socket.recv())["scale"] == 1.0
        socket.send(json.dumps(step | {"latency": float("nan")}))
        assert json.loads(socket.recv())["status"] == 422
        socket.send("}")
        assert json.loads(socket.recv())["code"] == "VALIDATION_ERROR"
        socket.send(json.dumps(step))
        assert json.loads(socket.recv())["number"] == 2


def test_odd_openings_are_refused(url: str, client: httpx.Client) -> None:
    for opening, fault in (("[]", "VALIDATION_ERROR"), ('{"robot": "nobody"}', "NOT_FOUND"),
                           ('{"robot": "panda", "stop": "soon"}', "VALIDATION_ERROR")):  # fmt: skip
        with connect(f"{url.replace('http', 'ws')}/v1/guard") as socket:
            socket.send(opening)
            assert json.loads(socket.recv())["code"] == fault
            with pytest.raises(ConnectionClosed):
                socket.recv()
    with pytest.raises(InvalidStatus) as refused:
        connect(f"{url.replace('http', 'ws')}/v1/guard", origin="http://evil.example")  # type: ignore[arg-type]
    assert refused.value.response.status_code == 403
    assert b'"FORBIDDEN"' in (refused.value.response.body or b"")
    with pytest.raises(InvalidArgument, match="stp"):
        Guard("panda", url, stp="path")  # type: ignore[call-arg]
    body = {"robot": "panda", "state": {"positions": READY}}
    both = {"twist": [0.0] * 6, "duration": 0.1, "samples": [READY]}
    assert "exactly one" in _fault(client, body | {"proposal": both})
    less = {"samples": [READY], "period": 0.1}
    detail = _fault(client, body | {"proposal": less})
    assert "samples needs period and interpolation" in detail
    lone = {"joint_velocities": [0.0] * 7, "duration": 0.1}
    late = body | {"proposal": lone, "state": {"positions": READY, "elapsed": 0.1}}
    assert "no motion was accepted" in _fault(client, late)
    fine = answer(client.post("/v1/guard", json=body | {"proposal": lone}))
    assert fine["scale"] == 1.0


def test_a_session_outlives_the_time_that_heads_have(served: Any) -> None:
    # As `armwright serve` has its connections: what follows an upgrade is no head.
    make: Any = connection_class(ConnectionLimits(100, 0.3))
    with (
        serving(served.app, lifespan="off", http=make) as there,
        Guard("panda", str(there.base_url)) as guard,
    ):
        for _ in range(2):
            time.sleep(0.8)
            assert guard.propose(READY, JOG).scale == 1.0


def test_actions_of_a_policy_that_wanders_become_proved_ones(url: str, tmp_path: Path) -> None:
    """Every target that leaves the filter is free by coal and within the speed limits."""
    random, scale = np.random.default_rng(5), np.pi / 180.0
    keys = [f"joint_{i}.pos" for i in range(1, 8)]
    limits = arm("panda").chain.limits
    sent, aim, verdicts = [np.array(READY)], np.array(READY), set()
    with Guard("panda", url, scene=Scene(obstacles=[WALL])) as guard:
        step = GuardedActions(guard, keys, 1 / 30, scale)
        for k in range(150):
            if k % 25 == 0:
                aim = random.uniform(limits.lower, limits.upper)
            observed = sent[-1] + random.normal(0.0, 1e-4, 7)
            reach = 0.002 if k < 25 else 0.08
            target = observed + np.clip(aim - observed, -reach, reach)
            action = {"gripper.pos": 40.0} | dict(zip(keys, target / scale, strict=True))
            answered = step((action, dict(zip(keys, observed / scale, strict=True))))
            assert answered["gripper.pos"] == 40.0
            sent.append(scale * np.array([answered[key] for key in keys]))
            assert step.verdict is not None
            assert step.verdict.stop.certificate.verified
            verdicts.add((step.verdict.scale == 1.0, step.verdict.trajectory is None))
    rows = np.array(sent)
    assert verdicts >= {(True, False), (False, True)}
    speeds = np.abs(np.diff(rows, axis=0)) * 30.0
    assert (speeds <= limits.velocity * (1.0 + 1e-6)).all()
    assert np.abs(rows - READY).max() > 0.5
    wall = obstacles_scene.Obstacle(
        "wall", obstacles_shape.Box((0.1, 2.0, 2.0)), transform(None, [0.65, 0.0, 0.6])
    )
    between = np.concatenate([np.linspace(a, b, 8) for a, b in itertools.pairwise(rows)])
    assert not judge("panda", obstacles_scene.Scene((wall,)), tmp_path).overlaps(between).any()
