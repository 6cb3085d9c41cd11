"""The CasADi expressions equal the kernels, and their Jacobian equals automatic derivatives."""

import casadi
import numpy as np
import pytest

from kinematics.errors import InvalidLinkName, InvalidOption, InvalidRobotState
from kinematics.forward import joint_frames
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain, builtin_names
from kinematics.symbolic import (
    symbolic_frames,
    symbolic_jacobian,
)
from tests.dynamics.samples import random_chain, random_state

CHAINS = [
    *(random_chain(seed, 1 + seed) for seed in range(8)),
    *(builtin_chain(name) for name in builtin_names()),
]


def ids(chain: object) -> str:
    return getattr(chain, "name", "")


@pytest.mark.parametrize("chain", CHAINS, ids=ids)
def test_equals_the_kernels_for_every_link(chain: Chain) -> None:
    symbols = casadi.SX.sym("q", chain.n)
    for link in chain.index:
        jacobian = casadi.Function("J", [symbols], [symbolic_jacobian(chain, symbols, link)])
        for q in random_state(chain, 1, 10)[0]:
            J = np.array(jacobian(q))
            np.testing.assert_allclose(J, geometric(chain, q, link), atol=1e-12, rtol=0)


@pytest.mark.parametrize("chain", CHAINS, ids=ids)
def test_frames_are_those_of_the_joints(chain: Chain) -> None:
    q = casadi.SX.sym("q", chain.n)
    frames = casadi.Function("frames", [q], symbolic_frames(chain, q))
    for value in random_state(chain, 2, 5)[0]:
        got = frames(value) if chain.n > 1 else [frames(value)]
        np.testing.assert_allclose(
            np.array([np.array(T) for T in got]), joint_frames(chain, value), atol=1e-12, rtol=0
        )


@pytest.mark.parametrize("chain", CHAINS, ids=ids)
def test_jacobian_is_the_derivative_of_the_pose(chain: Chain) -> None:
    q = casadi.SX.sym("q", chain.n)
    point = np.array([0.1, -0.2, 0.3])
    T = symbolic_frames(chain, q)[-1] @ casadi.DM(chain.link(chain.tip_link).T_joint_link)
    p = T[:3, :3] @ casadi.DM(point) + T[:3, 3]
    columns = []
    for j in range(chain.n):
        S = casadi.reshape(casadi.jacobian(casadi.vec(T[:3, :3]), q[j]), 3, 3) @ T[:3, :3].T
        columns.append(casadi.vertcat(S[2, 1], S[0, 2], S[1, 0]))
    derived = casadi.vertcat(casadi.jacobian(p, q), casadi.horzcat(*columns))
    both = casadi.Function("both", [q], [derived, symbolic_jacobian(chain, q, point=point)])
    for value in random_state(chain, 3, 5)[0]:
        automatic, by_rule = (np.array(J) for J in both(value))
        np.testing.assert_allclose(by_rule, automatic, atol=1e-12, rtol=0)
        np.testing.assert_allclose(
            by_rule, geometric(chain, value, point=point), atol=1e-12, rtol=0
        )


def test_matrix_expressions_serve_as_well() -> None:
    chain = random_chain(5, 5)
    q = casadi.MX.sym("q", chain.n)
    both = casadi.Function("f", [q], [symbolic_frames(chain, q)[-1], symbolic_jacobian(chain, q)])
    value = random_state(chain, 4, 1)[0][0]
    T, J = both(value)
    last = joint_frames(chain, value)[-1]
    np.testing.assert_allclose(np.array(T), last, atol=1e-12, rtol=0)
    np.testing.assert_allclose(np.array(J), geometric(chain, value), atol=1e-12, rtol=0)


def test_faults_are_named() -> None:
    chain = random_chain(0, 3)
    with pytest.raises(InvalidRobotState, match="3 joints"):
        symbolic_frames(chain, casadi.SX.sym("q", 2))
    with pytest.raises(InvalidLinkName, match="no link 'nowhere'"):
        symbolic_jacobian(chain, casadi.SX.sym("q", 3), "nowhere")
    with pytest.raises(InvalidOption, match="point"):
        symbolic_jacobian(chain, casadi.SX.sym("q", 3), point=[0.0, np.nan, 0.0])
