"""Constrained inverse kinematics as a nonlinear program that IPOPT solves.

    minimise    sum_j m_j (q_j - p_j)^2 / 2  [- log w(q)]  +  sum_i w_i s_i^2 / 2
    subject to  lower <= q <= upper,  hard rows <= 0,  soft rows <= s_i,  A q <= b

with the smooth forms of the rows and A q <= b the distances of near pairs to first order. Programs
are built once for a robot and a shape of constraints (which functions of which frames); all numbers
are parameters. Source: "On the implementation of an interior-point filter line-search algorithm for
large-scale nonlinear programming", Mathematical Programming, 2006.
"""

import math
from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np

from kinematics.arrays import Array
from kinematics.caches.bounded_cache import bounded_cache
from kinematics.model.chain import Chain
from kinematics.symbolic import Expression, symbolic_frames, symbolic_jacobian
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.row import WIDTH, Row, RowKind
from planning.constraints.symbolic import smooth_row

#: Linearised distances that one program has room for.
PLANES = 32
_OPTIONS: dict[str, Any] = {
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "print_time": False,
    "ipopt.max_iter": 100,
    "ipopt.tol": 1e-9,
    "ipopt.constr_viol_tol": 1e-9,
    # IPOPT widens bounds by this by itself, which would then be told as violations.
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.honor_original_bounds": "yes",
}

#: Added to determinants, so that their logarithms are finite in singular configurations.
_SINGULAR = 1e-12
#: Processor time in which a program is built on any machine that is not worn out [s]: 15 to 90 ms
#: on most, and nothing interrupts it.
BUILDING_TIME = 0.2
#: Programs that were built, by hashes: so many are remembered.
_built: set[int] = set()

#: Function, carrier, reference and whether there is a lower bound, for each row.
Shape = tuple[tuple[RowKind, int, int, bool], ...]


@dataclass(frozen=True, slots=True, eq=False)
class Planes:
    """Linear inequalities A q <= b.

    Args:
        A: Shape (k, n), k <= PLANES.
        b: Shape (k,).
    """

    A: Array
    b: Array


@dataclass(frozen=True, slots=True, eq=False)
class Program:
    """A program of one robot and one shape of constraints.

    Args:
        chain: The robot.
        solver: CasADi's function.
        inequalities: How many there are, A's not counted.
        slacks: Soft rows.
    """

    chain: Chain
    solver: Expression
    inequalities: int
    slacks: int

    def solve(
        self,
        constraints: ConstraintSet,
        start: Array,
        posture: Array,
        metric: Array,
        planes: Planes,
    ) -> Array:
        """The configuration IPOPT ends at, converged or not, inside the joint limits, shape (n,).

        Args:
            constraints: Constraints of the program's shape.
            start: Shape (n,).
            posture: Configuration that q is kept near, shape (n,).
            metric: Weights of that, shape (n,).
            planes: Linear inequalities.
        """
        hard, soft = constraints.hard, constraints.soft
        n, used = self.chain.n, len(planes.b)
        A, b = np.zeros((PLANES, n)), np.ones(PLANES)
        A[:used], b[:used] = planes.A, planes.b
        parameters = [hard.packed, soft.packed, soft.weights, posture, metric, A, b]
        finite = [np.nan_to_num(p, posinf=1e9, neginf=-1e9).ravel() for p in parameters]
        limits, open_end = self.chain.limits, np.full(self.slacks, np.inf)
        rows = self.inequalities + PLANES
        answer = self.solver(
            x0=np.concatenate([start, np.full(self.slacks, 0.1)]),
            p=np.concatenate(finite),
            lbx=np.concatenate([limits.lower, np.zeros(self.slacks)]),
            ubx=np.concatenate([limits.upper, open_end]),
            lbg=np.full(rows, -np.inf),
            ubg=np.zeros(rows),
        )
        q = np.array(answer["x"]).ravel()[:n]
        return np.clip(np.where(np.isfinite(q), q, start), limits.lower, limits.upper)


def program(constraints: ConstraintSet, manipulability: bool = False) -> Program:
    """The program of a set's shape, kept for the next set of the same shape.

    Args:
        constraints: Hard and soft ones.
        manipulability: Whether the objective has - log w.
    """
    key = _key(constraints, manipulability)
    made = _program(*key)
    # Programs are small, and a service sees few sets of constraints: so many are stored at most.
    if len(_built) >= 1024:
        _built.clear()
    _built.add(hash(key))
    return made


