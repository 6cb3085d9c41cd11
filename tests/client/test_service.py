"""The client against a real service: answers are read as what the domain computes."""

import asyncio
import io
import zipfile
from pathlib import Path

import httpx
import numpy as np
import pytest
import trimesh
from pydantic import ValidationError

import armwright_client as ours
from armwright_client import AsyncClient, Client, Pose
from service.app import create_app
from service.settings import Settings
from tests.client.world import POST, TABLE, box, planar

pytestmark = pytest.mark.timeout(300)


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


# ---------------------------------------------------------------------------- checks and scenes


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
