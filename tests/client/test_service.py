"""The client against a real service: answers are read as what the domain computes."""

import asyncio
import io
import json
import zipfile
from pathlib import Path

import httpx
import numpy as np
import pytest
import trimesh
from pydantic import ValidationError

import armwright_client as ours
from armwright_client import AsyncClient, Client, Pose
from dynamics.inverse import inverse_dynamics
from dynamics.model.payload import with_payload
from dynamics.terms import coriolis_matrix, mass_matrix
from kinematics.forward import forward
from kinematics.jacobian import geometric
from kinematics.robots import builtin_chain
from kinematics.velocity import holding_torques
from service.app import create_app
from service.settings import Settings
from tests.client.world import AWAY, POST, READY, TABLE, box, planar

pytestmark = pytest.mark.timeout(300)
RATES = (0.5, -0.4, 0.3, 0.2, -0.6, 0.1, 0.9)
PULL = (1.0, -2.0, 3.0, 0.1, 0.2, -0.3)


def test_health(client: Client) -> None:
    health = client.healthz()
    assert (health.status, health.version) == ("ok", ours.__version__)
    assert client.readyz().workers == 1


def test_an_application_can_stand_in_for_the_network(tmp_path: Path) -> None:
    """The seam of httpx: no socket, no workers, the application itself."""
    app = create_app(Settings(data_dir=tmp_path, workers=1))

    async def ask() -> tuple[ours.Health, str]:
        transport = httpx.ASGITransport(app)
        async with AsyncClient("http://app", transport=transport) as client:
            with pytest.raises(ours.ValidationFailed) as caught:
                await client.jobs.list(status="nonsense")
            return await client.healthz(), caught.value.problem.instance

    health, instance = asyncio.run(ask())
    assert (health.status, instance) == ("ok", "/v1/jobs")


# ------------------------------------------------------------------------------------- robots


def test_built_in_robots_are_there_and_stay(client: Client) -> None:
    names = {robot.name: robot for robot in client.robots.list().robots}
    assert {"panda", "ur5e", "stanford", "planar_rr"} <= names.keys()
    assert (names["panda"].built_in, names["panda"].joints) == (True, 7)
    panda = client.robots.get("panda")
    assert len(panda.joint_names) == len(panda.limits.velocity) == 7
    with pytest.raises(ours.Conflict):
        client.robots.delete("panda")
    with pytest.raises(ours.NotFound, match="panda"):
        client.robots.get("pandora")


def test_a_table_becomes_a_robot(client: Client) -> None:
    robot = client.robots.create(planar("mine"), idempotency_key="mine-1")
    assert (robot.name, robot.joint_types) == ("mine", ["revolute", "revolute"])
    assert client.robots.create(planar("mine"), idempotency_key="mine-1") == robot
    with pytest.raises(ours.IdempotencyKeyReused):
        client.robots.create(planar("twice"), idempotency_key="mine-1")
    pose = client.robots.fk("mine", (0.3, 0.4)).pose
    expected = 0.5 * np.array([np.cos(0.3) + np.cos(0.7), np.sin(0.3) + np.sin(0.7), 0.0])
    np.testing.assert_allclose(pose.position, expected, atol=1e-12)
    client.robots.delete("mine")
    with pytest.raises(ours.NotFound):
        client.robots.fk("mine", (0.3, 0.4))


def test_motors_of_a_table_come_back(client: Client) -> None:
    motor = ours.Motor(inertia=1e-4, gear_ratio=50.0, torque_constant=0.05, voltage_limit=24.0)
    row = ours.DhRow(type="revolute", a=0.5, alpha=0.0, d=0.0, theta=0.0, motor=motor)
    table = ours.DhTable(convention="standard", rows=[row])
    robot = client.robots.create(ours.RobotUpload.from_dh("with_motor", table))
    assert robot.motors == {"joint_1": motor}
    assert robot.dh is not None
    again = client.robots.create(ours.RobotUpload.from_dh("with_motor_too", robot.dh.table()))
    assert (again.motors, again.dh) == (robot.motors, robot.dh)


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
ROD = trimesh.creation.box((0.5, 0.02, 0.02))


