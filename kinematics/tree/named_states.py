"""Named configurations of a chain, as the states of an SRDF give them."""

from collections.abc import Mapping

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidRobotState
from kinematics.model.chain import Chain
from kinematics.tree.srdf import Semantics

#: What plans move onto a limit without being asked is not worth a note [rad or m].
_TOLERANCE = 1e-6


def named_states(chain: Chain, semantics: Semantics) -> tuple[dict[str, Array], list[str]]:
    """States of an SRDF that name every joint of a chain, and a note on those that name a part.

    A state goes by its name; where several groups have one of that name, those after the first
    go by "group/name".

    Args:
        chain: The robot.
        semantics: SRDF of the robot.
    """
    states: dict[str, Array] = {}
    lint = []
    for group, named in semantics.states.items():
        for name, values in named.items():
            missing = [joint for joint in chain.joint_names if joint not in values]
            if len(missing) == chain.n:
                continue
            if missing:
                lint.append(
                    f"state {name!r} of group {group!r} in the SRDF does not name "
                    f"{', '.join(missing)}: it is not offered"
                )
                continue
            key = f"{group}/{name}" if name in states else name
            states[key] = np.array([values[joint] for joint in chain.joint_names])
            lint += _outside(chain, states[key], key)
    return states, lint


def _outside(chain: Chain, q: Array, name: str) -> list[str]:
    """A note on the joints (n,) of a state that are outside their limits."""
    low, high = chain.limits.lower, chain.limits.upper
    beyond = [
        f"{joint} at {value:.6g}, limits {lower:.6g} to {upper:.6g}"
        for joint, value, lower, upper in zip(chain.joint_names, q, low, high, strict=True)
        if not lower - _TOLERANCE <= value <= upper + _TOLERANCE
    ]
    return [f"state {name!r} of the SRDF has {'; '.join(beyond)}"] if beyond else []


def state(states: Mapping[str, Array], name: str, where: str) -> Array:
    """The configuration of a state, shape (n,) [rad or m].

    Args:
        states: States by name.
        name: Name of the state.
        where: The field that names it.

    Raises:
        InvalidRobotState: There is no such state.
    """
    if name not in states:
        raise InvalidRobotState(
            f"{where}: the robot has no state {name!r}",
            hint=f"Its states are: {', '.join(states) or 'none; send an SRDF that has them'}.",
            states=list(states),
        )
    return states[name]
