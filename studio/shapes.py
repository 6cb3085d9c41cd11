"""New obstacles of the scene editor, their sizes and their scaling."""

from collections.abc import Sequence
from typing import Literal

from armwright_client import Box, Capsule, Cone, Cylinder, Obstacle, Pose, Sphere
from armwright_wire.scene import Shape

ShapeKind = Literal["box", "sphere", "cylinder"]

#: Edge, diameter and height of a new obstacle [m]: a box that a gripper holds.
_SIZE = 0.1


def new_obstacle(
    kind: ShapeKind, obstacle_id: str, position: tuple[float, float, float]
) -> Obstacle:
    """A new obstacle of the usual size.

    Args:
        kind: Kind of the shape.
        obstacle_id: Id of the obstacle.
        position: Position of the centre in the root frame [m].
    """
    shapes: dict[ShapeKind, Shape] = {
        "box": Box(size=[_SIZE, _SIZE, _SIZE]),
        "sphere": Sphere(radius=0.5 * _SIZE),
        "cylinder": Cylinder(radius=0.5 * _SIZE, height=_SIZE),
    }
    return Obstacle(id=obstacle_id, shape=shapes[kind], pose=Pose.at(*position))


def dimensions(shape: Shape) -> dict[str, float]:
    """Sizes that the editor changes [m], by name; empty for shapes that it does not scale."""
    match shape:
        case Box():
            return dict(zip("xyz", shape.size, strict=True))
        case Sphere():
            return {"radius": shape.radius}
        case Cylinder() | Capsule() | Cone():
            return {"radius": shape.radius, "height": shape.height}
        case _:
            return {}


def with_dimension(obstacle: Obstacle, name: str, value: float) -> Obstacle:
    """The obstacle with one of its sizes changed.

    Args:
        obstacle: The obstacle.
        name: One of `dimensions`.
        value: The new size [m].
    """
    sizes = dimensions(obstacle.shape) | {name: value}
    shape = obstacle.shape
    changed: Shape
    if isinstance(shape, Box):
        changed = Box(size=[sizes[axis] for axis in "xyz"])
    else:
        changed = type(shape).of(**sizes)
    return obstacle.model_copy(update={"shape": changed})


def corner(shape: Shape) -> tuple[float, float, float] | None:
    """Place of the handle that scales a shape, in its own frame [m]; None if it has none."""
    match shape:
        case Box():
            x, y, z = shape.size
            return 0.5 * x, 0.5 * y, 0.5 * z
        case Sphere():
            return shape.radius, 0.0, 0.0
        case Cylinder() | Capsule() | Cone():
            return shape.radius, 0.0, 0.5 * shape.height
        case _:
            return None


def with_corner(obstacle: Obstacle, position: Sequence[float], least: float) -> Obstacle:
    """The obstacle scaled so that its handle is at a place; its centre stays.

    Args:
        obstacle: The obstacle.
        position: Position of the handle in the obstacle's frame, shape (3,) [m].
        least: Size below which nothing is scaled [m].
    """
    x, y, z = (max(abs(float(value)), 0.5 * least) for value in position)
    sizes = {"x": 2.0 * x, "y": 2.0 * y, "z": 2.0 * z, "radius": x, "height": 2.0 * z}
    for name in dimensions(obstacle.shape):
        obstacle = with_dimension(obstacle, name, sizes[name])
    return obstacle
