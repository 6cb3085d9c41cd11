"""Every method of the clients, the request that it makes, and handles of jobs."""

import asyncio
import json
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import httpx
import pytest

import armwright_client as ours
from armwright_client import AsyncClient, Client
from armwright_client import call as call_module
from tests.client.scripted import Answer, Scripted, noted_pauses, problem

URL = "http://robots.example"
POSE = ours.Pose.at(1, 2, 3)
AT = {"position": [1.0, 2.0, 3.0]}
SCENE = ours.Scene(name="s", obstacles=[])
TOOL = ours.NamedTool(name="t", form=ours.Torch(angle=0.3))
DH = ours.DhTable(
    convention="standard", rows=[ours.DhRow(type="revolute", a=1, alpha=0, d=0, theta=0)]
)
MOTION = ours.Trajectory(segments=[ours.Segment(t0=0, t1=1, coefficients=[[0, 1]])])
SENT_MOTION = {"segments": [{"t0": 0.0, "t1": 1.0, "coefficients": [[0.0, 1.0]]}]}
FIELD = {"joints": [0.0], "goal_joints": [1.0], "engine": "fcl", "timeout": 2.0}
EQUATIONS = {"velocities": [0.1], "accelerations": [0.2], "gravity": [0.0, 0.0, -1.0]}

