"""MJCF as robots: what MuJoCo compiles is what is sent, and checked alike."""

import base64
import io
import sys
import zipfile
from pathlib import Path

import mujoco
import numpy as np
import pytest

import armwright as aw
from armwright_client import InvalidArgument, RobotUpload, scene_from_mjcf
from benchmarks.judges.mujoco_models import differences, placed
from command_line.parameters import RobotSource
from command_line.robot_files import robot_document
from kinematics.errors import InvalidRobotDescription
from kinematics.tree.srdf import parse_srdf
from kinematics.urdf.urdf import parse_urdf
from studio.requests import robot_upload
from tests.command_line.commands import Run, runner

#: An arm with all that MJCF can say of one: degrees, anchors, `ref`, two joints on a body, sites,
#: masks, an excluded pair, welded bodies, a led joint, meshes, and a table and a ball beside it.
ARM = """<mujoco model="bent arm"><compiler angle="degree"/>
<asset><mesh name="wedge" vertex="0 0 0 .1 0 0 0 .1 0 0 0 .2 .02 .02 .02" scale="1 2 1"/></asset>
<default><joint damping="0.3" frictionloss="0.1"/><geom mass="0.2"/></default>
<worldbody><geom type="plane" size="1 1 .1"/>
<body name="table" pos="1 0 .2"><geom type="box" size=".2 .2 .2"/></body>
<body name="ball" pos="1 0 .5"><freejoint/><geom size=".05"/></body>
<body name="base" pos=".1 0 .05" euler="0 0 30"><geom type="cylinder" size=".08 .05"/>
 <body name="upper" pos="0 0 .2" quat=".9 .1 .3 .2">
  <joint name="pan" axis="0 0 1" range="-170 170" pos=".02 0 0"/>
  <joint name="tilt" axis="1 1 0" range="-90 90" pos="0 .01 .03" ref="20"/>
  <geom type="capsule" size=".04 .1" pos="0 0 .1" euler="10 0 0"/>
  <geom type="box" size=".03 .02 .01" pos=".2 0 0"/>
  <geom type="sphere" size=".2" contype="0" conaffinity="0" rgba="1 0 0 1"/>
  <body name="cover" pos="0 .1 0"><geom type="sphere" size=".03"/>
   <body name="fore" pos=".3 0 0">
    <joint name="slide" type="slide" axis="0 .6 .8" range="-.1 .2" ref=".05"/>
    <geom type="mesh" mesh="wedge" pos=".05 0 0" euler="0 45 0"/>
    <body name="hand" pos=".2 0 0"><joint name="roll" axis="1 0 0"/>
     <geom type="sphere" size=".05"/><site name="tool" pos=".1 0 0" euler="0 90 0"/>
     <body name="left" pos=".05 .03 0"><joint name="l" type="slide" axis="0 1 0" range="0 .04"/>
      <geom type="box" size=".02 .005 .01"/></body>
     <body name="right" pos=".05 -.03 0"><joint name="r" type="slide" axis="0 -1 0" range="0 .04"/>
      <geom type="box" size=".02 .005 .01" contype="2" conaffinity="4"/></body>
    </body></body></body></body></body></worldbody>
<contact><exclude body1="base" body2="fore"/></contact>
<equality><joint joint1="r" joint2="l" polycoef="0.001 0.5 0 0 0"/></equality>
<actuator><position joint="pan" kp="10" forcerange="-30 20" gear="2"/></actuator>
<keyframe><key name="home" qpos="1 0 .5 1 0 0 0 0.1 0.2 0.03 0.4 0.01 0.006"/></keyframe>
</mujoco>"""


def chain(body: str, joints: str = "", geoms: str = '<geom size=".1"/>') -> str:
    """A model of one moving body, whose parts are given."""
    return (
        f"<mujoco><worldbody><body name='base'><geom size='.1'/><body name='link' pos='0 0 .5'>"
        f"<joint name='j'/>{joints}{geoms}{body}</body></body></worldbody></mujoco>"
    )


