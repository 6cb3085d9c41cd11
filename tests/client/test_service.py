"""The client against a real service: what is typed here is what is answered there."""

import asyncio
import base64
import io
import json
import zipfile
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pinocchio
import pytest
import trimesh
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

import armwright_client as ours
from armwright_client import AsyncClient, Client, Pose
from service.app import create_app
from service.http.errors import KINDS
from service.settings import Settings

pytestmark = pytest.mark.timeout(300)

READY = (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785)
AWAY = (1.2, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785)


def box(name: str, size: Sequence[float], position: Sequence[float]) -> ours.Obstacle:
    return ours.Obstacle(id=name, shape=ours.Box(size=size), pose=Pose(position=position))


TABLE = box("table_top", (0.6, 0.8, 0.04), (0.7, 0.0, -0.1))
POST = box("post", (0.04, 0.04, 0.6), (0.42, 0.22, 0.5))


@pytest.fixture
def table(client: Client) -> Any:
    """A stored scene, forgotten afterwards."""
    client.scenes.replace("table", ours.Scene(obstacles=[TABLE]))
    yield "table"
    client.scenes.delete("table")


# ------------------------------------------------------------------- the service as a whole


def test_health(client: Client) -> None:
    health = client.healthz()
    assert (health.status, health.version) == ("ok", ours.__version__)
    assert client.readyz().workers == 1


def test_every_kind_of_problem_has_a_class(url: str) -> None:
    listed = httpx.get(f"{url}/v1/problems").json()["problems"]
    assert {kind["code"] for kind in listed} == set(KINDS) <= ours.BY_CODE.keys()


def test_an_application_can_stand_in_for_the_network(tmp_path: Path) -> None:
    """The seam of httpx: no socket, no workers, the application itself."""
    app = create_app(Settings(data_dir=tmp_path, workers=1))

    async def ask() -> tuple[ours.Health, str]:
        transport = httpx.ASGITransport(app)
        async with AsyncClient("http://app", transport=transport) as client:
            with pytest.raises(ours.ValidationFailed) as caught:
                await client.plan("no name", READY, AWAY)
            return await client.healthz(), caught.value.problem.instance

    health, instance = asyncio.run(ask())
    assert (health.status, instance) == ("ok", "/v1/plan")


# ------------------------------------------------------------------------------ kinematics


def test_velocities_and_every_kind_of_inverse_kinematics(client: Client) -> None:
    told = client.robots.velocity("panda", READY, joint_velocities=[0.1] * 7)
    back = client.robots.velocity("panda", READY, twist=told.twist, nullspace=[0.1] * 7)
    assert back.joint_velocities == pytest.approx([0.1] * 7, abs=1e-9)
    assert back.damped == []
    pose = client.robots.fk("panda", READY).pose
    near = client.robots.ik("panda", pose, seed_joints=READY, method="analytic")
    assert near.solutions[0].joints == pytest.approx(READY, abs=1e-6)
    assert "q7=" in (near.solutions[0].branch or "")
    seed = [x + 0.1 for x in READY]
    way = ours.Gradient(rule="transpose", trace=True)
    traced = client.robots.ik("panda", pose, seed_joints=seed, method="gradient", gradient=way)
    assert traced.trace is not None
    assert traced.trace.joints[0] == pytest.approx(seed)
    every = client.robots.ik(
        "ur5e",
        client.robots.fk("ur5e", [0.3, -1.0, 1.4, -0.7, -1.3, 0.2]).pose,
        all_solutions=True,
        all_turns=True,
        choice="limits",
    )
    assert len(every.solutions) == 256
    free = client.robots.ik("panda", pose, axes=["x", "y", "z"], choice="manipulability")
    error = free.solutions[0].position_error
    assert error is not None
    assert error <= 1e-6


def test_the_potential_at_one_configuration_and_at_many(client: Client) -> None:
    scene = ours.Scene(obstacles=[TABLE])
    options = ours.PotentialOptions(influence_distance=0.5)
    one = client.robots.potential("panda", READY, AWAY, scene, options=options)
    many = client.robots.potential_batch("panda", [READY, AWAY], AWAY, scene, options=options)
    assert many.potential[0] == one.potential > many.potential[1]
    assert one.gradient == [-force for force in one.joint_force]
    assert many.control_points[0] == one.control_points
    assert one.control_points[-1].obstacle == TABLE.id


# ---------------------------------------------------------------------------------- timing