def is_built(constraints: ConstraintSet, manipulability: bool = False) -> bool:
    """Whether the program of a set's shape was built in this process, and is kept as a rule.

    Args:
        constraints: Hard and soft ones.
        manipulability: Weight of the manipulability, as `program` has it.
    """
    return hash(_key(constraints, manipulability)) in _built


def _key(constraints: ConstraintSet, manipulability: bool) -> tuple[Chain, Shape, Shape, bool]:
    hard, soft = constraints.hard.rows, constraints.soft.rows
    return constraints.chain, _shape(hard), _shape(soft), manipulability


def _shape(rows: tuple[Row, ...]) -> Shape:
    return tuple((row.kind, row.carrier, row.reference, math.isfinite(row.lower)) for row in rows)


@bounded_cache(maxsize=32)
def _program(chain: Chain, hard: Shape, soft: Shape, manipulability: bool) -> Program:
    n = chain.n
    q, slack = casadi.SX.sym("q", n), casadi.SX.sym("s", len(soft))
    hard_data = casadi.SX.sym("hard", WIDTH * len(hard))
    soft_data = casadi.SX.sym("soft", WIDTH * len(soft))
    weights = casadi.SX.sym("weights", len(soft))
    posture, metric = casadi.SX.sym("posture", n), casadi.SX.sym("metric", n)
    A, b = casadi.SX.sym("A", PLANES * n), casadi.SX.sym("b", PLANES)
    frames = symbolic_frames(chain, q)
    inequalities = []
    for i, row in enumerate(hard):
        inequalities += _sides(row, hard_data[WIDTH * i : WIDTH * (i + 1)], frames, q)
    for i, row in enumerate(soft):
        sides = _sides(row, soft_data[WIDTH * i : WIDTH * (i + 1)], frames, q)
        inequalities += [side - slack[i] for side in sides]
    planes = casadi.mtimes(casadi.reshape(A, n, PLANES).T, q) - b
    cost = 0.5 * casadi.dot(metric, (q - posture) ** 2) + 0.5 * casadi.dot(weights, slack**2)
    if manipulability:
        J = symbolic_jacobian(chain, q)
        gram = casadi.mtimes(J, J.T) if n >= 6 else casadi.mtimes(J.T, J)
        cost -= 0.5 * casadi.log(_determinant(gram) + _SINGULAR)
    parameters = casadi.vertcat(hard_data, soft_data, weights, posture, metric, A, b)
    problem: dict[str, Any] = {
        "x": casadi.vertcat(q, slack),
        "p": parameters,
        "f": cost,
        "g": casadi.vertcat(*inequalities, planes),
    }
    solver = casadi.nlpsol("ik", "ipopt", problem, _OPTIONS)
    return Program(chain, solver, len(inequalities), len(soft))


def _determinant(gram: Expression) -> Expression:
    """det(G + 1e-12 I) of a symmetric matrix without negative eigenvalues, by elimination.

    By minors, as CasADi's own has it, its second derivatives are four times as many operations, and
    take as much longer to build. Added to the diagonal, the little keeps pivots from being zero.
    """
    n = gram.shape[0]
    rest = [[gram[i, j] + (_SINGULAR if i == j else 0.0) for j in range(n)] for i in range(n)]
    determinant: Expression = 1.0
    for k in range(n):
        pivot = rest[k][k]
        determinant = determinant * pivot
        for i in range(k + 1, n):
            factor = rest[i][k] / pivot
            for j in range(i, n):
                rest[i][j] = rest[j][i] = rest[i][j] - factor * rest[k][j]
    return determinant


def _sides(
    row: tuple[RowKind, int, int, bool], data: Expression, frames: list[Expression], q: Expression
) -> list[Expression]:
    """Expressions that are at most 0 where a row holds."""
    kind, carrier, reference, both = row
    smooth = smooth_row(kind, carrier, reference, data, frames, q)
    if kind in {RowKind.ANGLE, RowKind.LOOK}:
        return [smooth.lower - smooth.expression]
    above = smooth.expression - smooth.upper
    return [above, smooth.lower - smooth.expression] if both else [above]