#: Name of the method; how it is called; HTTP method, path with query, and fields of the body that
#: must be there as they are (None for no body).
TASK_STAGES = [ours.MoveStage(), ours.WaitStage(duration=1.0, name="rest")]
CALLS: list[tuple[str, Callable[[Any], Any], str, str, dict[str, Any] | None]] = [
    ("healthz", lambda c: c.healthz(), "GET", "/healthz", None),
    ("readyz", lambda c: c.readyz(), "GET", "/readyz", None),
    ("check", lambda c: c.check("r", [0.0], margin=0.1), "POST", "/v1/check",
     {"robot": "r", "joints": [0.0], "margin": 0.1}),
    ("check_batch", lambda c: c.check_batch("r", [[0.0], [1.0]]), "POST", "/v1/check",
     {"robot": "r", "joints": [[0.0], [1.0]]}),
    ("plan", lambda c: c.plan("r", [0.0], POSE, seed=3), "POST", "/v1/plan",
     {"robot": "r", "start": {"joints": [0.0]}, "goal": {"pose": AT}, "seed": 3}),
    ("plan", lambda c: c.plan("r", ours.Start(joints=[0], velocities=[1]), [2.0]), "POST",
     "/v1/plan", {"start": {"joints": [0.0], "velocities": [1.0]}, "goal": {"joints": [2.0]}}),
    ("plan_batch", lambda c: c.plan_batch([ours.BatchProblem(goal=ours.Goal(joints=[1]))],
                                          robot="r", start=[0.0], margin=0.1),
     "POST", "/v1/plan/batch",
     {"robot": "r", "start": {"joints": [0.0]}, "margin": 0.1,
      "problems": [{"goal": {"joints": [1.0]}}]}),
    ("validate", lambda c: c.validate("r", MOTION, tool_speed=0.5), "POST", "/v1/validate",
     {"robot": "r", "trajectory": SENT_MOTION, "tool_speed": 0.5}),
    ("guard", lambda c: c.guard("r", [0.0], ours.Proposal(joint_velocities=[1], duration=0.1), 0.01,
                                stop="joints"), "POST", "/v1/guard",
     {"robot": "r", "state": {"positions": [0.0]}, "latency": 0.01, "stop": "joints",
      "proposal": {"joint_velocities": [1.0], "duration": 0.1}}),
    ("plan_tour", lambda c: c.plan_tour(
        "r", [POSE, [1.0], ours.TourGoal(id="z", state="home", dwell=1.0)], end="start",
        precedence=[("0", "z")], rounds=2, timeout=3.0), "POST", "/v1/tours",
     {"robot": "r", "end": "start", "precedence": [["0", "z"]], "rounds": 2, "goals": [
         {"pose": AT}, {"joints": [1.0]},
         {"id": "z", "state": "home", "dwell": 1.0}]}),
    ("export_plan", lambda c: c.export_plan("id", "krl", ports={"spindle": 2}), "POST",
     "/v1/export", {"plan": "id", "format": "krl", "ports": {"spindle": 2}}),
    ("export", lambda c: c.export("r", MOTION, "krl", blend=0.1, name="pick"), "POST",
     "/v1/export", {"robot": "r", "trajectory": SENT_MOTION, "format": "krl", "blend": 0.1,
                    "name": "pick"}),
    ("retime", lambda c: c.retime([[0.0], [1.0]], knots=[0, 2], robot="r", timeout=3.0), "POST",
     "/v1/retime", {"path": {"joints": [[0.0], [1.0]], "knots": [0.0, 2.0]}, "robot": "r",
                    "timeout": 3.0}),
    ("retime", lambda c: c.retime([[0.0], [1.0]], limits_at=[ours.LimitsAt.of(
        begin=0, end=0.5, velocity=[0.1])]), "POST",
     "/v1/retime", {"path": {"joints": [[0.0], [1.0]]},
                    "limits_at": [{"from": 0.0, "to": 0.5, "velocity": [0.1]}]}),
    ("simplify", lambda c: c.simplify([[0.0], [1.0]], 1e-3, robot="r", scene="s", timeout=3.0),
     "POST", "/v1/paths/simplify", {"path": {"joints": [[0.0], [1.0]]}, "tolerance": 1e-3,
                                    "robot": "r", "scene": "s", "timeout": 3.0}),
    ("fit", lambda c: c.fit([0.0, 1.0], [[0.0], [1.0]], 1e-3, robot="r"), "POST",
     "/v1/paths/fit", {"samples": {"time": [0.0, 1.0], "position": [[0.0], [1.0]]},
                       "tolerance": 1e-3, "robot": "r", "rest": False}),
    ("convert_pose", lambda c: c.convert_pose(
        motions=[ours.PoseMotion(rpy=[0.1, 0.2, 0.3], about="fixed")], inverse=True), "POST",
     "/v1/poses/convert", {"motions": [{"rpy": [0.1, 0.2, 0.3], "about": "fixed"}],
                            "inverse": True}),
    ("retime_states", lambda c: c.retime_states(
        ours.JointState(position=[0.0], velocity=[0.5]), ours.JointState(position=[1.0]),
        robot="r", synchronization="time"), "POST",
     "/v1/retime", {"from": {"position": [0.0], "velocity": [0.5]}, "to": {"position": [1.0]},
                    "robot": "r", "synchronization": "time"}),
    ("lyapunov", lambda c: c.lyapunov([[0, 1], [-1, -1]], Q=[[1, 0], [0, 1]], x=[1, 0]), "POST",
     "/v1/lyapunov", {"A": [[0.0, 1.0], [-1.0, -1.0]], "Q": [[1.0, 0.0], [0.0, 1.0]],
                      "x": [1.0, 0.0]}),
    ("lyapunov", lambda c: c.lyapunov(f=["-x1"], V="x1**2", x=[1]), "POST",
     "/v1/lyapunov", {"f": ["-x1"], "V": "x1**2", "x": [1.0]}),
    ("simulate", lambda c: c.simulate("r", MOTION, {"type": "passivity"}, duration=2.0), "POST",
     "/v1/simulate", {"robot": "r", "trajectory": SENT_MOTION, "controller": {"type": "passivity"},
                      "duration": 2.0}),
    ("simulate", lambda c: c.simulate(
        "r", {"type": "hold", "joints": [0.1], "duration": 1.0}, {"type": "passivity"},
        motors={"inertia": 0.1}, joint_stops={}, coulomb_friction=[0.2]), "POST",
     "/v1/simulate", {"robot": "r", "reference": {"type": "hold", "joints": [0.1], "duration": 1.0},
                      "controller": {"type": "passivity"}, "motors": {"inertia": 0.1},
                      "joint_stops": {}, "coulomb_friction": [0.2]}),
    ("robots.create", lambda c: c.robots.create(ours.RobotUpload(name="a", dh=DH)), "POST",
     "/v1/robots", {"name": "a"}),
    ("robots.get", lambda c: c.robots.get("a b"), "GET", "/v1/robots/a%20b", None),
    ("robots.change", lambda c: c.robots.change(
        "a", joint_limits={"*": ours.JointLimits(jerk=2.0)},
        default_limits=ours.DefaultLimits(acceleration="10 x velocity")), "PATCH", "/v1/robots/a",
     {"joint_limits": {"*": {"jerk": 2.0}}, "default_limits": {"acceleration": "10 x velocity"}}),
    ("robots.urdf", lambda c: c.robots.urdf("a"), "GET", "/v1/robots/a/urdf", None),
    ("robots.urdf", lambda c: c.robots.urdf("a", merge_limits=True), "GET",
     "/v1/robots/a/urdf?joint_limits=merged", None),
    ("robots.srdf", lambda c: c.robots.srdf("a"), "GET", "/v1/robots/a/srdf", None),
    ("robots.geometry", lambda c: c.robots.geometry("a", tool="b"), "GET",
     "/v1/robots/a/geometry?tool=b", None),
    ("robots.equations", lambda c: c.robots.equations("a", "text"), "GET",
     "/v1/robots/a/equations?format=text", None),
    ("robots.equations", lambda c: c.robots.equations("a", "text", axes=["x", "rz"]), "GET",
     "/v1/robots/a/equations?format=text&axes=x%2Crz", None),
    ("robots.equations", lambda c: c.robots.equations("a", timeout=20.0), "GET",
     "/v1/robots/a/equations?format=latex&timeout=20.0", None),
    ("robots.delete", lambda c: c.robots.delete("a"), "DELETE", "/v1/robots/a", None),
    ("robots.list", lambda c: c.robots.list(after="x y", limit=3), "GET",
     "/v1/robots?after=x+y&limit=3", None),
    ("robots.fk", lambda c: c.robots.fk("a", [0.0], link="l", orientation="rpy"), "POST",
     "/v1/robots/a/fk", {"joints": [0.0], "link": "l", "orientation": "rpy"}),
    ("robots.fk_batch", lambda c: c.robots.fk_batch("a", [[0.0]], link=None), "POST",
     "/v1/robots/a/fk", {"joints": [[0.0]]}),
    ("robots.jacobian", lambda c: c.robots.jacobian("a", [0.0], point=[0, 0, 1]), "POST",
     "/v1/robots/a/jacobian", {"joints": [0.0], "point": [0.0, 0.0, 1.0]}),
    ("robots.jacobian_batch", lambda c: c.robots.jacobian_batch("a", [[0.0]], kind="analytic_zyz"),
     "POST", "/v1/robots/a/jacobian", {"joints": [[0.0]], "kind": "analytic_zyz"}),
    ("robots.ik", lambda c: c.robots.ik("a", POSE, axes=("x", "rz"), timeout=2.0), "POST",
     "/v1/robots/a/ik", {"pose": AT, "axes": ["x", "rz"], "timeout": 2.0}),
    ("robots.ik_batch", lambda c: c.robots.ik_batch("a", (POSE, POSE), max_solutions=1), "POST",
     "/v1/robots/a/ik", {"poses": [AT, AT], "max_solutions": 1}),
    ("robots.velocity", lambda c: c.robots.velocity("a", [0.0], twist=[1.0] * 6), "POST",
     "/v1/robots/a/velocity", {"joints": [0.0], "twist": [1.0] * 6}),
    ("robots.wrench", lambda c: c.robots.wrench("a", [0.0], [1.0] * 6, link="l"), "POST",
     "/v1/robots/a/wrench", {"joints": [0.0], "wrench": [1.0] * 6, "link": "l"}),
    ("robots.wrench_of_torques",
     lambda c: c.robots.wrench_of_torques("a", [0.0], [1.0], axes=["x"]), "POST",
     "/v1/robots/a/wrench", {"joints": [0.0], "torques": [1.0], "axes": ["x"]}),
    ("robots.wrench_batch", lambda c: c.robots.wrench_batch("a", [[0.0]], [1.0] * 6), "POST",
     "/v1/robots/a/wrench", {"joints": [[0.0]], "wrench": [1.0] * 6}),
    ("robots.dynamics", lambda c: c.robots.dynamics("a", [0.0], **EQUATIONS), "POST",
     "/v1/robots/a/dynamics", {"joints": [0.0]} | EQUATIONS),
    ("robots.dynamics_batch", lambda c: c.robots.dynamics_batch("a", [[0.0]], velocities=[[0.1]]),
     "POST", "/v1/robots/a/dynamics", {"joints": [[0.0]], "velocities": [[0.1]]}),
    ("robots.forward_dynamics", lambda c: c.robots.forward_dynamics("a", [0.0], torques=[0.5]),
     "POST", "/v1/robots/a/forward-dynamics", {"joints": [0.0], "torques": [0.5]}),
    ("robots.forward_dynamics_batch", lambda c: c.robots.forward_dynamics_batch("a", [[0.0]]),
     "POST", "/v1/robots/a/forward-dynamics", {"joints": [[0.0]]}),
    ("robots.calibrate", lambda c: c.robots.calibrate("a", [[0.1]], positions=[[1, 0, 0]]), "POST",
     "/v1/robots/a/calibrate", {"joints": [[0.1]], "positions": [[1.0, 0.0, 0.0]]}),
    ("robots.excitation", lambda c: c.robots.excitation("a", period=5.0, start=[0.1]), "POST",
     "/v1/robots/a/excitation", {"period": 5.0, "start": [0.1]}),
    ("robots.identify", lambda c: c.robots.identify(
        "a", [ours.LogBody.of(positions=[[0.0]], torques=[[1.0]])], find="payload"), "POST",
     "/v1/robots/a/identify", {"logs": [{"positions": [[0.0]], "torques": [[1.0]]}],
                               "find": "payload"}),
    ("robots.reach", lambda c: c.robots.reach("a", [POSE], margin=0.1), "POST",
     "/v1/robots/a/reach", {"poses": [AT], "margin": 0.1}),
    ("robots.reach_picture", lambda c: c.robots.reach_picture(
        "a", ours.ReachBox(size=[1.0, 1.0, 0.0], pose=POSE, spacing=0.1)), "POST",
     "/v1/robots/a/reach", {"box": {"size": [1.0, 1.0, 0.0], "pose": AT, "spacing": 0.1},
                            "format": "svg"}),
    ("robots.reach_mesh", lambda c: c.robots.reach_mesh(
        "a", ours.ReachBox(size=[1.0, 1.0, 0.0], pose=POSE, spacing=0.1)), "POST",
     "/v1/robots/a/reach", {"box": {"size": [1.0, 1.0, 0.0], "pose": AT, "spacing": 0.1},
                            "format": "glb"}),
    ("robots.potential", lambda c: c.robots.potential("a", [0.0], [1.0], "s", engine="fcl",
                                                      timeout=2.0),
     "POST", "/v1/robots/a/potential", FIELD | {"scene": "s"}),
    ("robots.potential_batch", lambda c: c.robots.potential_batch(
        "a", [[0.0]], [1.0], options=ours.PotentialOptions(attractive_cap=0.2)),
     "POST", "/v1/robots/a/potential",
     {"joints": [[0.0]], "goal_joints": [1.0],
      "options": {"attractive_cap": 0.2}}),
    ("robots.regressor", lambda c: c.robots.regressor("a", [0.0], [0.1], [0.2], motors=True),
     "POST", "/v1/robots/a/regressor",
     {"joints": [0.0], "velocities": [0.1], "accelerations": [0.2], "motors": True}),
    ("plan_task", lambda c: c.plan_task("a", [0.0], TASK_STAGES, improve=0.5, timeout=2.0), "POST",
     "/v1/tasks", {"robot": "a", "start": {"joints": [0.0]}, "improve": 0.5, "timeout": 2.0,
                   "stages": [
                       {"kind": "move"},
                       {"kind": "wait", "duration": 1.0, "name": "rest"}]}),
    ("scenes.create", lambda c: c.scenes.create(SCENE), "POST", "/v1/scenes",
     {"name": "s", "obstacles": []}),
    ("scenes.get", lambda c: c.scenes.get("s/1"), "GET", "/v1/scenes/s%2F1", None),
    ("scenes.replace", lambda c: c.scenes.replace("t", SCENE), "PUT", "/v1/scenes/t",
     {"obstacles": []}),
    ("scenes.delete", lambda c: c.scenes.delete("s"), "DELETE", "/v1/scenes/s", None),
    ("scenes.list", lambda c: c.scenes.list(limit=1), "GET", "/v1/scenes?limit=1", None),
    ("scenes.project", lambda c: c.scenes.project("s", [[0, 0, 1]], engine="fcl"), "POST",
     "/v1/scenes/s/project", {"points": [[0.0, 0.0, 1.0]], "engine": "fcl"}),
    ("tools.create", lambda c: c.tools.create(TOOL), "POST", "/v1/tools",
     {"name": "t", "form": {"type": "torch", "angle": 0.3}}),
    ("tools.get", lambda c: c.tools.get("t"), "GET", "/v1/tools/t", None),
    ("tools.replace", lambda c: c.tools.replace("u", TOOL), "PUT", "/v1/tools/u",
     {"form": {"type": "torch", "angle": 0.3}}),
    ("tools.delete", lambda c: c.tools.delete("t"), "DELETE", "/v1/tools/t", None),
    ("tools.list", lambda c: c.tools.list(after="t"), "GET", "/v1/tools?after=t", None),
    ("check", lambda c: c.check("r", [0.0], tool=TOOL, tcp=ours.HeldTip(object="peg")), "POST",
     "/v1/check", {"tool": {"name": "t", "form": {"type": "torch", "angle": 0.3}},
                   "tcp": {"object": "peg"}}),
    ("jobs.get", lambda c: c.jobs.get("7"), "GET", "/v1/jobs/7", None),
    ("jobs.cancel", lambda c: c.jobs.cancel("7"), "DELETE", "/v1/jobs/7", None),
    ("jobs.list", lambda c: c.jobs.list(status="running", after="6"), "GET",
     "/v1/jobs?after=6&status=running", None),
    ("plans.get", lambda c: c.plans.get("7"), "GET", "/v1/plans/7", None),
    ("plans.delete", lambda c: c.plans.delete("7"), "DELETE", "/v1/plans/7", None),
    ("plans.list", lambda c: c.plans.list(robot="r", limit=2), "GET",
     "/v1/plans?limit=2&robot=r", None),
    ("plans.replay", lambda c: c.plans.replay("7", {"margin": 0.1}, documents="current"), "POST",
     "/v1/plans/7/replay", {"changes": {"margin": 0.1}, "documents": "current"}),
    ("plans.bundle", lambda c: c.plans.bundle("7"), "GET", "/v1/plans/7/bundle", None),
    ("plans.view", lambda c: c.plans.view("7"), "GET", "/v1/plans/7/view", None),
    ("plans.view", lambda c: c.plans.view("7", tree=True), "GET", "/v1/plans/7/view?tree=true",
     None),
    ("plans.stop", lambda c: c.plans.stop("7", 0.5, kind="joints"), "POST", "/v1/plans/7/stop",
     {"at": 0.5, "kind": "joints"}),
    ("plans.witness", lambda c: c.plans.witness("7", part=2), "GET",
     "/v1/plans/7/witness?form=compact&part=2", None),
    ("plans.swept", lambda c: c.plans.swept("7", format="stl"), "GET",
     "/v1/plans/7/swept?format=stl&tolerance=0.005", None),
]  # fmt: skip
calls = pytest.mark.parametrize(
    ("name", "ask", "method", "path", "fields"), CALLS, ids=[call[0] for call in CALLS]
)