def test_a_description_comes_with_its_meshes(client: Client, tmp_path: Path) -> None:
    package = tmp_path / "pendulum"
    for folder in ("urdf", "meshes"):
        (package / folder).mkdir(parents=True)
    (package / "urdf" / "arm.urdf").write_text(URDF.format("../meshes/rod.stl"))
    (package / "meshes" / "rod.stl").write_bytes(ROD.export(file_type="stl"))
    limits = {"pivot": ours.JointLimits(acceleration=3.0)}
    upload = ours.RobotUpload.from_urdf(package / "urdf" / "arm.urdf", joint_limits=limits)
    robot = client.robots.create(upload)
    assert (robot.name, robot.joint_names) == ("pendulum", ["pivot"])
    assert robot.limits.acceleration == [3.0]
    # The rod reaches from 0 to 0.5 along x and is 0.02 wide: a wall at 0.6 is 0.1 away.
    wall = ours.Scene(obstacles=[box("wall", (0.2, 1, 1), (0.7, 0, 0))])
    check = client.check("pendulum", [0.0], scene=wall)
    assert check.clearance == pytest.approx(0.1, abs=1e-6)
    client.robots.delete("pendulum")
    with pytest.raises(ours.InvalidRobotDescription):
        client.robots.create(ours.RobotUpload(name="none", urdf="<robot name='x'/>"))


def test_an_archive_becomes_a_robot(client: Client, tmp_path: Path) -> None:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        archive.writestr("pendulum/urdf/arm.urdf", URDF.format("package://pendulum/meshes/rod.stl"))
        archive.writestr("pendulum/meshes/rod.stl", ROD.export(file_type="stl"))
    path = tmp_path / "zipped.zip"
    path.write_bytes(content.getvalue())
    limits = {"pivot": ours.JointLimits(jerk=9.0)}
    robot = client.robots.create(ours.RobotArchive.from_file(path, joint_limits=limits))
    assert (robot.name, robot.limits.jerk) == ("zipped", [9.0])
    client.robots.delete("zipped")


# ---------------------------------------------------------------------- kinematics and dynamics


def test_kinematics_are_those_of_the_domain(client: Client) -> None:
    chain, rows = builtin_chain("panda"), [READY, AWAY]
    batch = client.robots.fk_batch("panda", rows)
    for row, pose in zip(rows, batch.pose, strict=True):
        np.testing.assert_allclose(pose.position, forward(chain, row)[:3, 3], atol=1e-12)
        one = client.robots.fk("panda", row)
        assert one.pose == pose
        assert set(one.links) == set(batch.links)
    answer = client.robots.jacobian("panda", READY)
    np.testing.assert_allclose(answer.jacobian, geometric(chain, READY), atol=1e-12)
    many = client.robots.jacobian_batch("panda", rows, point=(0, 0, 0.1))
    assert (np.shape(many.jacobian), many.rank) == ((2, 6, 7), [6, 6])
    there = client.robots.velocity("panda", READY, joint_velocities=[0.1] * 7)
    back = client.robots.velocity("panda", READY, twist=there.twist, nullspace=[0.1] * 7)
    assert back.joint_velocities == pytest.approx([0.1] * 7, abs=1e-9)
    assert back.damped == []
    with pytest.raises(ours.InvalidLinkName):
        client.robots.fk("panda", READY, link="tail")
    with pytest.raises(ours.InvalidRobotState):
        client.robots.fk("panda", [0.0])


