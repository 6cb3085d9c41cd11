"""The judge's own readers and quick looks beside other libraries."""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import fcl
import numpy as np
import pytest

from kinematics import pose
from kinematics.arrays import Array
from kinematics.pose import from_axis_angle
from kinematics.urdf import urdf
from obstacles.meshes import collada, mesh
from obstacles.scenes import scene
from tests.planning.proof.sabotage.box_gaps import box_gaps
from tests.planning.proof.sabotage.readers import (
    TOLERANCE,
    robot_differences,
    scene_differences,
)
from tests.planning.proof.sabotage.trial import Sabotage


def _off(true: Callable[..., Any], *values: Any) -> Any:
    """Link meshes two millimetres off."""
    vertices, faces = true(*values)
    return np.asarray(vertices) + np.array([0.0, 0.0, 2e-3]), faces


def _rounded(true: Callable[..., Array], T: Array, name: str) -> Array:
    """Obstacles one millimetre off whose rotation has few digits."""
    right = true(T, name)
    if np.array_equal(right, T):
        return right
    moved = np.array(right)
    moved[0, 3] += 1e-3
    moved.setflags(write=False)
    return moved


def _unscaled(true: Callable[..., Any], vertices: Array, faces: Any, _scale: Any) -> Any:
    return true(vertices, faces, (1.0, 1.0, 1.0))


def _turned(true: Callable[..., Array], *values: Any) -> Array:
    """The rotations of an origin about the axes of the frame turned so far."""
    T = np.array(true(*values))
    T[:3, :3] = T[:3, :3].T
    return T


def _wrong_square(true: Callable[..., bytes], text: bytes, most: int) -> bytes:
    """The seventh vertex in place of the eighth one."""
    return true(text, most).replace(b" 8", b" 7")


def _scalar_first(true: Callable[..., Array], xyzw: Any) -> Array:
    return true(np.roll(np.asarray(xyzw), 1))


#: By name: the function, how it lies, and whether a robot shows it, a scene, or both.
FAULTS: dict[str, tuple[Callable[..., Any], Callable[..., Any], str]] = {
    "meshes two millimetres off": (mesh.scaled, _off, "both"),
    "rotations of few digits one millimetre off": (scene._rigid, _rounded, "scene"),
    "scales not obeyed": (mesh.scaled, _unscaled, "both"),
    "units not obeyed": (collada._unit, lambda true, root: 1.0, "scene"),
    "origins turned the other way": (urdf.read_origin, _turned, "robot"),
    "faces of other corners": (mesh.plain_obj, _wrong_square, "both"),
    "quaternions read as w, x, y, z": (pose.from_quaternion, _scalar_first, "scene"),
}
Q = np.array([0.7, -0.4, 1.1])


def wrong(differences: dict[str, float]) -> dict[str, float]:
    return {name: by for name, by in differences.items() if not by <= TOLERANCE}


@pytest.mark.parametrize("seed", range(3))
def test_the_proof_has_the_solids_that_pinocchio_reads(seed: int, tmp_path: Path) -> None:
    q = np.random.default_rng(seed).uniform(-1.5, 1.5, 3)
    assert wrong(robot_differences(tmp_path, q)) == {}


@pytest.mark.parametrize("seed", range(3))
def test_the_proof_has_the_obstacles_that_other_libraries_read(seed: int) -> None:
    assert wrong(scene_differences(seed)) == {}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_of_a_reader_is_seen(name: str, tmp_path: Path) -> None:
    function, fault, where = FAULTS[name]
    with ExitStack() as undo:
        Sabotage(undo).wrap(function, fault)
        found = {
            "robot": bool(wrong(robot_differences(tmp_path, Q))),
            "scene": bool(wrong(scene_differences(0))),
        }
    assert found == {place: where in (place, "both") for place in found}


def test_boxes_are_at_least_as_far_apart_as_gaps_say() -> None:
    random = np.random.default_rng(5)
    count = 2000
    halves = 10.0 ** random.uniform(-1.5, 0.0, (2, count, 3))
    middles = random.normal(size=(2, count, 3)) * 0.4
    turned = np.array([[turn(random) for _ in range(count)] for _ in range(2)])
    gaps = box_gaps((turned[0], halves[0]), (turned[1], halves[1]), middles[0] - middles[1])
    overlaps = 0
    for k in range(count):
        one, other = (
            fcl.CollisionObject(
                fcl.Box(*(2.0 * halves[i, k])), fcl.Transform(turned[i, k], middles[i, k])
            )
            for i in range(2)
        )
        if fcl.collide(one, other):
            overlaps += 1
            assert gaps[k] <= 1e-9
        else:
            assert gaps[k] <= fcl.distance(one, other) + 1e-5
    assert 0.2 < overlaps / count < 0.8
    assert (gaps > 0.0).sum() > 0.8 * (count - overlaps)


def turn(random: np.random.Generator) -> Array:
    """Any rotation; every other one a quarter of a turn."""
    if random.random() < 0.5:
        return np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return from_axis_angle(random.normal(size=3), random.uniform(0.0, np.pi))
