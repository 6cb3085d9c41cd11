"""Derivatives of D and U by CasADi, straight from their definitions in the lecture notes."""

from typing import Any

import casadi
import numpy as np

from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.symbolic import symbolic_frames


def symbolic_mass_matrix(chain: Chain, q: Any) -> tuple[Any, Any]:
    """D(q) from the partial Jacobians by automatic derivatives, and U(q), link by link."""
    frames = symbolic_frames(chain, q)
    D, U = casadi.SX(chain.n, chain.n), casadi.SX(0)
    for link in chain.links:
        if link.joint < 0 or link.inertia is None:
            continue
        T = casadi.mtimes(frames[link.joint], link.T_joint_link)
        R = T[:3, :3]
        r = R @ casadi.DM(link.inertia.center_of_mass) + T[:3, 3]
        Jv = casadi.jacobian(r, q)
        columns = []
        for j in range(chain.n):
            S = casadi.reshape(casadi.jacobian(casadi.vec(R), q[j]), 3, 3) @ R.T
            columns.append(casadi.vertcat(S[2, 1], S[0, 2], S[1, 0]))
        Jw = casadi.horzcat(*columns)
        I = R @ casadi.DM(link.inertia.tensor) @ R.T  # noqa: E741
        D += link.inertia.mass * Jv.T @ Jv + Jw.T @ I @ Jw
        U -= link.inertia.mass * casadi.dot(casadi.DM(chain.gravity), r)
    return D, U


def christoffel_function(chain: Chain) -> Any:
    """(q, q_dot) -> D, D_dot, C by c_ijk = (d_kj,i + d_ki,j - d_ij,k) / 2, U, grad U."""
    n = chain.n
    q, qd = casadi.SX.sym("q", n), casadi.SX.sym("qd", n)
    D, U = symbolic_mass_matrix(chain, q)
    partial = [casadi.reshape(casadi.jacobian(casadi.vec(D), q[i]), n, n) for i in range(n)]
    D_dot, C = casadi.SX(n, n), casadi.SX(n, n)
    for i in range(n):
        D_dot += partial[i] * qd[i]
        for j in range(n):
            for k in range(n):
                c = partial[i][k, j] + partial[j][k, i] - partial[k][i, j]
                C[k, j] += 0.5 * c * qd[i]
    return casadi.Function("christoffel", [q, qd], [D, D_dot, C, U, casadi.gradient(U, q)])


def relative_error(value: Array, reference: Array) -> float:
    """Largest difference over the largest entry of the reference."""
    scale = float(np.abs(reference).max())
    return float(np.abs(value - reference).max()) / (scale if scale > 0.0 else 1.0)