def test_every_kind_of_inverse_kinematics(client: Client) -> None:
    pose = client.robots.fk("panda", READY).pose  # what was answered can be asked
    near = client.robots.ik("panda", pose, seed_joints=READY, method="analytic")
    assert near.solutions[0].joints == pytest.approx(READY, abs=1e-6)
    assert "q7=" in (near.solutions[0].branch or "")
    seed = [x + 0.1 for x in READY]
    way = ours.Gradient(rule="transpose", trace=True)
    traced = client.robots.ik("panda", pose, seed_joints=seed, method="gradient", gradient=way)
    assert traced.trace is not None
    assert traced.trace.joints[0] == pytest.approx(seed)
    free = client.robots.ik("panda", pose, axes=["x", "y", "z"], choice="manipulability")
    error = free.solutions[0].position_error
    assert error is not None
    assert error <= 1e-6
    with pytest.raises(ours.NoIkSolution):
        client.robots.ik("panda", Pose.at(5, 0, 0), timeout=30)


def test_the_potential_at_one_configuration_and_at_many(client: Client) -> None:
    scene = ours.Scene(obstacles=[TABLE])
    options = ours.PotentialOptions(influence_distance=0.5)
    one = client.robots.potential("panda", READY, AWAY, scene, options=options)
    many = client.robots.potential_batch("panda", [READY, AWAY], AWAY, scene, options=options)
    assert many.potential[0] == one.potential > many.potential[1]
    assert many.control_points[0] == one.control_points
    assert one.control_points[-1].obstacle == TABLE.id


def test_dynamics_are_those_of_the_domain(client: Client) -> None:
    chain = builtin_chain("panda")
    found = client.robots.dynamics(
        "panda", READY, velocities=RATES, accelerations=RATES, wrench=PULL
    )
    np.testing.assert_allclose(found.mass_matrix, mass_matrix(chain, READY), rtol=1e-12)
    expected = coriolis_matrix(chain, READY, RATES)
    np.testing.assert_allclose(found.coriolis_matrix, expected, rtol=0, atol=1e-12)
    expected = inverse_dynamics(chain, READY, RATES, RATES, np.array(PULL))
    np.testing.assert_allclose(found.torques, expected, rtol=1e-11)
    load = ours.Payload(mass=2.0, center_of_mass=(0.0, 0.0, 0.1))
    heavy = client.robots.dynamics("panda", READY, payload=load, gravity=(0.0, 0.0, -1.62))
    loaded = with_payload(chain, 2.0, (0.0, 0.0, 0.1))
    expected = inverse_dynamics(loaded, READY, [0.0] * 7, [0.0] * 7, None, [0, 0, -1.62])
    np.testing.assert_allclose(heavy.torques, expected, rtol=1e-11, atol=1e-12)
    rows = [READY, AWAY]
    many = client.robots.dynamics_batch("panda", rows, velocities=[RATES] * 2)
    np.testing.assert_allclose(many.mass_matrix, mass_matrix(chain, rows), rtol=1e-12)
    held = client.robots.wrench_batch("panda", rows, PULL)
    np.testing.assert_allclose(held.torques, holding_torques(chain, rows, PULL), atol=1e-12)


def test_regressors_and_formulas(client: Client) -> None:
    found = client.robots.regressor("puma560", [0.3] * 6, [0.5] * 6, [-0.2] * 6)
    assert len(found.base_parameters) == 36
    expected = inverse_dynamics(builtin_chain("puma560"), [0.3] * 6, [0.5] * 6, [-0.2] * 6)
    beta = [parameter.value for parameter in found.base_parameters]
    np.testing.assert_allclose(np.array(found.base_regressor) @ beta, expected, atol=1e-10)
    formulas = client.robots.equations("planar_rr", "text")
    assert formulas.dynamics is not None
    assert formulas.dynamics.mass_matrix[1][1] == "m_2 * l_c2**2 + I_2"
    assert formulas.pose.position[0] == "l_1 * c_1 + l_2 * c_12"


def test_a_closed_loop_is_read_with_its_tube(client: Client) -> None:
    scene = ours.Scene(obstacles=[TABLE])
    motion = client.plan("panda", READY, AWAY, scene=scene).trajectory
    adaptive = {"type": "adaptive", "natural_frequency": 15.0}
    found = client.simulate("panda", motion, adaptive, scene=scene, sample_period=0.05, seed=3)
    assert (found.outcome, found.controller.type) == ("completed", "adaptive")
    assert len(found.time) == len(found.lyapunov) == len(found.torque)
    assert found.estimate is not None
    assert found.tube is not None
    with pytest.raises(ours.ApiError, match="natural_frequency"):
        client.simulate("panda", motion, {"type": "passivity"})


