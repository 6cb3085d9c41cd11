"""Drawings of the robot, its ghosts, obstacles with handles, and the bodies that collide."""

import base64
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import trimesh
import viser
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from armwright_client import (
    Box,
    Convex,
    Cylinder,
    Halfspace,
    Mesh,
    Obstacle,
    PointCloud,
    Pose,
    Sphere,
)
from armwright_wire.robots.robot import GeometryAnswer
from armwright_wire.scenes.scene import Capsule, Cone
from studio.motion_frames import LinkPoses, link_poses
from studio.pose import pose_of, wxyz
from studio.requests import corner, with_corner
from studio.state import Branch, Verdict, labels

#: Of bodies that collide: dark orange, told apart from blue and grey by everybody.
HIT_COLOR = (213, 94, 0)
#: Colours of ghosts by verdict: blue and orange are told apart without red and green.
COLORS = {
    Verdict.VALID: (0, 114, 178),
    Verdict.COLLISION: HIT_COLOR,
    Verdict.LIMITS: (230, 159, 0),
    Verdict.OTHER: (120, 120, 120),
}
#: Opacity of ghosts: what is behind them stays visible.
_GHOST_OPACITY = 0.2
#: Obstacles are grey, those that are held orange.
_COLOR = (140, 150, 160)
_HELD_COLOR = (230, 159, 0)
#: A half-space is drawn as a plate of this size and thickness [m].
_GROUND, _PLATE = 3.0, 0.002
#: Labels nearer than this are one; others side by side are set above each other by a line [m].
_NEAR, WIDE, LINE = 0.12, 0.3, 0.07
#: Length of the handles [m].
_HANDLE = 0.18
_CORNER = 0.1
#: Least size that handles and numbers give [m].
MIN_SIZE = 0.005
#: Corners of a drawn circle.
_CIRCLE = 24


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
        # By numbers: a name with a slash, as of a tool's jaw, would be the child of another frame.
        frames = {body.frame: None for body in (*bodies, *looks)}
        self._frames = {
            frame: scene.add_frame(f"{name}/{number}", show_axes=False)
            for number, frame in enumerate(frames)
        }
        self._meshes = []
        for kind, surfaces_ in (("solid", bodies), ("look", looks)):
            for number, body in enumerate(surfaces_):
                mesh = scene.add_mesh_simple(
                    f"{self._frames[body.frame].name}/{kind}_{number}",
                    body.vertices,
                    body.faces,
                    color=body.color or color,
                    opacity=None if opacity == 1.0 else opacity,
                    flat_shading=kind == "solid",
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
        bodies: Surfaces of the links that move: the base of the robot itself is there.
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
        places = arrays[self._label_link(arrays)].positions
        for members, place in label_places(places):
            text = labels([branches[i] for i in members])
            name = f"/ghosts/label_{members[0]}"
            self._nodes.append(self._scene.add_label(name, text, position=place))

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


def label_places(
    places: NDArray[np.float64],
) -> list[tuple[list[int], NDArray[np.float64]]]:
    """Numbers that share a label and its place, so that no label covers another.

    Args:
        places: Places that are labelled, shape (m, 3) [m].
    """
    groups: list[list[int]] = []
    for number, place in enumerate(places):
        near = (group for group in groups if np.linalg.norm(place - places[group[0]]) < _NEAR)
        group = next(near, None)
        if group is None:
            groups.append([number])
        else:
            group.append(number)
    found: list[tuple[list[int], NDArray[np.float64]]] = []
    middles = [places[group].mean(axis=0) for group in groups]
    for k in np.argsort([middle[2] for middle in middles]):
        place = middles[k]
        for _, below in found:  # from the lowest on
            if np.linalg.norm(place[:2] - below[:2]) < WIDE and place[2] < below[2] + LINE:
                place[2] = below[2] + LINE
        found.append((groups[k], place))
        found.sort(key=lambda item: float(item[1][2]))
    return found


class ObstacleDrawing:
    """One obstacle.

    Args:
        scene: Scene of viser to draw in.
        obstacle: The obstacle.
        held: Whether a link carries it.
        on_move: Called with the obstacle at its new pose or of its new size, and whether the drag
            is over.
        sizing: Whether the handle that scales it is shown.
    """

    def __init__(
        self,
        scene: viser.SceneApi,
        obstacle: Obstacle,
        held: bool,
        on_move: Callable[[Obstacle, bool], None],
        sizing: bool = False,
    ) -> None:
        self._scene = scene
        self._marked = False
        self.obstacle = obstacle
        self.held = held
        self._handle = scene.add_transform_controls(
            f"/obstacles/{obstacle.id}", scale=_HANDLE, depth_test=False
        )
        self._body = scene.add_frame(f"/obstacle_bodies/{obstacle.id}", show_axes=False)
        self._place(np.array(obstacle.pose.position, dtype=float), wxyz(obstacle.pose))
        self._shape = _draw(scene, self._name, obstacle, self._color)
        scene.add_label(f"/obstacle_bodies/{obstacle.id}/name", obstacle.id)

        @self._handle.on_update
        def _(event: viser.TransformControlsEvent) -> None:
            position = np.asarray(event.target.position, dtype=float)
            quaternion = np.asarray(event.target.wxyz, dtype=float)
            self._body.position, self._body.wxyz = position, quaternion
            moved = self.obstacle.model_copy(update={"pose": pose_of(position, quaternion)})
            on_move(moved, event.phase == "end")

        self._corner = self._add_corner(on_move, sizing)

    @property
    def _name(self) -> str:
        return f"/obstacle_bodies/{self.obstacle.id}/shape"

    @property
    def _color(self) -> tuple[int, int, int]:
        if self._marked:
            return HIT_COLOR
        return _HELD_COLOR if self.held else _COLOR

    def _add_corner(
        self, on_move: Callable[[Obstacle, bool], None], sizing: bool
    ) -> viser.TransformControlsHandle | None:
        place = corner(self.obstacle.shape)
        if place is None:
            return None
        handle = self._scene.add_transform_controls(
            f"/obstacle_bodies/{self.obstacle.id}/corner",
            scale=_CORNER,
            disable_rotations=True,
            disable_sliders=True,
            depth_test=False,
            position=place,
            visible=sizing,
        )

        @handle.on_update
        def _(event: viser.TransformControlsEvent) -> None:
            self.obstacle = with_corner(self.obstacle, event.target.position.tolist(), MIN_SIZE)
            self._redraw()
            on_move(self.obstacle, event.phase == "end")

        return handle

    def show_sizing(self, sizing: bool) -> None:
        """Show or hide the handle that scales it.

        Args:
            sizing: Whether the handle is shown.
        """
        if self._corner is not None:
            self._corner.visible = sizing

    def mark(self, marked: bool) -> None:
        """Draw it in the colour of collisions, or in its own.

        Args:
            marked: Whether the obstacle collides.
        """
        if marked != self._marked:
            self._marked = marked
            self._redraw()

    def _redraw(self) -> None:
        self._shape.remove()
        self._shape = _draw(self._scene, self._name, self.obstacle, self._color)

    def show_frame(self, poses: LinkPoses, number: int) -> None:
        """Move the body, not the handles, to a frame of a motion that carries it.

        Args:
            poses: Poses of the obstacle over the frames.
            number: Number of the frame.
        """
        self._body.position = poses.positions[number]
        self._body.wxyz = poses.wxyz[number]

    def show_pose(self, pose: Pose) -> None:
        """Move body and handles.

        Args:
            pose: Pose in the root frame.
        """
        self._place(np.array(pose.position, dtype=float), wxyz(pose))

    def remove(self) -> None:
        """Take it out of the scene."""
        self._handle.remove()
        self._body.remove()

    def _place(self, position: NDArray[np.float64], quaternion: NDArray[np.float64]) -> None:
        for node in (self._handle, self._body):
            node.position, node.wxyz = position, quaternion


class PairDrawing:
    """Marks on the bodies of a failure.

    Args:
        scene: Scene of viser to draw in.
    """

    def __init__(self, scene: viser.SceneApi) -> None:
        self._scene = scene
        self._labels: list[viser.SceneNodeHandle] = []

    def show(
        self,
        pairs: Sequence[tuple[str, str]],
        robot: RobotDrawing,
        links: Mapping[str, Pose],
        obstacles: Mapping[str, ObstacleDrawing],
    ) -> None:
        """Mark the bodies of pairs in place of those before.

        Args:
            pairs: Names of links and obstacles.
            robot: Drawing of the robot.
            links: Poses of the links at the configuration that is drawn.
            obstacles: Drawings of the obstacles, by id.
        """
        self.clear()
        names = {name for pair in pairs for name in pair}
        robot.mark(names)
        for name, drawing in obstacles.items():
            drawing.mark(name in names)
        for number, (a, b) in enumerate(pairs):
            place = [links[name].position for name in (a, b) if name in links]
            place += [
                obstacles[name].obstacle.pose.position for name in (a, b) if name in obstacles
            ]
            if place:
                position = np.mean(np.array(place, dtype=float), axis=0)
                text = f"✗ {a} and {b}"
                self._labels.append(
                    self._scene.add_label(f"/failure/{number}", text, position=position)
                )

    def clear(self) -> None:
        """Remove the labels; the marks go with the next drawing of the bodies."""
        for label in self._labels:
            label.remove()
        self._labels = []


def _draw(
    scene: viser.SceneApi, name: str, obstacle: Obstacle, color: tuple[int, int, int]
) -> viser.SceneNodeHandle:
    shape = obstacle.shape
    match shape:
        case Box():
            x, y, z = shape.size
            return scene.add_box(name, dimensions=(x, y, z), color=color)
        case Sphere():
            return scene.add_icosphere(name, radius=shape.radius, color=color)
        case Cylinder():
            return scene.add_cylinder(name, radius=shape.radius, height=shape.height, color=color)
        case Halfspace():
            position, quaternion = _plane(shape)
            return scene.add_box(
                name,
                dimensions=(_GROUND, _GROUND, _PLATE),
                color=color,
                position=position,
                wxyz=quaternion,
                opacity=0.4,
            )
        case PointCloud():
            points = np.array(shape.points, dtype=np.float32)
            return scene.add_point_cloud(name, points, color, point_size=2.0 * shape.radius)
        case Mesh() if shape.vertices is None:
            return scene.add_label(name, f"{obstacle.id} (STL)")
        case Mesh():
            vertices, faces = np.array(shape.vertices), np.array(shape.faces)
            return scene.add_mesh_simple(name, vertices, faces, color=color, side="double")
        case Convex() | Capsule() | Cone():
            hull = _hull(shape)
            return scene.add_mesh_simple(
                name, hull.vertices, hull.faces, color=color, flat_shading=True, side="double"
            )


def _hull(shape: Convex | Capsule | Cone) -> trimesh.Trimesh:
    """The surface of a shape about its centre."""
    match shape:
        case Convex():
            return trimesh.convex.convex_hull(np.array(shape.vertices, dtype=float))
        case Cone():
            made = trimesh.creation.cone(shape.radius, shape.height, sections=_CIRCLE)
        case Capsule():
            made = trimesh.creation.capsule(shape.height, shape.radius, count=[_CIRCLE, _CIRCLE])
    made.apply_translation(-made.bounds.mean(axis=0))  # some begin at z = 0
    return made


def _plane(shape: Halfspace) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Position and quaternion of the plate that stands for a half-space."""
    normal = np.array(shape.normal, dtype=float)
    length = float(np.linalg.norm(normal))
    turn, _ = Rotation.align_vectors([normal / length], [[0.0, 0.0, 1.0]])
    return normal * shape.offset / length**2, turn.as_quat(scalar_first=True)