def refused() -> Scripted:
    """A service that refuses whatever it is asked, and keeps the request."""
    return Scripted([problem(422, "INVALID_REQUEST")])


def request_of(ask: Callable[[Any], Any]) -> httpx.Request:
    transport = refused()
    with Client(URL, transport=transport) as client, pytest.raises(ours.InvalidRequest):
        ask(client)
    return transport.requests[0]


async def awaited_request_of(ask: Callable[[Any], Any]) -> httpx.Request:
    transport = refused()
    async with AsyncClient(URL, transport=transport) as client:
        with pytest.raises(ours.InvalidRequest):
            await ask(client)
    return transport.requests[0]


@calls
def test_a_method_of_both_clients_asks_its_endpoint(
    name: str, ask: Any, method: str, path: str, fields: dict[str, Any] | None
) -> None:
    request, awaited = request_of(ask), asyncio.run(awaited_request_of(ask))
    assert (request.method, request.url.raw_path.decode()) == (method, path)
    if fields is None:
        assert request.content == b""
        assert "content-type" not in request.headers
    else:
        body = json.loads(request.content)
        assert {key: body[key] for key in fields} == fields
        assert None not in body.values()
    assert (awaited.method, awaited.url) == (request.method, request.url)
    assert (awaited.content, awaited.headers) == (request.content, request.headers)


