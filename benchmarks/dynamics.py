"""Dynamics against pinocchio, in the same run: microseconds a state, one by one and in batch.

Run it with `python -m benchmarks.dynamics`. Both are called from Python with float64 arrays that
are there already. Pinocchio answers references to arrays of its own; the functions of the package
check the state and answer a new array. In batch one call computes many states; pinocchio, which has
no such call, is called in a loop. Rounds alternate between the two, and the least processor time of
each counts.
"""

import argparse
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin

from benchmarks.rounds import rounds
from dynamics.forward import forward_dynamics
from dynamics.inverse import inverse_dynamics
from dynamics.parameters.regressor import regressor
from dynamics.terms import coriolis_matrix, gravity_vector, mass_matrix
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain, builtin_urdf

ROUNDS, STATES = 25, 1000
#: Number of calls in a turn.
CALLS = {"pinocchio": 2000, "checked": 500, "batch": 2}

Call = Callable[[], Any]


def rows(chain: Chain, model: Any, states: Array) -> dict[str, dict[str, Call]]:
    """Calls of all quantities, at the first of the states (3, m, n) and at all of them."""
    data = model.createData()
    one = [part[0].copy() for part in states]
    # Of each quantity pinocchio's function and ours, and how many of q, q_dot, q_ddot it takes.
    pairs: dict[str, tuple[Callable[..., object], Callable[..., object], int]] = {
        "mass matrix": (pin.crba, mass_matrix, 1),
        "inverse (RNEA)": (pin.rnea, inverse_dynamics, 3),
        "Coriolis matrix": (pin.computeCoriolisMatrix, coriolis_matrix, 2),
        "gravity": (pin.computeGeneralizedGravity, gravity_vector, 1),
        "regressor": (pin.computeJointTorqueRegressor, partial(regressor, motors=False), 3),
        "forward": (pin.aba, forward_dynamics, 3),
    }
    return {
        name: {
            "pinocchio": partial(theirs, model, data, *one[:count]),
            "checked": partial(ours, chain, *one[:count]),
            "batch": partial(ours, chain, *states[:count]),
        }
        for name, (theirs, ours, count) in pairs.items()
    }


def compare(name: str) -> None:
    """Print the table of one built-in robot without endless joints."""
    chain = builtin_chain(name)
    model = pin.buildModelFromXML(builtin_urdf(name))
    states = np.random.default_rng(0).uniform(-2.0, 2.0, (3, STATES, chain.n))
    print(f"{name}: us a state           one call                       batch of {STATES}")
    print("                  pinocchio  checked     ours   pinocchio / ours")
    for quantity, row in rows(chain, model, states).items():
        one, checked, batch = (spent.min() for spent in rounds(row, ROUNDS, CALLS).values())
        each = batch / STATES
        print(f"  {quantity:16s}{one:9.2f}{checked:9.2f}{each:12.3f}{one / each:12.1f}")


def main() -> None:
    """Compare on some robots."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("robots", nargs="*", default=["panda", "ur5e"])
    for name in parser.parse_args().robots:
        compare(name)


if __name__ == "__main__":
    main()
