"""Drawings of obstacles, each with handles that move and turn it."""

from collections.abc import Callable

import numpy as np
import viser
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

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
from armwright_wire.scene import Capsule, Cone
from studio.motion_frames import LinkPoses
from studio.page.colors import HIT_COLOR
from studio.pose import pose_of, wxyz
from studio.shapes import corner, with_corner

#: Obstacles are grey, those that are held orange.
_COLOR = (140, 150, 160)
_HELD_COLOR = (230, 159, 0)
#: A half-space is drawn as a plate of this size and thickness [m].
_GROUND, _PLATE = 3.0, 0.002
#: Length of the handles [m].
_HANDLE = 0.18
_CORNER = 0.1
#: Least size that handles and numbers give [m].
MIN_SIZE = 0.005
#: Corners of a drawn circle, and rings of a drawn ball.
_CIRCLE = 24
_RINGS = 8


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
            corners = _corners(shape)
            hull = ConvexHull(corners).simplices
            return scene.add_mesh_simple(
                name, corners, hull, color=color, flat_shading=True, side="double"
            )


def _corners(shape: Convex | Capsule | Cone) -> NDArray[np.float64]:
    """Points whose convex hull is drawn, shape (k, 3) [m]."""
    if isinstance(shape, Convex):
        return np.array(shape.vertices, dtype=float)
    angles = np.linspace(0.0, 2.0 * np.pi, _CIRCLE, endpoint=False)
    circle = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(_CIRCLE)])
    half = 0.5 * shape.height
    if isinstance(shape, Cone):
        return np.vstack([shape.radius * circle - [0.0, 0.0, half], [[0.0, 0.0, half]]])
    rows = []
    for polar in np.linspace(0.0, 0.5 * np.pi, _RINGS):
        ring = shape.radius * np.cos(polar) * circle
        top = half + shape.radius * np.sin(polar)
        offset = np.array([0.0, 0.0, top])
        rows += [ring + offset, ring - offset]
    return np.vstack(rows)


def _plane(shape: Halfspace) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Position and quaternion of the plate that stands for a half-space."""
    normal = np.array(shape.normal, dtype=float)
    length = float(np.linalg.norm(normal))
    normal = normal / length
    # The quaternion that turns z into the normal is the half-way one: (1 + z·n, z × n).
    quaternion = np.array([1.0 + normal[2], -normal[1], normal[0], 0.0])
    if 1.0 + normal[2] < 1e-9:  # the normal is -z: half a turn about x
        quaternion = np.array([0.0, 1.0, 0.0, 0.0])
    return normal * shape.offset / length, quaternion / np.linalg.norm(quaternion)