@calls
def test_what_computes_can_be_asked_for_later(
    name: str, ask: Any, method: str, path: str, fields: dict[str, Any] | None
) -> None:
    transport = refused()
    with Client(URL, transport=transport) as client:
        group = name.partition(".")[0]
        if group in ("jobs", "plans", "tools"):
            assert not hasattr(client.later, group)
            return
        if method not in ("POST", "PUT"):
            with pytest.raises(ours.InvalidArgument, match="answered at once"):
                ask(client.later)
            assert transport.requests == []
            return
        with pytest.raises(ours.InvalidRequest):
            ask(client.later)
    (request,) = transport.requests
    assert request.headers["prefer"] == "respond-async"
    assert request.content == request_of(ask).content


def test_every_method_is_in_the_table() -> None:
    listed = {call[0] for call in CALLS} | {"jobs.events", "jobs.wait"}
    listed |= {"plans.import_bundle"}
    listed |= {f"{group}.iterate" for group in ("robots", "scenes", "tools", "jobs", "plans")}
    with Client(URL) as client:
        groups = {"": client, "robots.": client.robots, "scenes.": client.scenes,
                  "tools.": client.tools,
                  "jobs.": client.jobs, "plans.": client.plans}  # fmt: skip
        methods = {
            prefix + name
            for prefix, group in groups.items()
            for name in dir(group)
            if not name.startswith("_") and callable(getattr(group, name)) and name != "close"
        }
    assert methods == listed


