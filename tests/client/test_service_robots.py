"""Robots by the client: upload, kinematics and checks, on a real service."""

import io
import zipfile
from pathlib import Path

import numpy as np
import pinocchio
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import armwright_client as ours
from armwright_client import Client, Pose
from tests.client.world import AWAY, READY, box, planar

pytestmark = pytest.mark.timeout(300)


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
