"""Decoupled arms: every branch of random tables, against least squares from many starts."""

import itertools
import math
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from kinematics.errors import NotAvailable
from kinematics.forward import forward
from kinematics.ik.decoupled import decoupled
from kinematics.ik.inverse import IkOptions, inverse_kinematics
from kinematics.ik.numeric.numeric import AXES, POSITION
from kinematics.model.chain import Chain
from kinematics.model.dh import DhRow, DhTable, chain_from_dh

QUARTER = math.pi / 2.0


def row(kind: str, a: float, alpha: float, d: float, theta: float) -> DhRow:
    if kind == "P":
        return DhRow("prismatic", a, alpha, 0.0, theta, lower=-2.0, upper=2.0)
    return DhRow("revolute", a, alpha, d, 0.0, lower=-math.pi, upper=math.pi)


def table(kinds: str, wrist: int, rng: np.random.Generator) -> list[DhRow]:
    """Three joints of some kinds and a wrist of up to three: right angles, or any."""
    right = rng.random() < 0.5
    rows = []
    for kind in kinds:
        alpha = rng.choice([0.0, QUARTER, -QUARTER]) if right else rng.uniform(-2.0, 2.0)
        a, d = rng.choice([0.0, 0.3, 0.5]), rng.choice([0.0, 0.2])
        theta = rng.choice([0.0, QUARTER]) if right else rng.uniform(-2.0, 2.0)
        rows.append(row(kind, a, alpha, d, theta))
    bend = QUARTER if right else 1.1
    hand = {
        0: [],
        1: [row("R", 0.1, 0.4, 0.1, 0.0)],
        2: [row("R", 0.0, bend, 0.2, 0.0), row("R", 0.1, 0.3, 0.0, 0.0)],
        3: [row("R", 0.0, bend, 0.2, 0.0), row("R", 0.0, -bend, 0.0, 0.0),
            row("R", 0.0, 0.0, 0.1, 0.0)],
    }  # fmt: skip
    return [*rows, *hand[wrist]]


def tool(rows: list[DhRow], q: np.ndarray) -> np.ndarray:
    """The product of the table's transforms, written out."""
    T = np.eye(4)
    for item, value in zip(rows, q, strict=True):
        theta, d = item.theta, item.d
        if item.type == "revolute":
            theta += value
        else:
            d += value
        A = np.eye(4)
        A[:3, :3] = Rotation.from_euler("ZX", [theta, item.alpha]).as_matrix()
        A[:3, 3] = [item.a * math.cos(theta), item.a * math.sin(theta), d]
        T = T @ A
    return T


def turned(rows: list[DhRow], difference: np.ndarray) -> np.ndarray:
    turns = np.array([item.type == "revolute" for item in rows])
    wrapped = np.remainder(difference + math.pi, 2.0 * math.pi) - math.pi
    return np.asarray(np.where(turns, wrapped, difference))


def least_singular(J: Any) -> float:
    return float(np.linalg.svd(np.asarray(J))[1][-1])


def error(rows: list[DhRow], T: np.ndarray, q: np.ndarray, *, position: bool) -> np.ndarray:
    now = tool(rows, q)
    shift = now[:3, 3] - T[:3, 3]
    if position:
        return np.asarray(shift)
    return np.concatenate([shift, Rotation.from_matrix(now[:3, :3] @ T[:3, :3].T).as_rotvec()])


@pytest.mark.parametrize("wrist", [0, 1, 2, 3])
@pytest.mark.parametrize("kinds", ["".join(kinds) for kinds in itertools.product("RP", repeat=3)])
def test_all_branches_are_found(kinds: str, wrist: int) -> None:
    rng = np.random.default_rng([ord(kind) for kind in kinds] + [wrist])
    position, tried = wrist == 0, 0
    for _ in range(12):
        rows = table(kinds, wrist, rng)
        chain = chain_from_dh("arm", DhTable("standard", tuple(rows)))
        if tried == 2 or decoupled(chain, position=position) is None:
            continue  # enough, or axes that don't place a point
        tried += 1
        truth = rng.uniform(-1.5, 1.5, len(rows))
        T = tool(rows, truth)
        options = IkOptions(
            "analytic", most=100, outside_limits=True, axes=POSITION if position else AXES
        )
        result = inverse_kinematics(chain, T, options)
        found = [item.joints for item in result.solutions]
        for q in found:
            assert np.abs(error(rows, T, q, position=position)).max() < 1e-8
        starts = [truth, *rng.uniform(-3.0, 3.0, (6, len(rows)))]
        for start in starts:
            fit = least_squares(
                partial(error, rows, T, position=position), start, xtol=1e-15, ftol=1e-15,
                gtol=1e-15,
            )  # fmt: skip
            if np.abs(fit.fun).max() > 1e-10 or least_singular(fit.jac) < 1e-3:
                continue  # no solution, or a singular one
            assert not result.complete or any(
                np.abs(turned(rows, fit.x - q)).max() < 1e-5 for q in found
            )
        if result.complete:
            names = [item.branch for item in result.solutions]
            assert None not in names
    assert tried >= (1 if kinds != "PPP" else 0)


def stanford() -> Chain:
    rows = [
        row("R", 0.0, -QUARTER, 0.4, 0.0), row("R", 0.0, QUARTER, 0.1, 0.0),
        row("P", 0.0, 0.0, 0.0, 0.0), row("R", 0.0, -QUARTER, 0.0, 0.0),
        row("R", 0.0, QUARTER, 0.0, 0.0), row("R", 0.0, 0.0, 0.2, 0.0),
    ]  # fmt: skip
    return chain_from_dh("stanford", DhTable("standard", tuple(rows)))


def test_stanford_arm_has_two_sides_of_shoulder_slide_and_wrist() -> None:
    chain = stanford()
    T = forward(chain, [0.3, 0.7, 0.6, 0.4, 0.9, -0.5])
    options = IkOptions("analytic", most=100, outside_limits=True)
    result = inverse_kinematics(chain, T, options)
    assert len(result.solutions) == 8
    assert result.complete
    assert len({item.branch for item in result.solutions}) == 8


def test_straight_wrist_is_one_solution_that_is_not_all() -> None:
    chain = stanford()
    seed = np.array([0.3, 0.7, 0.6, 0.4, 0.0, -0.5])
    result = inverse_kinematics(
        chain, forward(chain, seed), IkOptions("analytic", most=100), seed_joints=seed
    )
    assert not result.complete
    np.testing.assert_allclose(result.solutions[0].joints, seed, atol=1e-7)


def test_arm_whose_joints_move_the_wrist_in_a_plane_has_none() -> None:
    rows = [row("R", 0.3, 0.0, 0.0, 0.0)] * 3 + table("RRR", 3, np.random.default_rng(0))[3:]
    chain = chain_from_dh("planar", DhTable("standard", tuple(rows)))
    assert decoupled(chain) is None
    rows = [row("P", 0.0, 0.0, 0.0, 0.0)] * 2 + [row("R", 0.1, 0.3, 0.0, 0.0)] * 5
    with pytest.raises(NotAvailable):
        inverse_kinematics(
            chain_from_dh("seven", DhTable("standard", tuple(rows))),
            np.eye(4),
            IkOptions("analytic"),
        )
