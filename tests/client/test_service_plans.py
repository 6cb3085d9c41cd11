"""Plans by the client: certificates, validation, jobs and batches, on a real service."""

import asyncio
from typing import Any

import pytest

import armwright_client as ours
from armwright_client import AsyncClient, Client
from tests.client.world import AWAY, POST, READY, TABLE, box, planar

pytestmark = pytest.mark.timeout(300)


@pytest.fixture(scope="module")
def plan(url: str) -> ours.Plan:
    """A plan around a post, within a scene of its own."""
    with Client(url) as client:
        return client.plan(
            "panda",
            READY,
            AWAY,
            scene=ours.Scene(obstacles=[TABLE, POST]),
            timing=ours.Timing(velocity_scaling=0.5, sample_period=0.05),
            margin=0.01,
            timeout=60,
            seed=3,
        )


def test_plans_are_certified(plan: ours.Plan) -> None:
    assert plan.status == "success"
    assert plan.certificate.verified
    assert plan.certificate.min_clearance is not None
    assert plan.certificate.min_clearance > 0.0
    assert plan.planner != "straight_line"  # the post is in its way
    assert plan.certificate.limits is not None
    assert plan.certificate.limits.velocity is not None
    assert 0.0 < (plan.certificate.limits.velocity.worst_ratio or 9.0) <= 1.0
    assert plan.planner in {stage.name for stage in plan.stages}
    assert plan.reproducibility.seed == 3


def test_failures_of_planning_are_told_apart(client: Client) -> None:
    block = ours.Scene(obstacles=[box("block", (0.3, 0.3, 0.3), (0.3, 0.0, 0.6))])
    with pytest.raises(ours.StartStateInCollision) as start:
        client.plan("panda", READY, AWAY, scene=block, timeout=30)
    assert start.value.pair is not None
    assert "block" in start.value.pair
    assert start.value.depth is not None
    assert start.value.depth > 0.0
    with pytest.raises(ours.GoalStateInvalid) as goal:
        client.plan("panda", READY, (9.0, *AWAY[1:]), timeout=30)
    assert goal.value.joint == client.robots.get("panda").joint_names[0]
    assert (goal.value.value, goal.value.problem.stage is not None) == (9.0, True)
    with pytest.raises(ours.TimedOut):
        client.plan("panda", READY, AWAY, timeout=1e-6)
    with pytest.raises(ours.NotFound):
        client.plan("panda", READY, AWAY, scene="nowhere")
    with pytest.raises(ours.ValidationFailed):
        client.plan("panda", READY, AWAY, planner="crystal_ball")  # type: ignore[arg-type]


def test_many_can_be_asked_at_once(url: str) -> None:
    async def ask() -> tuple[Any, ...]:
        async with AsyncClient(url) as client:
            return await asyncio.gather(
                client.plan("panda", READY, AWAY, timeout=60),
                client.robots.fk("panda", READY),
                client.check("panda", READY, scene=ours.Scene(obstacles=[TABLE])),
                client.scenes.list(),
                client.robots.get("ur5e"),
            )

    plan, fk, check, scenes, robot = asyncio.run(ask())
    assert plan.certificate.verified
    assert len(fk.pose.position) == 3
    assert check.valid
    assert scenes.scenes is not None
    assert robot.wrist == "three_parallel"


def test_anything_can_be_asked_for_later(client: Client) -> None:
    pending = client.later.plan("panda", READY, AWAY, timeout=60, seed=3)
    told = [event.job() for event in pending.events()]
    # The first one tells how the job stands when its events are asked for.
    assert (told[-1].status, told[-1].id) == ("succeeded", pending.id)
    plan = pending.wait(60)
    assert plan.trajectory == client.plan("panda", READY, AWAY, timeout=60, seed=3).trajectory
    job = pending.job()
    assert (job.done, job.operation, job.progress) == (True, "POST /v1/plan", 1.0)
    assert client.jobs.wait(pending.id) == job
    assert job.created <= job.ended  # type: ignore[operator]
    assert list(client.jobs.events(pending.id, after="9999")) == []
    poses = client.later.robots.fk("panda", READY).wait(10)
    assert poses == client.robots.fk("panda", READY)
    assert pending.id in {job.id for job in client.jobs.list(status="succeeded").jobs}
    made = client.later.robots.create(planar("later"), idempotency_key="later")
    again = client.later.robots.create(planar("later"), idempotency_key="later")
    assert (again.id, made.wait(60).name) == (made.id, "later")
    assert made.job().location == "/v1/robots/later"
    client.robots.delete("later")


def test_what_fails_later_is_raised_later(client: Client) -> None:
    pending = client.later.plan("panda", READY, (9.0, *AWAY[1:]), timeout=30)
    with pytest.raises(ours.GoalStateInvalid) as caught:
        pending.wait(60)
    assert caught.value.joint == "panda_joint1"
    with pytest.raises(ours.Conflict):
        pending.cancel()
    with pytest.raises(ours.NotFound):
        client.later.plan("panda", READY, AWAY, scene="nowhere")
    with pytest.raises(ours.InvalidArgument, match="at once"):
        client.later.robots.get("panda")


def test_jobs_are_cancelled(client: Client) -> None:
    goals = [ours.BatchProblem.towards(AWAY, seed=seed) for seed in range(1000)]
    pending = client.plan_batch(goals, robot="panda", start=READY)
    cancelled = pending.cancel()
    assert (cancelled.status, cancelled.done) == ("cancelled", True)
    with pytest.raises(ours.Preempted, match=pending.id):
        pending.wait(10)
    assert client.jobs.cancel(pending.id).status == "cancelled"


def test_batches_are_planned_in_order(url: str) -> None:
    problems: list[ours.PlanRequest | ours.BatchProblem] = [
        ours.BatchProblem.towards(AWAY),
        ours.BatchProblem.towards((9.0, *AWAY[1:])),
        ours.BatchProblem.towards(
            READY, start=ours.Start(joints=AWAY), scene=ours.Scene(obstacles=[])
        ),
        ours.PlanRequest(
            robot="planar_rr", start=ours.Start(joints=[0, 0]), goal=ours.Goal(joints=[1, 1])
        ),
    ]

    async def ask() -> tuple[ours.BatchAnswer, list[str]]:
        async with AsyncClient(url) as client:
            pending = await client.plan_batch(
                problems, robot="panda", start=READY, scene=ours.Scene(obstacles=[TABLE])
            )
            kinds = [event.event async for event in pending.events()]
            assert (await client.jobs.wait(pending.id, 60)).done
            assert (await pending.job()).done
            return await pending.wait(60), kinds

    answer, kinds = asyncio.run(ask())
    assert (answer.succeeded, answer.failed, kinds[-1]) == (3, 1, "end")
    one, two, three, four = answer.results
    assert isinstance(one, ours.Plan)
    assert isinstance(two, ours.Problem)
    assert two.code == "GOAL_STATE_INVALID"
    assert isinstance(three, ours.Plan)
    assert isinstance(four, ours.Plan)
    assert three.path.joints[-1] == pytest.approx(READY)
    assert four.trajectory.joint_names != one.trajectory.joint_names
