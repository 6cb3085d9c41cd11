"""Kinematics and equations of motion of a table in symbols, as the course notes define them.

D = sum_i m_i J_vi^T J_vi + J_wi^T R_i I_i R_i^T J_wi,   J_vi = d r_i / d q
c_ijk = (d_kj,i + d_ki,j - d_ij,k) / 2,   C_kj = sum_i c_ijk q_dot_i
U = -sum_i m_i g . r_i,   G = grad U
"""

from dataclasses import dataclass

import numpy as np

from dynamics.equations.polynomial import (
    Polynomial,
    Polynomials,
    TooManyTerms,
    constant,
    matrix,
)
from dynamics.equations.table import SymbolicBody, SymbolicTable

#: Terms of an entry of the mass matrix, its angles as exponentials: arms of six joints with a
#: spherical wrist have 800, and their C is 150 kB long. Beyond that nobody reads it.
MAX_ENTRY_TERMS = 2_000
#: Joints of arms that have formulas of their dynamics.
MAX_JOINTS = 6


@dataclass(frozen=True, slots=True, eq=False)
class SymbolicMotion:
    """The terms of (D + J) q_ddot + C q_dot + B q_dot + F f + G = tau (n joints).

    Args:
        mass_matrix: D, n x n.
        christoffel_symbols: c_ijk at [i, j, k], n x n x n.
        coriolis_matrix: C, n x n.
        potential_energy: U [J], 0 where all masses lie at the origin of frame 0.
        gravity: G, (n,) [N m or N].
        torques: tau, with motor inertias J, viscous friction B and dry friction F where the robot
            has them; f = tanh(q_dot / v). (n,) [N m or N].
    """

    mass_matrix: Polynomials
    christoffel_symbols: Polynomials
    coriolis_matrix: Polynomials
    potential_energy: Polynomial
    gravity: Polynomials
    torques: Polynomials


def tool_frame(table: SymbolicTable) -> Polynomials:
    """Pose of the tool in the base frame, base H_1 ... H_n tool, 4 x 4."""
    frame: Polynomials = table.base @ table.frames[-1] @ table.tool
    return frame


def tool_jacobian(table: SymbolicTable) -> Polynomials:
    """Geometric Jacobian of the tool's origin in the base frame, 6 x n, linear rows first."""
    point = (table.frames[-1] @ table.tool)[:3, 3]
    J, R = jacobian(table, point, table.n - 1), table.base[:3, :3]
    return np.vstack([R @ J[:3], R @ J[3:]])


def jacobian(table: SymbolicTable, position: Polynomials, joint: int) -> Polynomials:
    """Geometric Jacobian of a point in frame 0, 6 x n, linear rows first.

    Args:
        table: The robot.
        position: The point in frame 0, (3,) [m].
        joint: Number of the joint, from 0, that carries the point.
    """
    last, axes, J = joint, _axes(table), _zeros(6, table.n)
    for j in range(last + 1):
        for k in range(3):
            J[k, j] = table.variables.derivative(position[k], table.joints[j])
        if table.table.rows[j].type == "revolute":
            J[3:, j] = axes[j]
    return J


def equations_of_motion(table: SymbolicTable) -> SymbolicMotion:
    """All terms of the equations of motion.

    Args:
        table: The robot; rows without a mass are massless.

    Raises:
        TooManyTerms: A formula would be too long to be read.
    """
    if table.n > MAX_JOINTS:
        raise TooManyTerms
    frames = table.frames[1:]
    D, U = _zeros(table.n, table.n), constant(0.0)
    for i, body in enumerate(table.bodies):
        if body is None:
            continue
        R = frames[i][:3, :3]
        r = R @ body.center + frames[i][:3, 3]
        D = D + _body_mass_matrix(table, body, R, jacobian(table, r, i))
        U = U - (table.gravity @ r) * body.mass
    if max(len(entry.terms) for row in D.tolist() for entry in row) > MAX_ENTRY_TERMS:
        raise TooManyTerms
    return _terms(table, D, U)


def _body_mass_matrix(
    table: SymbolicTable, body: SymbolicBody, R: Polynomials, J: Polynomials
) -> Polynomials:
    """The part of one body, with frame R and the Jacobian J of its centre of mass, in D."""
    Jv, turned = J[:3], R.T @ J[3:]
    part: Polynomials = (Jv.T @ Jv) * body.mass + turned.T @ body.tensor @ turned
    assert part.shape == (table.n, table.n)
    return part


def _terms(table: SymbolicTable, D: Polynomials, U: Polynomial) -> SymbolicMotion:
    n, variables, joints = table.n, table.variables, table.joints
    partial = [[[variables.derivative(D[i, j], q) for q in joints] for j in range(n)]
               for i in range(n)]  # fmt: skip
    symbols = np.empty((n, n, n), dtype=np.object_)
    for i, j, k in np.ndindex(n, n, n):
        symbols[i, j, k] = (partial[k][j][i] + partial[k][i][j] - partial[i][j][k]) * 0.5
    rates = [variables.symbol(f"qd_{i}") for i in range(1, n + 1)]
    C = _zeros(n, n)
    for i, j, k in np.ndindex(n, n, n):
        C[k, j] = C[k, j] + symbols[i, j, k] * rates[i]
    G = matrix([[variables.derivative(U, q)] for q in joints])[:, 0]
    qd = matrix([[rate] for rate in rates])[:, 0]
    qdd = matrix([[variables.symbol(f"qdd_{i}")] for i in range(1, n + 1)])[:, 0]
    return SymbolicMotion(D, symbols, C, U, G, D @ qdd + C @ qd + G + _drive_torques(table))


def _drive_torques(table: SymbolicTable) -> Polynomials:
    """J q_ddot + B q_dot + F f of motors and friction, with f = tanh(q_dot / v), (n,)."""
    variables = table.variables
    torques = _zeros(table.n, 1)[:, 0]
    for i in range(1, table.n + 1):
        for letter, rate in (("J", f"qdd_{i}"), ("B", f"qd_{i}"), ("F", f"f_{i}")):
            if f"{letter}_{i}" in variables.names:
                part = variables.symbol(f"{letter}_{i}") * variables.symbol(rate)
                torques[i - 1] = torques[i - 1] + part
    return torques


def _axes(table: SymbolicTable) -> list[Polynomials]:
    """Axes of the joints in frame 0, each (3,)."""
    frames = table.frames
    standard = table.table.convention == "standard"
    return [frames[j if standard else j + 1][:3, 2] for j in range(table.n)]


def _zeros(rows: int, columns: int) -> Polynomials:
    return matrix([[0.0] * columns for _ in range(rows)])
