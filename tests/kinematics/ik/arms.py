"""Arms and poses that the tests of inverse kinematics share."""

import dataclasses

import numpy as np

from kinematics.arrays import Array
from kinematics.ik.numeric.numeric import SearchOptions, solve
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain, Limits, Link
from kinematics.pose import from_axis_angle, inverse, rotation_x, rotation_z, transform
from tests.kinematics.samples import random_rotation

GENERAL = (
    "spherical",
    "spherical, axes 1 and 2 meet",
    "spherical, axes 1 and 2 parallel",
    "spherical, axes 2 and 3 parallel",
    "spherical, axes 2 and 3 antiparallel",
    "three parallel, axes 5 and 6 meet",
    "three parallel",
)


def edge_configuration(chain: Chain, rng: np.random.Generator, kind: int) -> Array:
    """Joints at limits, at zero, at multiples of 45 or 90 degrees, or some of each."""
    lower, upper = chain.sampling_bounds()
    q = rng.uniform(lower, upper)
    half = rng.random(chain.n) < 0.5
    match kind % 5:
        case 0:
            q = np.round(q / (np.pi / 4)) * (np.pi / 4)
        case 1:
            q = np.where(half, np.where(rng.random(chain.n) < 0.5, lower, upper), q)
        case 2:
            q = np.where(rng.random(chain.n) < 0.6, 0.0, q)
        case 3:
            q = rng.integers(-2, 3, chain.n) * np.pi / 2 * half
        case _:
            edges = np.array([lower, upper, 0.0 * q, np.round(q / (np.pi / 2)) * np.pi / 2])
            q = np.where(half, q, edges[rng.integers(0, 4, chain.n), np.arange(chain.n)])
    return np.array(np.clip(q, lower, upper))


def general_arm(rng: np.random.Generator, kind: str) -> Chain:
    """Six revolute joints, random but for what ``kind`` says."""
    A = [transform(random_rotation(rng), rng.uniform(-0.5, 0.5, 3)) for _ in range(6)]
    about = rotation_z(rng.uniform(-3, 3))
    if kind.startswith("spherical"):
        A[4], A[5] = transform(A[4][:3, :3]), transform(A[5][:3, :3])
    else:
        A[2] = transform(about, A[2][:3, 3])
        A[3] = transform(rotation_z(rng.uniform(-3, 3)), A[3][:3, 3])
    if kind.endswith("1 and 2 meet"):
        A[1] = transform(A[1][:3, :3])
    if kind.endswith("1 and 2 parallel"):
        A[1] = transform(about, A[1][:3, 3])
    if kind.endswith("2 and 3 parallel"):
        A[2] = transform(about, A[2][:3, 3])
    if kind.endswith("antiparallel"):
        A[2] = transform(rotation_x(np.pi) @ about, A[2][:3, 3])
    if kind.endswith("5 and 6 meet"):
        A[5] = transform(A[5][:3, :3])
    return arm_of(A, transform(random_rotation(rng), rng.uniform(-0.3, 0.3, 3)))


def arm_of(offsets: list[Array], tip: Array) -> Chain:
    """A chain of revolute joints without limits."""
    n = len(offsets)
    return Chain(
        name="arm",
        joint_names=tuple(f"joint_{i}" for i in range(n)),
        joint_types=np.zeros(n, dtype=np.int64),
        offsets=np.array(offsets),
        links=(Link("base", -1, np.eye(4)), Link("tip", n - 1, tip)),
        base_link="base",
        tip_link="tip",
        limits=Limits.unlimited(n),
        continuous=np.ones(n, dtype=np.bool_),
    )


def reversed_arm(chain: Chain) -> Chain:
    """The same arm from its tip to its base; its pose is the inverse at -q backwards."""
    offsets = [inverse(chain.tip.T_joint_link), *(inverse(A) for A in chain.offsets[:0:-1])]
    return arm_of(offsets, inverse(chain.offsets[0]))


def calibrated(chain: Chain, size: float, rng: np.random.Generator) -> Chain:
    """The arm with every axis moved by up to ``size`` [m] and [rad], without limits but a turn."""
    offsets = []
    for A in chain.offsets:
        shift, axis = rng.normal(size=(2, 3))
        turn = from_axis_angle(axis, size * float(rng.uniform()))
        offsets.append(A @ transform(turn, size * rng.uniform() * shift / np.linalg.norm(shift)))
    one_turn = np.full(chain.n, np.pi)
    limits = dataclasses.replace(chain.limits, lower=-one_turn, upper=one_turn)
    return dataclasses.replace(chain, offsets=np.array(offsets), limits=limits)


def apart(a: Array, b: Array) -> Array:
    """Largest difference of angles, whole turns aside, over the last axis."""
    return np.asarray(np.abs((a - b + np.pi) % (2 * np.pi) - np.pi).max(axis=-1))


def random_joints(chain: Chain, count: int, seed: int) -> Array:
    """Configurations inside the limits, shape (count, n)."""
    lower, upper = chain.sampling_bounds()
    return np.random.default_rng(seed).uniform(lower, upper, (count, chain.n))


def searched(chain: Chain, T: Array, found: Array, seed: int) -> int:
    """Count what search finds of a pose away from singularities, all of it among those found."""
    search = solve(chain, T, SearchOptions(seed=seed, starts=60), solutions=16).solutions
    joints = [solution.joints for solution in search]
    least = [np.linalg.svd(geometric(chain, q), compute_uv=False)[-1] for q in joints]
    regular = [q for q, value in zip(joints, least, strict=True) if value >= 1e-2]
    assert all(apart(found, q).min() < 1e-3 for q in regular)
    return len(regular)