def drawn(seed: int) -> str:
    """A random tree of bodies with joints and solids of all kinds."""
    random = np.random.default_rng(seed)

    def row(count: int, scale: float = 1.0) -> str:
        return " ".join(map(str, scale * random.normal(size=count)))

    def body(level: int) -> str:
        joints = "".join(
            f'<joint type="{random.choice(["hinge", "slide"])}" axis="{row(3)}" '
            f'pos="{row(3, 0.1)}" ref="{row(1, 0.3)}"/>'
            for _ in range(random.integers(0, 3))
        )
        kind = random.choice(["sphere", "capsule", "cylinder", "box", "mesh"])
        size = " ".join(map(str, random.uniform(0.02, 0.1, 3)))
        shape = 'mesh="m"' if kind == "mesh" else f'size="{size}"'
        masks = f'contype="{random.integers(4)}" conaffinity="{random.integers(4)}"'
        geom = f'<geom type="{kind}" {shape} pos="{row(3, 0.1)}" quat="{row(4)}" {masks}/>'
        children = "".join(
            body(level + 1) for _ in range(random.integers(0, 3) if level < 4 else 0)
        )
        mass = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
        return f'<body pos="{row(3, 0.3)}" quat="{row(4)}">{mass}{joints}{geom}{children}</body>'

    vertices = row(36, 0.1)
    moved = f'<body><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/><joint/>{body(0)}</body>'
    return (
        f'<mujoco><asset><mesh name="m" vertex="{vertices}"/></asset><worldbody>{moved}{body(2)}'
        "</worldbody></mujoco>"
    )


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    return write(tmp_path, ARM)


def write(folder: Path, text: str) -> Path:
    path = folder / "model.xml"
    path.write_text(text)
    return path


def test_joints_frames_solids_and_pairs_are_those_of_mujoco(arm: Path) -> None:
    found = differences(arm)
    assert found.joints == 6
    assert found.order
    assert found.pose < 1e-13
    assert found.support < 1e-7
    assert (found.pairs, found.solid) == (0, 21)


@pytest.mark.parametrize("seed", range(20))
def test_random_models_are_read_as_mujoco_reads_them(tmp_path: Path, seed: int) -> None:
    found = differences(write(tmp_path, drawn(seed)), seed)
    assert found.order
    assert found.pose < 1e-12
    assert found.support < 1e-7
    assert found.pairs == 0


def test_what_is_sent_says_all_of_the_arm(arm: Path) -> None:
    upload = RobotUpload.from_urdf(arm, name="arm")
    tree = parse_urdf(str(upload.urdf))
    assert tree.name == "bent arm"
    assert {"table", "ball"}.isdisjoint(tree.links), "they belong to the scene"
    pan, right = tree.joints["pan"], tree.joints["r"]
    assert (pan.effort, pan.damping, pan.friction) == (60.0, 0.3, 0.1)
    assert right.mimic is not None
    assert (right.mimic.joint, right.mimic.multiplier, right.mimic.offset) == ("l", 0.5, 0.001)
    inertia = tree.links["upper"].inertia
    assert inertia is not None
    assert inertia.mass == pytest.approx(0.6)
    semantics = parse_srdf(str(upload.srdf))
    pairs = semantics.disabled_collisions
    assert {("base", "fore"), ("fore", "hand"), ("cover", "fore"), ("cover", "upper")} <= pairs
    assert ("left", "right") in pairs, "their masks never meet"
    assert ("base", "upper") not in pairs, "what stands still is nobody's parent, as in MuJoCo"
    home = {"pan": 0.1, "tilt": 0.2, "slide": 0.03, "roll": 0.4, "l": 0.01, "r": 0.006}
    assert dict(semantics.states[""]["home"]) == home
    assert set(upload.meshes or {}) == {"hull0.stl"}
    assert len(base64.b64decode(next(iter((upload.meshes or {}).values())))) == 84 + 4 * 50
    assert str(upload.urdf).count("<visual>") == 1


