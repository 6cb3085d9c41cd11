"""Bounds of how far solids move on cells of time, against dense looks at moving solids."""

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.forward import joint_frames
from kinematics.pose import transform
from obstacles.convex.piece import Piece, PieceArrays, PieceKind
from planning.proof.collision.displacement import (
    BEND,
    MOVE_COLUMNS,
    MOVED,
    TWIST,
    Mask,
    displacement_along,
    displacement_bounds,
    lowest,
)
from planning.proof.motion_bounds import (
    JOINT_COLUMNS,
    PIECE_COLUMNS,
    RADIUS,
    RATE,
    SPEED,
    VALUE,
    enclose,
    enclose_span,
    piece_bounds,
)
from tests.obstacles.solids import KINDS, random_solid, random_transform
from tests.planning.proof.test_motion_bounds import random_motion, smooth_motion
from tests.planning.scenes import builtin


def every(count: int) -> Mask:
    """All rows are asked for."""
    return np.ones(count, dtype=np.bool_)


@pytest.mark.parametrize("name", ["panda", "stanford", "scara", "kr6_sixx"])
def test_no_point_of_a_ball_moves_farther_than_its_bounds(name: str) -> None:
    """Points of balls on links, seen from other links, along many directions."""
    chain = builtin(name).chain
    random = np.random.default_rng(7)
    tightest = np.inf
    for case in range(40):
        motion = random_motion(random, chain.n, 1, 0.0)
        length = motion.duration
        half = float(length / 2.0 * 10.0 ** -random.uniform(0.0, 3.0))
        at = float(random.uniform(half, length - half))
        joints = np.empty((chain.n, JOINT_COLUMNS))
        size = motion.coefficients.shape[2]
        enclose(motion.coefficients[0], at, half, np.empty((2, size)), joints)
        frames = joint_frames(chain, joints[:, VALUE])
        carrier = int(random.integers(0, chain.n))
        still = int(random.integers(-1, carrier))
        radius = float(random.uniform(0.0, 0.2))
        local = np.append(random.normal(size=3) * 0.3, 1.0)
        center = (frames[carrier] @ local)[:3]
        moves = np.zeros((chain.n, MOVE_COLUMNS))
        bodies = np.stack([chain.joint_types, np.arange(-1, chain.n - 1)])
        middle = (float(center[0]), float(center[1]), float(center[2]))
        displacement_bounds(
            bodies, frames, (middle, radius), carrier, joints, half, every(chain.n), moves
        )
        bound = moves[still + 1, MOVED]
        offsets = random.normal(size=(12, 3))
        offsets *= radius / np.linalg.norm(offsets, axis=1, keepdims=True)
        inside = np.concatenate([offsets, np.zeros((12, 1))], axis=1)
        points = (local + inside @ np.linalg.inv(frames[carrier]).T) if radius else local[None]
        base = np.eye(4) if still < 0 else frames[still]
        start = (frames[carrier] @ points.T)[:3]
        for time in np.linspace(at - half, at + half, 15):
            then = joint_frames(chain, motion.sample([min(max(time, 0.0), length)])[0])
            seen = np.eye(4) if still < 0 else then[still]
            moved = (base @ np.linalg.inv(seen) @ then[carrier] @ points.T)[:3] - start
            farthest = float(np.linalg.norm(moved, axis=0).max())
            assert farthest <= bound + 1e-12
            if case % 3 == 0 and abs(time - at) == half and farthest > 0.0:
                tightest = min(tightest, bound / farthest)
            for towards in random.normal(size=(6, 3)):
                u = towards / np.linalg.norm(towards)
                along = displacement_along(moves, still + 1, radius, half, (u[0], u[1], u[2]))
                assert float(np.abs(u @ moved).max()) <= along + 1e-12
                assert along <= bound
    assert tightest < 2.0


def test_bound_of_a_turning_arm_is_the_arc() -> None:
    frames = np.eye(4)[None].copy()
    bodies = np.array([[0], [-1]])
    for angle in (0.0, 1e-3, 0.5, 10.0):
        joints, moves = np.zeros((1, JOINT_COLUMNS)), np.zeros((1, MOVE_COLUMNS))
        joints[0, RADIUS] = joints[0, SPEED] = joints[0, RATE] = angle
        displacement_bounds(bodies, frames, ((1.0, 0.0, 5.0), 0.1), 0, joints, 1.0, every(1), moves)
        # A point never moves farther than its circle's diameter.
        assert moves[0, MOVED] == pytest.approx(min(1.1 * angle, 2.2))
        across = displacement_along(moves, 0, 0.1, 1e-3, (0.0, 0.0, 1.0))
        assert across == pytest.approx(min(0.5 * 1.1 * angle**2, 1.1 * angle, 2.2))


def points_of(piece: Piece) -> Array:
    """Points on the core of a piece in its frame, those of round ones 3 degrees apart, (k, 3)."""
    if len(piece.vertices):
        return piece.vertices
    angles = np.linspace(0.0, 2.0 * np.pi, 120, endpoint=False)
    rim = piece.radius * np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
    base = rim - [0.0, 0.0, piece.half_height]
    if piece.kind == PieceKind.CONE:
        return np.concatenate([base, [[0.0, 0.0, piece.half_height]]])
    return np.concatenate([base, rim + np.array([0.0, 0.0, piece.half_height])])