def test_an_empty_answer_is_none() -> None:
    asks: list[Callable[[Any], Any]] = [
        lambda c: c.robots.delete("a"),
        lambda c: c.scenes.delete("a"),
    ]
    for ask in asks:
        with Client(URL, transport=Scripted([httpx.Response(204)])) as client:
            assert ask(client) is None


def test_arguments_are_checked_before_anything_is_sent() -> None:
    transport = Scripted([])
    with Client(URL, transport=transport) as client:
        for ask, words in (
            (lambda: client.robots.fk("a", []), "FkRequest: joints"),
            (lambda: client.check("r", [float("nan")]), "finite number"),
            (lambda: client.robots.dynamics("a", [0.0], wrench=[1.0]), "wrench"),
            (lambda: client.robots.ik("a", POSE, max_solution=1), "max_solution"),  # type: ignore[call-arg]
            (lambda: client.retime([[0.0], ["x"]]), "joints"),  # type: ignore[arg-type]
        ):
            with pytest.raises(ours.InvalidArgument, match=words):
                ask()
    assert transport.requests == []


def test_only_some_of_many_faults_are_told() -> None:
    with Client(URL) as client, pytest.raises(ours.InvalidArgument) as refused_here:
        client.robots.ik("a", POSE, seed="x", timeout="x", method="x", choice="x", all_turns="x")  # type: ignore[arg-type]
    assert str(refused_here.value).endswith("; and 2 more")


