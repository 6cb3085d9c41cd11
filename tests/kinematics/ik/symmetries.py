"""What the branches of any six-joint arm have in common, whatever form solves it."""

import numpy as np

from kinematics.arrays import Array
from kinematics.forward import forward, joint_frames
from kinematics.ik.closed_form.analytic import Branches, branches
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain


def wrapped(q: Array | float) -> Array:
    """Angles without whole turns, in (-pi, pi]."""
    return np.asarray(np.pi - (np.pi - q) % (2.0 * np.pi))


def distance(one: Array, other: Array) -> float:
    """Hausdorff distance of two sets of configurations, whole turns aside; inf for sizes."""
    if len(one) != len(other):
        return float("inf")
    if not len(one):
        return 0.0
    away = np.abs(wrapped(one[:, None] - other[None])).max(axis=-1)
    return float(max(away.min(axis=0).max(), away.min(axis=1).max()))


def determinants(chain: Chain, q: Array) -> Array:
    """Determinants of the Jacobians of configurations (k, 6), shape (k,)."""
    return np.linalg.det(geometric(chain, q)) if len(q) else np.zeros(0)


def regular(chain: Chain, q: Array, least: float = 1e-2) -> bool:
    """Whether a configuration is well away from every singularity."""
    return float(np.linalg.svd(geometric(chain, q), compute_uv=False)[-1]) > least


def labels(table: Branches) -> list[str]:
    """Names of all branches of a pose."""
    return [table.label(i) for i in range(len(table.table))]


def product_of_signs(label: str) -> int:
    """The product of the signs in a branch's name."""
    return -1 if label.count("-") % 2 else 1


def regular_cases(chain: Chain, seed: int, count: int) -> list[tuple[Array, Array, Branches]]:
    """Configurations whose pose has only regular branches: q, pose, its branches."""
    rng = np.random.default_rng(seed)
    cases: list[tuple[Array, Array, Branches]] = []
    for _ in range(100 * count):
        if len(cases) == count:
            break
        q = rng.uniform(-np.pi, np.pi, chain.n)
        T = forward(chain, q)
        table = branches(chain, T, seed_joints=q)
        if all(regular(chain, row) for row in [q, *table.joints]):
            cases.append((q, T, table))
    assert len(cases) == count, "too few poses of this arm are regular"
    return cases


def first_lever(chain: Chain, q: Array, joint: int) -> float:
    """How fast joint 1 moves the origin of a joint along axis 2, (z_1 x z_2) . (o - o_1)."""
    frames = joint_frames(chain, q)
    across = np.cross(frames[0, :3, 2], frames[1, :3, 2])
    return float(across @ (frames[joint, :3, 3] - frames[0, :3, 3]))
