"""Shapes of the scene editor: their handle is on them, and scales them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armwright_client import Box, Cylinder, Halfspace, Obstacle, Pose, Sphere
from armwright_wire.scenes.scene import Capsule, Cone, Shape
from studio.obstacles import corner, dimensions, with_corner

SHAPES: list[Shape] = [
    Box(size=[0.1, 0.2, 0.3]),
    Sphere(radius=0.2),
    Cylinder(radius=0.1, height=0.5),
    Capsule(radius=0.1, height=0.5),
    Cone(radius=0.1, height=0.5),
]
LEAST = 0.005
LENGTHS = st.floats(0.01, 3.0)


def obstacle(shape: Shape) -> Obstacle:
    return Obstacle(id="it", shape=shape, pose=Pose.at(1.0, 2.0, 3.0))


@pytest.mark.parametrize("shape", SHAPES)
@given(x=LENGTHS, y=LENGTHS, z=LENGTHS)
def test_the_handle_stays_where_it_is_dragged(shape: Shape, x: float, y: float, z: float) -> None:
    begin = corner(shape)
    assert begin is not None
    wanted = np.where(np.array(begin) > 0.0, [x, y, z], 0.0)
    scaled = with_corner(obstacle(shape), wanted.tolist(), LEAST)
    np.testing.assert_allclose(corner(scaled.shape) or (), wanted)
    assert scaled.pose == obstacle(shape).pose


@pytest.mark.parametrize("shape", SHAPES)
def test_nothing_is_scaled_to_nothing(shape: Shape) -> None:
    scaled = with_corner(obstacle(shape), [0.0, 0.0, 0.0], LEAST)
    assert min(dimensions(scaled.shape).values()) >= 0.5 * LEAST


def test_half_spaces_have_no_handle() -> None:
    assert corner(Halfspace(normal=[0.0, 0.0, 1.0], offset=0.0)) is None