CERTIFICATE = {
    "verified": True, "proved": {"limits": True, "collisions": True, "reasons": []},
    "min_clearance": 0.1, "method": "m",
}  # fmt: skip


def job(status: str, http: int = 200, **more: Any) -> httpx.Response:
    return httpx.Response(http, json={"id": "7", "status": status} | more)


@pytest.fixture
def pauses(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The pauses that were made: the clock goes on by them, and nobody waits."""
    return noted_pauses(monkeypatch, call_module)


def pending(answers: list[Answer]) -> tuple[ours.Pending[ours.Certificate], Scripted]:
    """A validation that was accepted as job 7; the answers come when it is looked at."""
    transport = Scripted([job("queued", 202), *answers])
    client = Client(URL, transport=transport)
    return client.later.validate("r", MOTION), transport


def test_a_result_is_read_as_the_answer_of_its_request(pauses: list[float]) -> None:
    def done() -> httpx.Response:
        return job("succeeded", result=CERTIFICATE)

    async def awaited() -> ours.Certificate:
        transport = Scripted([job("queued", 202), job("running"), done()])
        async with AsyncClient(URL, transport=transport) as client:
            return await (await client.later.validate("r", MOTION)).wait()

    for answer in (pending([done()])[0].wait(), asyncio.run(awaited())):
        assert isinstance(answer, ours.Certificate)
        assert answer.verified
        assert answer.min_clearance == 0.1
    assert pauses == [0.02]


def test_pauses_grow_up_to_a_second(pauses: list[float]) -> None:
    answers: list[Answer] = [*(job("running") for _ in range(14))]
    handle, transport = pending([*answers, job("succeeded", result=CERTIFICATE)])
    handle.wait()
    assert pauses[0] == 0.02
    ratios = [b / a for a, b in pairwise(pauses[:10])]
    assert ratios == pytest.approx([1.5] * 9)
    assert pauses[-3:] == [1.0, 1.0, 1.0]
    paths = [request.url.path for request in transport.requests[1:]]
    assert paths == ["/v1/jobs/7"] * 15


def test_waiting_has_an_end(pauses: list[float]) -> None:
    handle, transport = pending([job("running") for _ in range(100)])
    with pytest.raises(ours.TransportTimeout, match="job 7 has not ended in time; it goes on"):
        handle.wait(0.5)
    assert sum(pauses) == pytest.approx(0.5)
    assert all(request.method != "DELETE" for request in transport.requests)


def test_without_any_time_a_job_is_looked_at_once(pauses: list[float]) -> None:
    handle, transport = pending([job("running")])
    with pytest.raises(ours.TransportTimeout):
        handle.wait(0.0)
    assert len(transport.requests) == 2
    done, _ = pending([job("succeeded", result=CERTIFICATE)])
    assert done.wait(0.0).verified


@pytest.mark.parametrize("code", sorted(ours.BY_CODE))
def test_a_failure_is_raised_as_the_error_of_its_code(pauses: list[float], code: str) -> None:
    error = {"code": code, "status": 418, "detail": "so it is", "hint": "Try this."}
    handle, _ = pending([job("failed", error=error)])
    with pytest.raises(ours.BY_CODE[code]) as raised:
        handle.wait()
    assert type(raised.value) is ours.BY_CODE[code]
    assert raised.value.status == 418
    assert str(raised.value) == f"{code}: so it is. Try this."


def test_a_failure_without_a_status_is_one_of_the_service(pauses: list[float]) -> None:
    handle, _ = pending([job("failed", error={"code": "FROM_THE_FUTURE"})])
    with pytest.raises(ours.ApiError) as raised:
        handle.wait()
    assert (type(raised.value), raised.value.status) == (ours.ApiError, 500)


@pytest.mark.parametrize("status", ["cancelled", "failed"])
def test_a_job_that_was_ended_is_preempted(pauses: list[float], status: str) -> None:
    results: list[dict[str, Any]] = [{}, {"result": CERTIFICATE}]
    for more in results:
        handle, _ = pending([job(status, **more)])
        with pytest.raises(ours.Preempted, match=f"job 7 was {status}") as raised:
            handle.wait()
        assert raised.value.status == 409


def test_a_handle_looks_at_its_job_and_ends_it() -> None:
    handle, transport = pending([job("running", progress=0.5), job("cancelled")])
    assert handle.id == "7"
    assert handle.job().progress == 0.5
    assert handle.cancel().status == "cancelled"
    requests = [(request.method, request.url.path) for request in transport.requests[1:]]
    assert requests == [("GET", "/v1/jobs/7"), ("DELETE", "/v1/jobs/7")]


def test_a_job_that_can_not_be_ended_says_so() -> None:
    handle, _ = pending([problem(409, "CONFLICT", detail="it has succeeded")])
    with pytest.raises(ours.Conflict, match="it has succeeded"):
        handle.cancel()


def test_a_job_is_waited_for_by_its_id_whatever_becomes_of_it(pauses: list[float]) -> None:
    for status in ("succeeded", "failed", "cancelled"):
        with Client(URL, transport=Scripted([job("running"), job(status)])) as client:
            assert client.jobs.wait("7").status == status

        async def awaited(last: str = status) -> ours.Job:
            transport = Scripted([job("running"), job(last)])
            async with AsyncClient(URL, transport=transport) as client:
                return await client.jobs.wait("7")

        assert asyncio.run(awaited()).status == status


@pytest.mark.parametrize(
    ("status", "done"),
    [("queued", False), ("running", False), ("succeeded", True), ("failed", True),
     ("cancelled", True), ("from_the_future", False)],
)  # fmt: skip
def test_a_job_has_ended_in_one_of_three_ways(status: str, done: bool) -> None:
    assert ours.Job(id="7", status=status).done is done


EVENTS = (
    b'id: 1\nevent: status\ndata: {"id":"7","status":"running","progress":0.25}\n\n'
    b": keep-alive\n\n"
    b'id: 2\nevent: end\ndata: {"id":"7","status":"failed","error":{"code":"CRASH"}}\n\n'
    b"id: 3\nevent: cut off\ndata: never completed"
)


def stream() -> httpx.Response:
    return httpx.Response(200, content=EVENTS, headers={"content-type": "text/event-stream"})


def test_events_come_as_they_are_told() -> None:
    handle, transport = pending([stream()])
    events = list(handle.events(after="5"))
    assert [(event.id, event.event) for event in events] == [("1", "status"), ("2", "end")]
    assert events[0].job().progress == 0.25
    error = events[1].job().error
    assert error is not None
    assert error.code == "CRASH"
    request = transport.requests[-1]
    assert (request.url.path, request.headers["last-event-id"]) == ("/v1/jobs/7/events", "5")

    async def awaited() -> list[ours.JobEvent]:
        async with AsyncClient(URL, transport=Scripted([stream()])) as client:
            return [event async for event in client.jobs.events("7")]

    assert asyncio.run(awaited()) == events


def test_events_of_a_job_that_is_not_there_are_an_error() -> None:
    with (
        Client(URL, transport=Scripted([problem(404, "NOT_FOUND")])) as client,
        pytest.raises(ours.NotFound),
    ):
        list(client.jobs.events("7"))


def test_events_without_a_listener_are_not_asked_for() -> None:
    transport = Scripted([])
    with Client(URL, transport=transport) as client:
        client.jobs.events("7")
    assert transport.requests == []


def test_a_request_for_later_has_no_deadline_of_its_own() -> None:
    transport = Scripted([job("queued", 202)])
    with Client(URL, transport=transport, timeout=3.0) as client:
        client.later.validate("r", MOTION, timeout=500.0)
    request = transport.requests[0]
    assert request.extensions["timeout"]["read"] == 3.0
    assert json.loads(request.content)["timeout"] == 500.0