def test_paths_are_timed_and_told_in_other_shapes(client: Client, url: str) -> None:
    timing = ours.RetimeTiming(method="jerk_limited", tool_speed=0.5, payload=ours.Payload(mass=1))
    found = client.retime([READY, AWAY], robot="panda", timing=timing)
    assert found.certificate.verified
    assert found.certificate.limits is not None
    for use in (found.certificate.limits.jerk, found.certificate.limits.tool_speed):
        assert use is not None
        assert use.worst_ratio is not None
        assert use.worst_ratio <= 1.0 + 1e-9
    package = client.retime([READY, AWAY], robot="panda", timing=ours.RetimeTiming(solver="toppra"))
    assert package.certificate.verified
    assert any("toppra's answer" in note for note in package.notes)
    body = {"trajectory": json.loads(found.trajectory.model_dump_json()), "sample_period": 0.05}
    body["trajectory"].pop("interpolation", None)
    with httpx.Client(base_url=url) as plain:
        message = plain.post("/v1/convert", json=body).json()
        table = plain.post("/v1/convert", json=body | {"format": "csv"}).text
    assert found.trajectory.joint_trajectory(0.05) == message
    assert found.trajectory.csv(0.05) == table


# ---------------------------------------------------------------------------------- scenes


def test_scenes_are_stored_listed_replaced_and_forgotten(client: Client) -> None:
    scene = ours.Scene(name="life", obstacles=[TABLE], allowed_collisions=[("table_top", "x")])
    created = client.scenes.create(scene)
    assert (created.name, created.version) == ("life", 1)
    assert client.scenes.get("life") == scene
    with pytest.raises(ours.Conflict):
        client.scenes.create(scene)
    replaced = client.scenes.replace("life", ours.Scene(name="other", obstacles=[POST]))
    assert (replaced.name, replaced.version) == ("life", 2)
    assert "life" in {summary.name for summary in client.scenes.list().scenes}
    assert client.scenes.list(after="life~").scenes == []
    client.scenes.delete("life")
    with pytest.raises(ours.NotFound):
        client.scenes.get("life")


def test_pages_lead_to_each_other(client: Client) -> None:
    names = ["page-a", "page-b", "page-c"]
    for name in names:
        client.scenes.create(ours.Scene(name=name, obstacles=[]))
    found, after = [], "page"
    for _ in names:
        page = client.scenes.list(after=after, limit=1)
        found += [summary.name for summary in page.scenes]
        after = page.next or ""
    assert found == names
    for name in names:
        client.scenes.delete(name)


def test_a_key_makes_creation_repeatable(client: Client) -> None:
    scene = ours.Scene(name="once", obstacles=[])
    first = client.scenes.create(scene, idempotency_key="only-once")
    assert client.scenes.create(scene, idempotency_key="only-once") == first
    with pytest.raises(ours.IdempotencyKeyReused):
        client.scenes.create(ours.Scene(name="twice", obstacles=[]), idempotency_key="only-once")
    client.scenes.delete("once")


def test_what_the_service_refuses_names_the_field(client: Client) -> None:
    with pytest.raises(ours.ValidationFailed, match=r"obstacle 'table_top' stands twice") as caught:
        client.scenes.create(ours.Scene(name="twins", obstacles=[TABLE, TABLE]))
    assert caught.value.details["errors"][0]["path"] == "obstacles"


def test_every_shape_is_stored(client: Client) -> None:
    cube = trimesh.creation.box((0.1, 0.1, 0.1))
    stl = base64.b64encode(cube.export(file_type="stl")).decode()
    shapes: list[ours.Shape] = [
        ours.Box(size=(0.1, 0.1, 0.1)),
        ours.Sphere(radius=0.1),
        ours.Cylinder(radius=0.1, height=0.2),
        ours.Capsule(radius=0.1, height=0.2),
        ours.Cone(radius=0.1, height=0.2),
        ours.Halfspace(normal=(0, 0, 1), offset=-1),
        ours.Convex.of(vertices=cube.vertices),
        ours.Mesh.of(vertices=cube.vertices, faces=cube.faces),
        ours.Mesh(stl_base64=stl),
        ours.PointCloud.of(points=cube.vertices, radius=0.01),
    ]
    obstacles = [
        ours.Obstacle(id=f"{i}", shape=shape, pose=Pose.at(i, 0, 0))
        for i, shape in enumerate(shapes)
    ]
    scene = ours.Scene(name="shapes", obstacles=obstacles)
    client.scenes.create(scene)
    assert client.scenes.get("shapes") == scene
    client.scenes.delete("shapes")