def test_clearances_are_those_of_mujoco(arm: Path) -> None:
    robot = aw.load_robot(arm, tip_link="tool")
    assert robot.chain.joint_names == ("pan", "tilt", "slide", "roll")
    model = mujoco.MjModel.from_xml_path(str(arm))
    data, random = mujoco.MjData(model), np.random.default_rng(0)
    tree = parse_urdf(str(RobotUpload.from_urdf(arm, name="arm").urdf))
    semantics = parse_srdf(str(RobotUpload.from_urdf(arm, name="arm").srdf))
    assert {*robot.allowed} == semantics.disabled_collisions
    allowed = {frozenset(pair) for pair in robot.allowed}
    free = 0
    for _ in range(200):
        joints = random.uniform(
            robot.chain.limits.lower.clip(-3), robot.chain.limits.upper.clip(max=3)
        )
        held = {"l": 0.0, "r": 0.001}
        frames = placed(tree, dict(zip(robot.chain.joint_names, joints, strict=True)) | held)
        for name, value in (dict(zip(robot.chain.joint_names, joints, strict=True)) | held).items():
            data.qpos[model.jnt_qposadr[model.joint(name).id]] = value
        mujoco.mj_kinematics(model, data)
        np.testing.assert_allclose(aw.fk(robot, joints), frames["tool"], atol=1e-12)
        nearest = np.inf
        for a in range(model.ngeom):
            for b in range(a):
                names = [model.body(model.geom_bodyid[geom]).name for geom in (a, b)]
                solid = all(model.geom_contype[g] or model.geom_conaffinity[g] for g in (a, b))
                if not {*names} <= {*tree.links} - {"world"} or not solid or names[0] == names[1]:
                    continue
                if frozenset(names) not in allowed:
                    distance = mujoco.mj_geomDistance(model, data, a, b, 10.0, None)
                    nearest = min(nearest, distance)
        told = aw.check(robot, aw.Scene(), joints)
        if nearest > 1e-3:
            free += 1
            assert told.clearance == pytest.approx(nearest, abs=2e-5)
        elif nearest < -1e-3:
            assert told.clearance < 0.0
    assert free > 50


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (chain("", "<joint name='k' type='ball'/>"), "'k' is a ball joint"),
        (chain("", geoms="<geom name='g' type='ellipsoid' size='.1 .2 .3'/>"), "g .* ellipsoid"),
        (chain("<body><joint range='1 0' limited='true'/></body>"), "can't compile"),
        ("<mujoco><worldbody><geom size='.1'/></worldbody></mujoco>", "no robot"),
        (chain("", geoms="<geom type='mesh' mesh='gone'/>"), "can't compile .*gone"),
        ("<mujoco><worldbody>", "can't compile"),
    ],
)
def test_what_is_no_robot_of_ours_is_refused_by_name(
    tmp_path: Path, text: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = write(tmp_path, text)
    with pytest.raises(InvalidArgument, match=f"(?s){words}"):
        RobotUpload.from_urdf(path)
    with pytest.raises(InvalidRobotDescription, match=f"(?s){words}"):
        aw.load_robot(path)
    assert [file.name for file in tmp_path.iterdir()] == [path.name], "no file of MuJoCo's warnings"


def test_the_rest_of_a_model_is_a_scene(arm: Path) -> None:
    scene = scene_from_mjcf(arm)
    found = {item.id: item for item in scene.obstacles or ()}
    assert {name: item.shape.type for name, item in found.items()} == {
        "geom0": "halfspace",
        "table": "box",
        "ball": "sphere",
    }
    assert found["ball"].pose.position == [1.0, 0.0, 0.5]
    assert {tuple(pair) for pair in scene.allowed_collisions or ()} == {
        ("geom0", "base"),
        ("table", "base"),
        ("geom0", "right"),
        ("table", "right"),
        ("ball", "right"),
    }, "what stands still never meets, and the right finger's mask meets nothing"


def test_shapes_that_scenes_have_no_word_for_are_refused(tmp_path: Path) -> None:
    text = "<mujoco><worldbody><geom type='ellipsoid' size='.1 .2 .3'/></worldbody></mujoco>"
    with pytest.raises(InvalidArgument, match="ellipsoid"):
        scene_from_mjcf(write(tmp_path, text))


def test_a_base_on_a_free_joint_stands_where_the_model_puts_it(tmp_path: Path) -> None:
    text = """<mujoco><worldbody><body name="base" pos="1 2 3"><freejoint/><geom size=".1"/>
    <body name="link" pos="0 0 1"><joint axis="0 1 0"/><geom size=".1"/></body></body></worldbody>
    </mujoco>"""
    robot = aw.load_robot(write(tmp_path, text))
    assert robot.chain.joint_names == ("joint1",)
    np.testing.assert_allclose(aw.fk(robot, [0.3])[:3, 3], [1.0, 2.0, 4.0])


def test_the_shell_reads_files_and_folders(
    arm: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (arm.parent / "scene.xml").write_text('<mujoco><include file="model.xml"/></mujoco>')
    run: Run = runner(capsys)
    document = robot_document(RobotSource(str(arm.parent)))
    assert document["name"] == "bent_arm"
    shown = run("robots", str(arm), "--json")
    assert shown.code in (0, 3), shown.err
    monkeypatch.setitem(sys.modules, "mujoco", None)
    refused = run("robots", str(arm))
    assert refused.code == 3
    assert "[mujoco]" in refused.err


def test_the_studio_reads_a_model_alone_and_with_its_files(arm: Path) -> None:
    upload = robot_upload("my_arm.xml", arm.read_bytes(), "tool")
    assert isinstance(upload, RobotUpload)
    assert (upload.name, upload.tip_link) == ("my_arm", "tool")
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w") as archive:
        archive.write(arm, "arm/model.xml")
        archive.writestr("arm/scene.xml", '<mujoco><include file="model.xml"/></mujoco>')
    packed = robot_upload("packed.zip", held.getvalue(), None)
    assert isinstance(packed, RobotUpload)
    assert (packed.urdf, packed.srdf) == (upload.urdf, upload.srdf)
    plain = robot_upload("plain.xml", b"<robot/>", None)
    assert isinstance(plain, RobotUpload)
    assert plain.urdf == "<robot/>"
