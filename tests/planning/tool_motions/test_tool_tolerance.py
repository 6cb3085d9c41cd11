"""Tolerances of the tool against scipy's rotations."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from kinematics.errors import InvalidOption
from kinematics.pose import transform
from planning.tool_motions.tool_tolerance import ToolTolerance, rotations, tilts

RANDOM = np.random.default_rng(4)


def poses(count: int) -> np.ndarray:
    turns = Rotation.random(count, RANDOM).as_matrix()
    places = RANDOM.normal(size=(count, 3))
    return np.array([transform(R, p) for R, p in zip(turns, places, strict=True)])


@pytest.mark.parametrize("fixed", [False, True])
def test_deviations_are_those_that_poses_were_made_with(fixed: bool) -> None:
    axes = Rotation.random(random_state=1).as_matrix() if fixed else None
    box = ToolTolerance(
        np.array([-0.5] * 3 + [-1.3] * 3), np.array([0.5] * 3 + [1.3] * 3), axes=axes
    )
    nominal, d = poses(40), RANDOM.uniform(box.lower, box.upper, (40, 6))
    T = box.poses(nominal, d)
    np.testing.assert_allclose(box.deviations(nominal, T), d, atol=1e-9)
    D = Rotation.from_euler("XYZ", d[:, 3:]).as_matrix()
    np.testing.assert_allclose(rotations(d[:, 3:]), D, atol=1e-12)
    for k in range(40):
        N = nominal[k]
        A = N[:3, :3] if axes is None else axes
        np.testing.assert_allclose(T[k, :3, 3], N[:3, 3] + A @ d[k, :3], atol=1e-12)
        np.testing.assert_allclose(T[k, :3, :3], A @ D[k] @ A.T @ N[:3, :3], atol=1e-12)


def test_clipping_brings_deviations_inside_and_leaves_those_that_are() -> None:
    box = ToolTolerance.of({"x": (-0.1, 0.2)}, ("rz",), tilt=0.3)
    d = RANDOM.uniform(-1.0, 1.0, (200, 6))
    clipped = box.clip(d)
    assert (tilts(clipped) <= 0.3 + 1e-9).all()
    assert (clipped[:, 0] >= -0.1).all()
    assert (clipped[:, 0] <= 0.2).all()
    assert not clipped[:, 1:3].any()
    np.testing.assert_array_equal(clipped[:, 5], d[:, 5])
    np.testing.assert_allclose(box.clip(clipped), clipped, atol=1e-12)
    assert (box.excess(clipped) < 1e-9).all()
    assert box.excess(d)[:, 0].max() > 0.5


def test_whole_turns_are_no_excess() -> None:
    box = ToolTolerance.of({"rz": (3.0, 3.3)})
    inside = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, -math.pi + 0.05]])
    assert box.excess(inside).max() < 1e-12
    # Zero is nearer to the upper end, 3.3, by way of a whole turn.
    assert box.excess(np.zeros((1, 6)))[0, 1] == pytest.approx(2.0 * math.pi - 3.3)


def test_tolerances_that_make_no_sense_are_refused() -> None:
    for ranges, free, tilt, words in (
        ({"x": (0.1, -0.1)}, (), None, "above"),
        ({"x": (-2.0, 2.0)}, (), None, "at most 1 m"),
        ({}, ("x",), None, "can't be free"),
        ({}, (), -0.1, "above|positive"),
        ({"ry": (-1.5, 1.5)}, (), None, "not defined"),
        ({}, ("ry",), None, "free all"),
    ):
        with pytest.raises(InvalidOption) as caught:
            ToolTolerance.of(ranges, free, tilt)  # type: ignore[arg-type]
        text = f"{caught.value.message} {caught.value.hint}"
        assert any(word in text for word in words.split("|")), text
    assert ToolTolerance.of({}, ("rx", "ry", "rz")).lower[4] == -np.inf
