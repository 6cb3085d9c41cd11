"""Arms of the package example-robot-data, with the meshes that come with them."""

import io
import sysconfig
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from kinematics.tree.description import MeshGeometry
from kinematics.tree.fingers import fingers
from kinematics.tree.serial_chain import select, serial_chain
from kinematics.tree.srdf import Semantics, parse_srdf
from kinematics.urdf.urdf import parse_urdf
from kinematics.urdf.visuals import read_visuals
from obstacles.robots.robot_geometry import RobotGeometry, robot_geometry

_SCHEME = "package://example-robot-data/robots/"


@dataclass(frozen=True)
class ExampleArm:
    """Where an arm lies in the package.

    Args:
        urdf: Its URDF.
        tip: The link its chain ends at.
        base: The link its chain starts at; None for the root.
        srdf: Its SRDF; None where there is none.
    """

    urdf: str
    tip: str
    base: str | None = None
    srdf: str | None = None

    @property
    def text(self) -> str:
        """The URDF."""
        return (package() / self.urdf).read_text()

    def geometry(self, limits: Mapping[str, float] | None = None) -> RobotGeometry:
        """The arm as Armwright has it, with ``limits`` for every joint in place of the URDF's."""
        description = parse_urdf(self.text)
        semantics = self.semantics()
        chain = serial_chain(description, self.base, self.tip, semantics=semantics)
        if limits:
            every = dict.fromkeys(chain.joint_names, limits)
            chain = serial_chain(
                description, self.base, self.tip, joint_limits=every, semantics=semantics
            )
        robot = robot_geometry(chain, description, mesh_bytes, semantics)
        chosen = select(description, self.base, self.tip, semantics=semantics)
        return replace(robot, fingers=fingers(description, chosen, semantics))

    def semantics(self) -> Semantics | None:
        """What the SRDF says."""
        return parse_srdf((package() / self.srdf).read_text()) if self.srdf is not None else None


#: By name.
ARMS = {
    "ur3": ExampleArm("ur_description/urdf/ur3_robot.urdf", "tool0"),
    "ur5": ExampleArm(
        "ur_description/urdf/ur5_robot.urdf", "tool0", srdf="ur_description/srdf/ur5.srdf"
    ),
    "ur10": ExampleArm("ur_description/urdf/ur10_robot.urdf", "tool0"),
    "panda": ExampleArm(
        "panda_description/urdf/panda.urdf",
        "panda_hand_tcp",
        srdf="panda_description/srdf/panda.srdf",
    ),
    "kinova": ExampleArm("kinova_description/robots/kinova.urdf", "j2s6s200_end_effector"),
    "xarm7": ExampleArm("xarm_description/urdf/xarm7.urdf", "link_eef"),
    "z1": ExampleArm("z1_description/urdf/z1.urdf", "gripperMover"),
    "so100": ExampleArm("so_arm_description/urdf/so100.urdf", "jaw"),
    "so101": ExampleArm("so_arm_description/urdf/so101.urdf", "gripper_frame_link"),
    "tiago": ExampleArm("tiago_description/robots/tiago_no_hand.urdf", "arm_tool_link"),
    "pr2": ExampleArm("pr2_description/urdf/pr2.urdf", "r_gripper_tool_frame"),
}


def package() -> Path:
    """Folder of the package's robots.

    Raises:
        SystemExit: It is not installed.
    """
    folder = Path(sysconfig.get_paths()["purelib"]) / "cmeel.prefix/share/example-robot-data/robots"
    if not folder.is_dir():
        raise SystemExit("example-robot-data is not installed: pip install example-robot-data")
    return folder


def mesh_bytes(uri: str) -> bytes:
    """The bytes of a mesh that a URDF of the package names."""
    return (package() / uri.removeprefix(_SCHEME)).read_bytes()


def archive(urdf: str) -> bytes:
    """A URDF of the package with the meshes that it names, as a .zip of the package's folders.

    Args:
        urdf: Its path below the folder of robots.
    """
    text = (package() / urdf).read_bytes()
    links = parse_urdf(text.decode()).links.values()
    solids = [element.geometry for link in links for element in link.collisions]
    looks = read_visuals(text).links.values()
    solids += [element.geometry for elements in looks for element in elements]
    uris = sorted({solid.uri for solid in solids if isinstance(solid, MeshGeometry)})
    # Some descriptions name pictures of links that the package lacks.
    files = {uri: package() / uri.removeprefix(_SCHEME) for uri in uris}
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as packed:
        packed.writestr(f"example-robot-data/robots/{urdf}", text)
        for uri, path in files.items():
            if path.is_file():
                packed.write(path, uri.removeprefix("package://"))
    return content.getvalue()