def test_points_are_projected(client: Client) -> None:
    ball = ours.Obstacle(id="ball", shape=ours.Sphere(radius=0.2), pose=Pose.at(1, 0, 0))
    client.scenes.replace("ball", ours.Scene(obstacles=[ball]))
    points = np.random.default_rng(3).normal(size=(20, 3)) * 2
    answer = client.scenes.project("ball", points)
    for point, found in zip(points, answer.projections, strict=True):
        away = point - (1, 0, 0)
        length = np.linalg.norm(away)
        assert found[0].obstacle == "ball"
        assert found[0].distance == pytest.approx(length - 0.2, abs=1e-6)
        expected = np.array([1, 0, 0]) + 0.2 * away / length
        np.testing.assert_allclose(found[0].projection, expected, atol=1e-6)
    client.scenes.delete("ball")


# ---------------------------------------------------------------------------------- robots


def test_built_in_robots_are_there_and_stay(client: Client) -> None:
    names = {robot.name: robot for robot in client.robots.list().robots}
    assert {"panda", "ur5e", "stanford", "planar_rr"} <= names.keys()
    assert (names["panda"].built_in, names["panda"].joints) == (True, 7)
    panda = client.robots.get("panda")
    assert len(panda.joint_names) == len(panda.limits.velocity) == 7
    assert panda.tip_link in panda.links
    with pytest.raises(ours.Conflict):
        client.robots.delete("panda")
    with pytest.raises(ours.NotFound, match="panda"):
        client.robots.get("pandora")


def planar(name: str) -> ours.RobotUpload:
    row = ours.DhRow(
        type="revolute", a=0.5, alpha=0, d=0, theta=0, lower=-3, upper=3, velocity=2, acceleration=5
    )
    return ours.RobotUpload.from_dh(name, ours.DhTable(convention="standard", rows=[row, row]))


def test_a_table_becomes_a_robot(client: Client) -> None:
    robot = client.robots.create(planar("mine"), idempotency_key="mine-1")
    assert (robot.name, robot.joint_types) == ("mine", ["revolute", "revolute"])
    assert robot.limits.velocity == [2.0, 2.0]
    assert client.robots.create(planar("mine"), idempotency_key="mine-1") == robot
    pose = client.robots.fk("mine", (0.3, 0.4)).pose
    expected = 0.5 * np.array([np.cos(0.3) + np.cos(0.7), np.sin(0.3) + np.sin(0.7), 0.0])
    np.testing.assert_allclose(pose.position, expected, atol=1e-12)
    with pytest.raises(ours.Conflict):
        client.robots.create(planar("mine"))
    client.robots.delete("mine")
    with pytest.raises(ours.NotFound):
        client.robots.fk("mine", (0.3, 0.4))


URDF = """<robot name="pendulum">
  <link name="base"/>
  <link name="arm">
    <visual><geometry><mesh filename="package://pendulum/visual/gone.dae"/></geometry></visual>
    <collision><origin xyz="0.25 0 0"/><geometry><mesh filename="{0}"/></geometry></collision>
  </link>
  <joint name="pivot" type="revolute">
    <parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" velocity="1" effort="1"/>
  </joint>
</robot>"""


@pytest.mark.parametrize("uri", ["package://pendulum/meshes/rod.stl", "../meshes/rod.stl"])
def test_a_description_comes_with_its_meshes(client: Client, tmp_path: Path, uri: str) -> None:
    package = tmp_path / "pendulum"
    for folder in ("urdf", "meshes"):
        (package / folder).mkdir(parents=True)
    (package / "urdf" / "arm.urdf").write_text(URDF.format(uri))
    rod = trimesh.creation.box((0.5, 0.02, 0.02))
    (package / "meshes" / "rod.stl").write_bytes(rod.export(file_type="stl"))
    limits = {"pivot": ours.JointLimits(acceleration=3.0)}
    upload = ours.RobotUpload.from_urdf(package / "urdf" / "arm.urdf", joint_limits=limits)
    robot = client.robots.create(upload)
    assert (robot.name, robot.joint_names) == ("pendulum", ["pivot"])
    assert robot.limits.acceleration == [3.0]
    # The rod reaches from 0 to 0.5 along x and is 0.02 wide: a wall at 0.6 is 0.1 away.
    wall = ours.Scene(obstacles=[box("wall", (0.2, 1, 1), (0.7, 0, 0))])
    check = client.check("pendulum", [0.0], scene=wall)
    assert check.valid
    assert check.clearance == pytest.approx(0.1, abs=1e-6)
    client.robots.delete("pendulum")


