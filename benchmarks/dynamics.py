"""Dynamics against pinocchio, in the same run: microseconds a state, one by one and in batch.

Run it with `python -m benchmarks.dynamics`. Both are called from Python with float64 arrays that
are there already. Pinocchio answers references to arrays of its own; the functions of the package
check the state and answer a new array. In batch one call computes many states; pinocchio, which has
no such call, is called in a loop. Rounds alternate between the two, and the best of each counts.
"""

import argparse
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from dynamics.forward import forward_dynamics
from dynamics.inverse import inverse_dynamics
from dynamics.parameters.regressor import regressor
from dynamics.terms import coriolis_matrix, gravity_vector, mass_matrix
from kinematics.arrays import Array
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain, builtin_urdf

ROUNDS, CALLS, STATES = 25, 2000, 1000

Call = Callable[[], Any]


class Row(NamedTuple):
    """Ways to compute one quantity: pinocchio, ours for one state, ours in batch."""

    pinocchio: Call
    checked: Call
    batch: Call


def best(calls: Mapping[str, tuple[Call, int]]) -> dict[str, float]:
    """The best time of each call over all rounds [us]; each round runs every one of them."""
    times = dict.fromkeys(calls, np.inf)
    for call, _ in calls.values():
        call()
    for _ in range(ROUNDS):
        for name, (call, count) in calls.items():
            start = time.perf_counter()
            for _ in range(count):
                call()
            times[name] = min(times[name], (time.perf_counter() - start) / count * 1e6)
    return times


def rows(chain: Chain, model: Any, states: Array) -> dict[str, Row]:
    """All quantities, at the first of the states (3, m, n) and at all of them."""
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
        name: Row(
            partial(theirs, model, data, *one[:count]),
            partial(ours, chain, *one[:count]),
            partial(ours, chain, *states[:count]),
        )
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
        calls = {
            "pinocchio": (row.pinocchio, CALLS),
            "checked": (row.checked, CALLS // 4),
            "batch": (row.batch, 2),
        }
        us = best(calls)
        each = us["batch"] / STATES
        print(
            f"  {quantity:16s}{us['pinocchio']:9.2f}{us['checked']:9.2f}"
            f"{each:12.3f}{us['pinocchio'] / each:12.1f}"
        )


def main() -> None:
    """Compare on some robots."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("robots", nargs="*", default=["panda", "ur5e"])
    for name in parser.parse_args().robots:
        compare(name)


if __name__ == "__main__":
    main()
