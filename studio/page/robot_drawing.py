"""Drawings of the robot at configurations: its geometry, and ghosts of it."""

import base64
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import viser
from numpy.typing import NDArray

from armwright_client import Pose
from armwright_wire.robot import GeometryAnswer
from studio.branch import Branch, Verdict
from studio.motion_frames import LinkPoses, link_poses
from studio.page.colors import HIT_COLOR
from studio.pose import wxyz

#: Colours of ghosts by verdict: blue and orange are told apart without red and green.
COLORS = {
    Verdict.VALID: (0, 114, 178),
    Verdict.COLLISION: HIT_COLOR,
    Verdict.LIMITS: (230, 159, 0),
    Verdict.OTHER: (120, 120, 120),
}
#: Opacity of ghosts: what is behind them stays visible.
_GHOST_OPACITY = 0.2


class Surface(NamedTuple):
    """The surface of one body in the frame of a link.

    Args:
        link: Link that it belongs to.
        frame: The link in whose frame it is.
        vertices: Shape (k, 3) [m].
        faces: Shape (f, 3).
        color: Red, green, blue, 0 to 255; None where it has none of its own.
    """

    link: str
    frame: str
    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]
    color: tuple[int, int, int] | None = None


def surfaces(geometry: GeometryAnswer) -> list[Surface]:
    """The surfaces of a robot as arrays.

    Args:
        geometry: Geometry as the service answers it.
    """
    return [
        Surface(
            body.link,
            body.frame,
            np.frombuffer(base64.b64decode(body.vertices), "<f4").reshape(-1, 3),
            np.frombuffer(base64.b64decode(body.faces), "<u4").reshape(-1, 3),
            None if body.color is None else _bytes(body.color),
        )
        for body in geometry.bodies
    ]


def _bytes(color: Sequence[float]) -> tuple[int, int, int]:
    red, green, blue = (round(255 * value) for value in color[:3])
    return red, green, blue


class RobotDrawing:
    """The robot at one configuration, by its collision geometry or by what it looks like.

    Args:
        scene: Scene of viser to draw in.
        name: Name of the node that holds it.
        bodies: Surfaces of the links.
        color: Colour of surfaces that have none of their own: red, green, blue, 0 to 255.
        opacity: 1 for an opaque robot.
        looks: Surfaces of what the links look like; none where that is not known.
    """

    def __init__(
        self,
        scene: viser.SceneApi,
        name: str,
        bodies: Sequence[Surface],
        color: tuple[int, int, int],
        opacity: float = 1.0,
        looks: Sequence[Surface] = (),
    ) -> None:
        self._root = scene.add_frame(name, show_axes=False)
        self._frames = {
            frame: scene.add_frame(f"{name}/{frame}", show_axes=False)
            for frame in {body.frame for body in (*bodies, *looks)}
        }
        self._meshes = []
        for kind, surfaces_ in (("solid", bodies), ("look", looks)):
            for number, body in enumerate(surfaces_):
                mesh = scene.add_mesh_simple(
                    f"{name}/{body.frame}/{kind}_{number}",
                    body.vertices,
                    body.faces,
                    color=body.color or color,
                    opacity=None if opacity == 1.0 else opacity,
                    flat_shading=True,
                    side="double",
                    visible=kind == "solid",
                )
                self._meshes.append((body.link, body.color or color, mesh))
        self._solid = len(bodies)

    def show_looks(self, looks: bool) -> None:
        """Draw what the links look like, or their collision geometry where that is not known.

        Args:
            looks: False for the collision geometry.
        """
        looks = looks and len(self._meshes) > self._solid
        for number, (_, _, mesh) in enumerate(self._meshes):
            mesh.visible = (number >= self._solid) == looks

    def show(self, poses: Mapping[str, Pose]) -> None:
        """Move the links.

        Args:
            poses: Poses of each link in the root frame.
        """
        for name, frame in self._frames.items():
            frame.position = np.array(poses[name].position)
            frame.wxyz = wxyz(poses[name])

    def show_frame(self, poses: Mapping[str, LinkPoses], number: int) -> None:
        """Move the links to a frame of a motion.

        Args:
            poses: Poses of each link over the frames.
            number: Number of the frame.
        """
        for name, frame in self._frames.items():
            frame.position = poses[name].positions[number]
            frame.wxyz = poses[name].wxyz[number]

    def mark(self, links: Collection[str]) -> None:
        """Draw some links in the colour of collisions, the others in their own.

        Args:
            links: Names of those to be marked.
        """
        for link, color, mesh in self._meshes:
            mesh.color = HIT_COLOR if link in links else color

    def set_visible(self, visible: bool) -> None:
        """Show or hide it."""
        self._root.visible = visible

    def remove(self) -> None:
        """Take it out of the scene."""
        self._root.remove()


class GhostDrawing:
    """Configurations that reach a goal as ghosts, coloured and labelled by their verdict.

    Args:
        scene: Scene of viser to draw in.
        bodies: Surfaces of the links.
        tip: Link that carries the labels.
    """

    def __init__(self, scene: viser.SceneApi, bodies: Sequence[Surface], tip: str) -> None:
        self._scene = scene
        self._bodies = bodies
        self._tip = tip
        self._nodes: list[viser.SceneNodeHandle] = []

    def show(self, branches: Sequence[Branch], poses: Mapping[str, Sequence[Pose]]) -> None:
        """Draw the branches in place of those before.

        Args:
            branches: The configurations.
            poses: Poses of each link at each of them, in the root frame.
        """
        self.clear()
        if not branches:
            return
        colors = np.array([COLORS[branch.verdict] for branch in branches], dtype=np.uint8)
        arrays = {name: link_poses(rows) for name, rows in poses.items()}
        for number, body in enumerate(self._bodies):
            self._nodes.append(
                self._scene.add_batched_meshes_simple(
                    f"/ghosts/{number}",
                    body.vertices,
                    body.faces,
                    batched_wxyzs=arrays[body.frame].wxyz,
                    batched_positions=arrays[body.frame].positions,
                    batched_colors=colors,
                    opacity=_GHOST_OPACITY,
                    cast_shadow=False,
                    side="double",
                )
            )
        elbows = arrays[self._label_link(arrays)].positions
        for branch, position in zip(branches, elbows, strict=True):
            self._nodes.append(
                self._scene.add_label(
                    f"/ghosts/label_{branch.number}", branch.label, position=position
                )
            )

    def clear(self) -> None:
        """Remove all ghosts."""
        for node in self._nodes:
            node.remove()
        self._nodes = []

    def _label_link(self, arrays: Mapping[str, LinkPoses]) -> str:
        """The link whose places differ most between branches: labels do not hide each other."""
        return max(
            (body.frame for body in self._bodies),
            key=lambda name: float(np.ptp(arrays[name].positions, axis=0).sum()),
            default=self._tip,
        )
