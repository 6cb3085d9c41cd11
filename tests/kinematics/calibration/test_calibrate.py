"""Corrections of arms found from measurements whose errors are known."""

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.calibration.calibrate import (
    Calibration,
    Measured,
    calibrate,
    margins,
    poses_of,
    with_corrections,
)
from kinematics.errors import InvalidOption
from kinematics.forward import forward, joint_frames
from kinematics.model.chain import Chain
from kinematics.pose import from_rpy, transform
from kinematics.robots import builtin_chain

MADE = 1e-3


def real_arm(chain: Chain, rng: np.random.Generator) -> tuple[Chain, Array]:
    """An arm as it is, and its tip: all frames are off by the tolerance of its making."""
    X = MADE * rng.standard_normal((chain.n + 1, 6))
    tip = chain.tip
    links = tuple(
        replace(link, T_joint_link=link.T_joint_link @ poses_of(X[-1])) if link is tip else link
        for link in chain.links
    )
    named = dict(zip(chain.joint_names, poses_of(X[:-1]), strict=True))
    return with_corrections(replace(chain, links=links), named), X


def configurations(chain: Chain, rng: np.random.Generator, count: int) -> Array:
    lower, upper = chain.sampling_bounds()
    return rng.uniform(np.maximum(lower, -2.5), np.minimum(upper, 2.5), (count, chain.n))


def measured(kind: str, T: Array, rng: np.random.Generator, noise: float) -> Measured:
    p = T[:, :3, 3] + noise * rng.standard_normal((len(T), 3))
    if kind == "poses":
        turns = np.array([from_rpy(noise * rng.standard_normal(3)) for _ in T])
        rows = [transform(R @ t[:3, :3], at) for R, t, at in zip(turns, T, p, strict=True)]
        return Measured(poses=np.array(rows))
    if kind == "points":
        return Measured(points=p)
    anchor = np.array([1.0, 0.5, 0.2])
    return Measured(distances=np.linalg.norm(p - anchor, axis=1), anchor=anchor)


@cache
def calibrated(
    name: str, kind: str, seed: int, **options: Any
) -> tuple[Chain, Chain, Calibration, Array]:
    rng = np.random.default_rng(seed)
    chain = builtin_chain(name)
    truth, X = real_arm(chain, rng)
    q = configurations(chain, rng, 80)
    found = calibrate(chain, q, measured(kind, forward(truth, q), rng, 5e-5), **options)
    return chain, truth, found, X


@pytest.mark.parametrize("name", ["ur5e", "panda", "stanford"])
@pytest.mark.parametrize("kind", ["poses", "points", "distances"])
def test_corrections_are_within_their_errors_and_the_tip_is_found(name: str, kind: str) -> None:
    chain, truth, found, X = calibrated(name, kind, 3)
    z = (found.corrections[:-1] - X) / found.standard_errors[:-1]
    assert (np.abs(z) <= 3.0).mean() >= 0.97
    assert 0.8 < np.sqrt(np.mean(z**2)) < 1.2
    assert found.noise[0] == pytest.approx(5e-5, rel=0.3)
    assert found.after < 0.1 * found.before
    q = configurations(chain, np.random.default_rng(9), 50)
    tip = chain.tip.T_joint_link @ poses_of(found.corrections[chain.n])
    at = joint_frames(found.robot, q)[:, -1] @ tip if chain.tip.joint == chain.n - 1 else None
    assert at is not None
    off = np.linalg.norm(at[:, :3, 3] - forward(truth, q)[:, :3, 3], axis=1)
    was = np.linalg.norm((forward(chain, q) - forward(truth, q))[:, :3, 3], axis=1)
    if kind != "distances":
        assert np.sqrt(np.mean(off**2)) < 1e-4 < 0.1 * np.sqrt(np.mean(was**2))
    anchor = np.array([1.0, 0.5, 0.2])  # turning about it is not seen in distances
    ranges = [np.linalg.norm(p[:, :3, 3] - anchor, axis=1) for p in (at, forward(truth, q))]
    assert np.sqrt(np.mean((ranges[0] - ranges[1]) ** 2)) < 1e-4


def test_the_identifiable_combinations_of_poses_are_as_many_as_the_textbook_says() -> None:
    # 4 for each revolute joint, 2 for each prismatic one, and 6 of the frame.
    assert calibrated("ur5e", "poses", 3)[2].identifiable == 4 * 6 + 6
    assert calibrated("panda", "poses", 3)[2].identifiable == 4 * 7 + 6
    assert calibrated("stanford", "poses", 3)[2].identifiable == 4 * 5 + 2 + 6