@pytest.mark.parametrize("name", ["panda", "stanford", "scara"])
@pytest.mark.parametrize("pieces", [1, 3])
def test_no_point_of_a_solid_comes_lower_than_its_bound(name: str, pieces: int) -> None:
    """Solids of all kinds on links, seen from other links, over intervals of one or more pieces."""
    chain = builtin(name).chain
    random = np.random.default_rng(11)
    looked = 0
    for case in range(60):
        motion = smooth_motion(random, chain.n, pieces, 0.0)
        joints = np.empty((chain.n, JOINT_COLUMNS))
        if pieces == 1:
            half = float(motion.duration / 2.0 * 10.0 ** -random.uniform(0.0, 2.5))
            at = float(random.uniform(half, motion.duration - half))
            enclose(motion.coefficients[0], at, half, np.empty((2, 6)), joints)
        else:
            table = np.empty((pieces, chain.n, PIECE_COLUMNS))
            piece_bounds(motion.breaks, motion.coefficients, table)
            at = float(motion.breaks[1])
            half = float(max(at, motion.breaks[2] - at))
            enclose_span(motion.coefficients, table, 0, 1, 1, half, joints)
        frames = joint_frames(chain, joints[:, VALUE])
        carrier = int(random.integers(0, chain.n))
        still = int(random.integers(-1, carrier))
        solid, _ = random_solid(random, KINDS[case % len(KINDS)], random_transform(random, 0.2))
        middle, radius = solid.bounding_sphere()
        center = frames[carrier, :3, :3] @ middle + frames[carrier, :3, 3]
        center_tuple = (float(center[0]), float(center[1]), float(center[2]))
        moves = np.zeros((chain.n, MOVE_COLUMNS))
        bodies = np.stack([chain.joint_types, np.arange(-1, chain.n - 1)])
        displacement_bounds(
            bodies, frames, (center_tuple, radius), carrier, joints, half, every(chain.n), moves
        )
        if not np.isfinite(moves[still + 1, TWIST]):
            continue
        packed = PieceArrays.pack([solid.placed(frames[carrier])])
        columns = np.ascontiguousarray(packed.vertices.T)
        size = (solid.radius, solid.half_height, solid.offset_radius)
        base = np.eye(4) if still < 0 else frames[still]
        points = points_of(solid) @ solid.T_owner_piece[:3, :3].T + solid.T_owner_piece[:3, 3]
        placed = []
        for time in np.linspace(max(at - half, 0.0), min(at + half, motion.duration), 41):
            then = joint_frames(chain, motion.sample([time])[0])
            seen = np.eye(4) if still < 0 else then[still]
            T = base @ np.linalg.inv(seen) @ then[carrier]
            placed.append(points @ T[:3, :3].T + T[:3, 3])
        for towards in random.normal(size=(8, 3)):
            u = towards / np.linalg.norm(towards)
            way = (center_tuple, moves, still + 1, half)
            found = lowest(
                int(solid.kind), size, columns, (0, len(packed.vertices)), packed.poses, 0,
                (u[0], u[1], u[2]), way,
            )  # fmt: skip
            true = min(float((place @ u).min()) for place in placed) - solid.offset_radius
            assert found <= true + 1e-12
            looked += 1
    assert looked > 50


def test_to_second_order_a_bound_is_sharp_where_the_motion_turns_back() -> None:
    """An arm that swings up to the vertical: its lowest height is that in the middle."""
    frames, bodies = np.eye(4)[None].copy(), np.array([[0], [-1]])
    tip = Piece(PieceKind.POLYTOPE, transform(None, [1.0, 0.0, 0.0]), np.zeros((1, 3)))
    packed = PieceArrays.pack([tip])
    columns = np.ascontiguousarray(packed.vertices.T)
    for half in (1e-1, 1e-2, 1e-3):
        joints, moves = np.empty((1, JOINT_COLUMNS)), np.zeros((1, MOVE_COLUMNS))
        enclose(np.array([[-2.0 * half, 2.0]]), half, half, np.empty((2, 2)), joints)
        displacement_bounds(
            bodies, frames, ((1.0, 0.0, 0.0), 0.0), 0, joints, half, every(1), moves
        )
        way = ((1.0, 0.0, 0.0), moves, 0, half)
        size = (0.0, 0.0, 0.0)
        # Towards the axis it comes nearer than 1 m at no time, away from it by a half 4 h^2.
        inwards = lowest(0, size, columns, (0, 1), packed.poses, 0, (1.0, 0.0, 0.0), way)
        outwards = lowest(0, size, columns, (0, 1), packed.poses, 0, (-1.0, 0.0, 0.0), way)
        assert outwards == pytest.approx(-1.0, abs=2.0 * half**3)
        assert inwards == pytest.approx(np.cos(2.0 * half), abs=2.0 * half**3)
        assert displacement_along(moves, 0, 0.0, half, (1.0, 0.0, 0.0)) >= 2.0 * half**2


def test_rows_that_nobody_asks_for_prove_nothing() -> None:
    chain, random = builtin("panda").chain, np.random.default_rng(17)
    motion = random_motion(random, chain.n, 1, 0.0)
    half = 0.05 * motion.duration
    joints = np.empty((chain.n, JOINT_COLUMNS))
    enclose(motion.coefficients[0], 2.0 * half, half, np.empty((2, 6)), joints)
    frames = joint_frames(chain, joints[:, VALUE])
    bodies = np.stack([chain.joint_types, np.arange(-1, chain.n - 1)])
    ball, u = ((0.3, 0.2, 0.5), 0.1), (0.6, 0.0, 0.8)
    whole, part = np.zeros((2, chain.n, MOVE_COLUMNS))
    displacement_bounds(bodies, frames, ball, 6, joints, half, every(chain.n), whole)
    asked = np.arange(chain.n) % 2 == 0
    part[:] = np.nan
    displacement_bounds(bodies, frames, ball, 6, joints, half, asked, part)
    np.testing.assert_array_equal(part[asked], whole[asked])
    assert (part[~asked][:, [MOVED, BEND, TWIST]] == np.inf).all()
    for row in np.flatnonzero(~asked):
        assert not displacement_along(part, int(row), 0.1, half, u) < np.inf
