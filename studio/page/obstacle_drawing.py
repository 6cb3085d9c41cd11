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
from armwright_client.shape import Capsule, Cone
from studio.motion_frames import LinkPoses
from studio.pose import pose_of, wxyz

#: Obstacles are grey, those that are held orange.
_COLOR = (140, 150, 160)
_HELD_COLOR = (230, 159, 0)
#: A half-space is drawn as a plate of this size and thickness [m].
_GROUND, _PLATE = 3.0, 0.002
#: Length of the handles [m].
_HANDLE = 0.18
#: Corners of a drawn circle, and rings of a drawn ball.
_CIRCLE = 24
_RINGS = 8


class ObstacleDrawing:
    """One obstacle.

    Args:
        scene: To draw in.
        obstacle: The obstacle.
        held: Whether a link carries it.
        on_move: Called with the obstacle at its new pose, and whether the drag is over.
    """

    def __init__(
        self,
        scene: viser.SceneApi,
        obstacle: Obstacle,
        held: bool,
        on_move: Callable[[Obstacle, bool], None],
    ) -> None:
        self.obstacle = obstacle
        self.held = held
        self._handle = scene.add_transform_controls(
            f"/obstacles/{obstacle.id}", scale=_HANDLE, depth_test=False
        )
        self._body = scene.add_frame(f"/obstacle_bodies/{obstacle.id}", show_axes=False)
        self._place(np.array(obstacle.pose.position, dtype=float), wxyz(obstacle.pose))
        _draw(scene, f"/obstacle_bodies/{obstacle.id}/shape", obstacle, held)
        scene.add_label(f"/obstacle_bodies/{obstacle.id}/name", obstacle.id)

        @self._handle.on_update
        def _(event: viser.TransformControlsEvent) -> None:
            position = np.asarray(event.target.position, dtype=float)
            quaternion = np.asarray(event.target.wxyz, dtype=float)
            self._body.position, self._body.wxyz = position, quaternion
            moved = self.obstacle.model_copy(update={"pose": pose_of(position, quaternion)})
            on_move(moved, event.phase == "end")

    def show_frame(self, poses: LinkPoses, number: int) -> None:
        """Move the body, not the handles, to a frame of a motion that carries it.

        Args:
            poses: Of the obstacle over the frames.
            number: Of the frame.
        """
        self._body.position = poses.positions[number]
        self._body.wxyz = poses.wxyz[number]

    def show_pose(self, pose: Pose) -> None:
        """Move body and handles.

        Args:
            pose: In the root frame.
        """
        self._place(np.array(pose.position, dtype=float), wxyz(pose))

    def remove(self) -> None:
        """Take it out of the scene."""
        self._handle.remove()
        self._body.remove()

    def _place(self, position: NDArray[np.float64], quaternion: NDArray[np.float64]) -> None:
        for node in (self._handle, self._body):
            node.position, node.wxyz = position, quaternion


def _draw(scene: viser.SceneApi, name: str, obstacle: Obstacle, held: bool) -> None:
    color = _HELD_COLOR if held else _COLOR
    shape = obstacle.shape
    match shape:
        case Box():
            x, y, z = shape.size
            scene.add_box(name, dimensions=(x, y, z), color=color)
        case Sphere():
            scene.add_icosphere(name, radius=shape.radius, color=color)
        case Cylinder():
            scene.add_cylinder(name, radius=shape.radius, height=shape.height, color=color)
        case Halfspace():
            position, quaternion = _plane(shape)
            scene.add_box(
                name,
                dimensions=(_GROUND, _GROUND, _PLATE),
                color=color,
                position=position,
                wxyz=quaternion,
                opacity=0.4,
            )
        case PointCloud():
            points = np.array(shape.points, dtype=np.float32)
            scene.add_point_cloud(name, points, color, point_size=2.0 * shape.radius)
        case Mesh() if shape.vertices is None:
            scene.add_label(name, f"{obstacle.id} (STL)")
        case Mesh():
            vertices, faces = np.array(shape.vertices), np.array(shape.faces)
            scene.add_mesh_simple(name, vertices, faces, color=color, side="double")
        case Convex() | Capsule() | Cone():
            corners = _corners(shape)
            hull = ConvexHull(corners).simplices
            scene.add_mesh_simple(
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