def test_an_archive_becomes_a_robot(client: Client, tmp_path: Path) -> None:
    rod = trimesh.creation.box((0.5, 0.02, 0.02)).export(file_type="stl")
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        archive.writestr("pendulum/urdf/arm.urdf", URDF.format("package://pendulum/meshes/rod.stl"))
        archive.writestr("pendulum/meshes/rod.stl", rod)
    path = tmp_path / "zipped.zip"
    path.write_bytes(content.getvalue())
    limits = {"pivot": ours.JointLimits(jerk=9.0)}
    robot = client.robots.create(ours.RobotArchive.from_file(path, joint_limits=limits))
    assert (robot.name, robot.limits.jerk) == ("zipped", [9.0])
    client.robots.delete("zipped")


def test_a_description_that_is_none_is_refused(client: Client) -> None:
    with pytest.raises(ours.InvalidRobotDescription):
        client.robots.create(ours.RobotUpload(name="none", urdf="<robot name='x'/>"))


# ------------------------------------------------------------------------------ kinematics


def test_poses_are_those_of_pinocchio(client: Client, tmp_path: Path) -> None:
    robot = client.robots.get("panda")
    rows = np.random.default_rng(1).uniform(
        np.array(robot.limits.lower, float), np.array(robot.limits.upper, float), (5, 7)
    )
    model = pinocchio.buildModelFromUrdf(
        str(Path(__file__).parents[2] / "kinematics" / "robots" / "panda.urdf")
    )
    data, frame = model.createData(), model.getFrameId(robot.tip_link)
    batch = client.robots.fk_batch("panda", rows)
    for row, pose in zip(rows, batch.pose, strict=True):
        q = np.concatenate([row, np.zeros(model.nq - 7)])
        pinocchio.framesForwardKinematics(model, data, q)
        np.testing.assert_allclose(pose.position, data.oMf[frame].translation, atol=1e-9)
        rotation = Rotation.from_quat(np.array(pose.quaternion_xyzw)).as_matrix()
        np.testing.assert_allclose(rotation, data.oMf[frame].rotation, atol=1e-9)
        one = client.robots.fk("panda", row)
        assert one.pose == pose
        assert one.links.keys() == batch.links.keys()


def test_jacobians_are_derivatives_of_poses(client: Client) -> None:
    step = 1e-6
    ahead = client.robots.fk_batch("panda", np.array(READY) + step * np.eye(7)).pose
    behind = client.robots.fk_batch("panda", np.array(READY) - step * np.eye(7)).pose
    slopes = [
        (np.array(a.position) - np.array(b.position)) / (2 * step)
        for a, b in zip(ahead, behind, strict=True)
    ]
    answer = client.robots.jacobian("panda", READY)
    np.testing.assert_allclose(np.array(answer.jacobian)[:3], np.array(slopes).T, atol=1e-8)
    assert answer.rank == 6
    batch = client.robots.jacobian_batch("panda", [READY, AWAY], point=(0, 0, 0.1))
    assert np.shape(batch.jacobian) == (2, 6, 7)
    assert batch.rank == [6, 6]


def test_inverse_kinematics_reaches_the_pose(client: Client) -> None:
    pose = client.robots.fk("panda", AWAY).pose  # what was answered can be asked
    answer = client.robots.ik("panda", pose, seed_joints=READY, timeout=30)
    best = answer.solutions[0]
    assert best.within_limits
    assert best.position_error is not None
    assert best.position_error < 1e-4
    reached = client.robots.fk("panda", best.joints).pose
    np.testing.assert_allclose(reached.position, pose.position, atol=1e-4)


def test_what_the_robot_can_not_is_an_error_of_its_own(client: Client) -> None:
    with pytest.raises(ours.NoIkSolution):
        client.robots.ik("panda", Pose.at(5, 0, 0), timeout=30)
    with pytest.raises(ours.InvalidLinkName):
        client.robots.fk("panda", READY, link="tail")
    with pytest.raises(ours.InvalidRobotState):
        client.robots.fk("panda", [0.0])


# --------------------------------------------------------------------- checks and planning


def test_checks_tell_what_collides(client: Client, table: str) -> None:
    assert client.check("panda", READY, scene=table).valid
    block = ours.Scene(obstacles=[box("block", (0.3, 0.3, 0.3), (0.3, 0.0, 0.6))])
    answer = client.check("panda", READY, scene=block)
    assert not answer.valid
    assert answer.clearance is not None
    assert answer.clearance < 0.0
    assert any("block" in collision.pair for collision in answer.collisions)
    batch = client.check_batch("panda", [READY, AWAY], scene=table, timeout=30)
    assert batch.valid == [True, True]
    assert len(batch.clearance) == len(batch.collisions) == 2
    beyond = client.check("panda", (9.0, *READY[1:]))
    assert beyond.limit_violations[0].value == 9.0