# ---------------------------------------------------------------------------- checks and scenes


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
    beyond = client.check("panda", (9.0, *READY[1:]))
    assert beyond.limit_violations[0].value == 9.0


def test_a_part_in_the_hand_is_checked_too(client: Client) -> None:
    robot = client.robots.get("panda")
    rod = ours.Attached(
        id="rod", shape=ours.Capsule(radius=0.01, height=0.6), pose=Pose.at(0, 0, 0.4),
        link=robot.tip_link, touch_links=robot.links,
    )  # fmt: skip
    floor = ours.Scene(obstacles=[box("floor", (3, 3, 0.02), (0, 0, -0.2))], allowed_collisions=[])
    answer = client.check("panda", READY, scene=floor, attached=[rod])
    assert [set(collision.pair) for collision in answer.collisions] == [{"rod", "floor"}]


def test_scenes_are_stored_listed_replaced_and_forgotten(client: Client) -> None:
    cube = trimesh.creation.box((0.1, 0.1, 0.1))
    shapes: list[ours.Shape] = [
        ours.Convex.of(vertices=cube.vertices),
        ours.Mesh.of(vertices=cube.vertices, faces=cube.faces),
        ours.PointCloud.of(points=cube.vertices, radius=0.01),
    ]
    made = [
        ours.Obstacle(id=f"{i}", shape=shape, pose=Pose.at(i, 0, 0))
        for i, shape in enumerate(shapes)
    ]
    scene = ours.Scene(name="life", obstacles=[TABLE, *made], allowed_collisions=[("0", "x")])
    created = client.scenes.create(scene)
    assert (created.name, created.version) == ("life", 1)
    assert client.scenes.get("life") == scene
    with pytest.raises(ours.Conflict):
        client.scenes.create(scene)
    replaced = client.scenes.replace("life", ours.Scene(name="other", obstacles=[POST]))
    assert (replaced.name, replaced.version) == ("life", 2)
    assert "life" in {summary.name for summary in client.scenes.iterate()}
    assert client.scenes.list(after="life~").scenes == []
    (found,) = client.scenes.project("life", [[0.42, 0.32, 0.5]]).projections
    assert found[0].obstacle == "post"
    assert found[0].distance == pytest.approx(0.08, abs=1e-6)
    client.scenes.delete("life")
    with pytest.raises(ours.NotFound):
        client.scenes.get("life")


def test_what_the_service_refuses_names_the_field(client: Client) -> None:
    with pytest.raises(ValidationError, match=r"obstacle 'table_top' is given twice"):
        ours.Scene(name="twins", obstacles=[TABLE, TABLE])
    unchecked = ours.Scene(name="twins", obstacles=[]).model_copy(
        update={"obstacles": [TABLE, TABLE]}
    )
    with pytest.raises(ours.ValidationFailed, match=r"'table_top' is given twice") as caught:
        client.scenes.create(unchecked)
    assert caught.value.details["errors"][0]["path"] == "obstacles"


def test_paths_are_timed_and_told_in_other_shapes(client: Client, url: str) -> None:
    timing = ours.RetimeTiming(method="jerk_limited", tool_speed=0.5, payload=ours.Payload(mass=1))
    found = client.retime([READY, AWAY], robot="panda", timing=timing)
    assert found.certificate.verified
    assert found.certificate.limits is not None
    assert found.certificate.limits.tool_speed is not None
    body = {"trajectory": json.loads(found.trajectory.model_dump_json()), "sample_period": 0.05}
    body["trajectory"].pop("interpolation", None)
    with httpx.Client(base_url=url) as plain:
        message = plain.post("/v1/convert", json=body).json()
        table = plain.post("/v1/convert", json=body | {"format": "csv"}).text
    assert found.trajectory.joint_trajectory(0.05) == message
    assert found.trajectory.csv(0.05) == table