@pytest.mark.parametrize("kind", ["poses", "points"])
def test_an_unknown_frame_and_tip_are_found_too(kind: str) -> None:
    rng = np.random.default_rng(4)
    chain = builtin_chain("ur5e")
    truth, _ = real_arm(chain, rng)
    T_measurement_base = transform(from_rpy([0.4, -0.7, 2.0]), [3.0, -1.0, 0.5])
    T_tip_marker = transform(from_rpy([0.1, 0.2, -0.3]), [0.05, 0.02, 0.1])
    q = configurations(chain, rng, 80)
    T = T_measurement_base @ forward(truth, q) @ T_tip_marker
    found = calibrate(chain, q, measured(kind, T, rng, 5e-5), unknown=("frame", "tip"))
    assert found.after < 2e-4
    assert np.abs(poses_of(found.corrections[-1]) - T_measurement_base).max() < 0.02


def test_a_plane_that_is_touched_corrects_what_moves_the_tip_off_it() -> None:
    rng = np.random.default_rng(5)
    chain = builtin_chain("planar_rr")
    truth, _ = real_arm(chain, rng)
    q = configurations(chain, rng, 30)
    normal = np.array([0.0, 1.0, 0.0])
    offset = float(forward(chain, q)[0, 1, 3])
    at = forward(truth, q)[:, :3, 3]
    # The arm moves in a plane: what is off it is measured there.
    assert np.abs(at @ normal - offset).max() > 1e-4
    plane = Measured(plane=np.array([*normal, offset]), noise=(1e-5, 1e-5))
    found = calibrate(chain, q, plane)
    assert found.identifiable <= 6
    assert found.after < found.before


@pytest.mark.parametrize("seed", range(4))
def test_margins_hold_for_every_body(seed: int) -> None:
    chain, truth, found, _ = calibrated("ur5e", "poses", 20 + seed)
    reaches = np.full(chain.n, 0.3)
    sure, described = margins(chain, found, reaches)
    q = configurations(chain, np.random.default_rng(77), 300)
    frames, real, old = (joint_frames(robot, q) for robot in (found.robot, truth, chain))
    corners = np.concatenate([0.3 * np.eye(3), -0.3 * np.eye(3)])
    points = np.c_[corners, np.ones(6)]
    for a, margin in ((frames, sure), (old, described)):
        off = np.linalg.norm(((a - real)[:, :, None] @ points[..., None])[..., :3, 0], axis=-1)
        assert (off.max(axis=(0, 2)) <= margin).all()
    assert sure.max() < 0.02


def test_odd_measurements_are_refused() -> None:
    chain = builtin_chain("planar_rr")
    q = np.zeros((3, 2))
    p = np.zeros((3, 3))
    odd: list[tuple[Any, str]] = [
        (Measured(), "one kind"),
        (Measured(points=p, distances=p[:, 0], anchor=p[0]), "one kind"),
        (Measured(distances=p[:, 0]), "anchor"),
        (Measured(points=p[:2]), "3 configurations and 2"),
        (Measured(plane=np.array([0.0, 0.0, 2.0, 0.0])), "length 1"),
        (Measured(distances=np.array([1.0]), anchor=p[0]), "more configurations"),
    ]
    for given, about in odd:
        rows = q[:1] if "more" in about else q
        with pytest.raises(InvalidOption, match=about):
            calibrate(chain, rows, given)


@pytest.mark.parametrize("offset", [0.05, 50.0])
def test_measurements_that_no_corrections_explain_are_refused(offset: float) -> None:
    chain, rng = builtin_chain("ur5e"), np.random.default_rng(0)
    q = configurations(chain, rng, 16)
    T = forward(chain, q)
    away = T[:, :3, 3] + offset * T[:, :3, 0]  # the place of the marker is not told
    with pytest.raises(InvalidOption, match='whether "frame" or "tip" is unknown'):
        calibrate(chain, q, Measured(points=away))


def test_noise_beyond_what_was_said_is_refused() -> None:
    chain, rng = builtin_chain("ur5e"), np.random.default_rng(0)
    q = configurations(chain, rng, 40)
    T = forward(chain, q)
    noisy = T[:, :3, 3] + 0.05 * rng.standard_normal((40, 3))
    with pytest.raises(InvalidOption, match="or the noise"):
        calibrate(chain, q, Measured(points=noisy))
    assert calibrate(chain, q, Measured(points=noisy, noise=(0.05, 1.0))).after < 0.06


@pytest.mark.parametrize("unknown", [(), ("frame",), ("tip",), ("frame", "tip")])
@pytest.mark.parametrize("kind", ["poses", "points"])
def test_exact_measurements_leave_errors_of_what_they_do_not_determine(
    kind: str, unknown: Any
) -> None:
    chain, rng = builtin_chain("ur5e"), np.random.default_rng(0)
    q = configurations(chain, rng, 60)
    exact = measured(kind, forward(chain, q), rng, 0.0)
    found = calibrate(chain, q, exact, unknown=unknown)
    assert found.after < 1e-8
    assert (np.linalg.eigvalsh(found.covariance) >= -1e-12).all()
    sure, described = margins(chain, found, np.full(6, 0.3))
    assert (sure > 1e-4).any()  # the frame of the base, for instance, is one with the first joint's
    np.testing.assert_allclose(described, sure, atol=1e-4)