def test_a_part_in_the_hand_is_checked_too(client: Client) -> None:
    robot = client.robots.get("panda")
    rod = ours.Attached(
        id="rod",
        shape=ours.Capsule(radius=0.01, height=0.6),
        pose=Pose.at(0, 0, 0.4),
        link=robot.tip_link,
        touch_links=robot.links,
    )
    floor = ours.Scene(obstacles=[box("floor", (3, 3, 0.02), (0, 0, -0.2))], allowed_collisions=[])
    assert client.check("panda", READY, scene=floor).valid
    answer = client.check("panda", READY, scene=floor, attached=[rod])
    assert not answer.valid
    assert {frozenset(collision.pair) for collision in answer.collisions} == {
        frozenset(("rod", "floor"))
    }


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


def test_trajectories_are_sampled_as_the_service_does(plan: ours.Plan) -> None:
    motion = plan.trajectory
    assert motion.samples is not None
    np.testing.assert_allclose(motion.sample([0.0])[0], READY, atol=1e-6)
    np.testing.assert_allclose(motion.sample([motion.duration])[0], AWAY, atol=1e-6)
    for derivative, rows in enumerate((motion.samples.position, motion.samples.velocity)):
        np.testing.assert_allclose(
            motion.sample(motion.samples.time, derivative), np.array(rows), atol=1e-9
        )


def test_plans_can_be_validated_again(client: Client, plan: ours.Plan) -> None:
    scene = ours.Scene(obstacles=[TABLE, POST])
    certificate = client.validate("panda", plan.trajectory, scene=scene, timeout=60)
    assert certificate.verified
    # The same motion with a block in its way is refused, with the moment.
    middle = client.robots.fk("panda", plan.trajectory.sample([plan.trajectory.duration / 2])[0])
    block = box("block", (0.1, 0.1, 0.1), middle.pose.position)
    blocked = ours.Scene(obstacles=[TABLE, POST, block])
    refused = client.validate("panda", plan.trajectory, scene=blocked, timeout=60)
    assert not refused.verified
    assert refused.violation is not None
    assert 0.0 < refused.violation["time"] < plan.trajectory.duration
    # And so is one that is faster than the joints are.
    slow = client.validate(
        "panda", plan.trajectory, limits=ours.LimitValues(velocity=[0.01] * 7), timeout=60
    )
    assert not slow.verified


def test_motions_of_others_are_validated(client: Client) -> None:
    times = [0.0, 2.0, 4.0]
    points = np.array([READY, np.add(READY, AWAY) / 2, AWAY])
    spline = CubicSpline(times, points, bc_type="clamped")
    segments = [
        ours.Segment(t0=t0, t1=t1, coefficients=spline.c[::-1, i, :].T.tolist())
        for i, (t0, t1) in enumerate(pairwise(times))
    ]
    assert client.validate("panda", ours.Trajectory(segments=segments), timeout=60).verified


def test_goals_may_be_poses(client: Client) -> None:
    pose = client.robots.fk("panda", AWAY).pose
    goal = ours.Goal.among([ours.Goal.at_pose(pose, position_tolerance=1e-3)])
    for wanted in (pose, goal):
        plan = client.plan("panda", READY, wanted, timeout=60)
        end = plan.trajectory.sample([plan.trajectory.duration])[0]
        reached = client.robots.fk("panda", end).pose
        np.testing.assert_allclose(reached.position, pose.position, atol=2e-3)


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
        client.plan("panda", READY, AWAY, planner="crystal_ball")


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


# -------------------------------------------------------------------------------------- jobs


def test_anything_can_be_asked_for_later(client: Client) -> None:
    pending = client.later.plan("panda", READY, AWAY, timeout=60, seed=3)
    told = [event.job() for event in pending.events()]
    assert (told[0].status, told[-1].status, told[-1].id) == ("queued", "succeeded", pending.id)
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


def test_waiting_has_an_end(client: Client) -> None:
    goals = [ours.BatchProblem.towards(AWAY, seed=seed) for seed in range(500)]
    pending = client.plan_batch(goals, robot="panda", start=READY)
    with pytest.raises(ours.TransportTimeout, match="goes on"):
        pending.wait(0.1)
    pending.cancel()
