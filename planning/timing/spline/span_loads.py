"""Factors by which spans of a spline are too short for torques and the tool's speed.

A motion run through k times as slowly has 1/k of its tool's speed, and of its torques

    tau = g + (tau - g) / k^2,

but for the viscous friction, of which 1/k is left. Looked at are places in each span: what is found
makes spans longer where loads bind, and promises nothing.
"""

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from compiled.kernel import kernel
from dynamics.kernels.recursion import WORK, gravity_kernel, inverse_kernel
from dynamics.model.body import bodies
from kinematics.arrays import Array, frozen
from kinematics.jacobian import frame_and_jacobian_kernel
from planning.values.limits import EffortLimits


class SpanLoads(NamedTuple):
    """Limits of torques and of the tool's speed as kernels take them.

    Args:
        model: ``Chain.model`` of the robot.
        tool: 1 / the largest speed of the tip's origin; 0 for no limit [s/m].
        rows: Rows of the bodies with all that it carries; without a limit no bodies, shape (0, c).
        torques: Limits, inf where there is none, shape (n,) or (0,) [N m or N].
    """

    model: Array
    tool: float
    rows: Array
    torques: Array


@cache
def no_loads() -> SpanLoads:
    """No limits."""
    rows = np.zeros((0, 0))
    # Columns of ``Chain.model``, and of the rows of bodies.
    return SpanLoads(frozen(np.zeros((1, 14))), 0.0, frozen(rows), frozen(np.zeros(0)))


def span_loads(loads: EffortLimits) -> SpanLoads:
    """Limits of loads as kernels take them."""
    none = no_loads()
    tool = 0.0 if loads.tool_speed is None else 1.0 / loads.tool_speed
    if loads.effort is None:
        return none._replace(model=loads.chain.model, tool=tool)
    rows = bodies(loads.chain).rows
    # The torques aimed at are this much below the limits: what is bounded with an error of a
    # thousandth is within them.
    torques = frozen(loads.effort * (1.0 - 2e-3))
    return SpanLoads(loads.chain.model, tool, rows, torques)


class SpanMemory(NamedTuple):
    """Room for a place of a span.

    Args:
        state: Position, velocity, acceleration, torque and torque at rest, shape (5, n).
        J: Shape (6, n).
        work: Memory of inverse dynamics, shape (n, 11).
    """

    state: Array
    J: Array
    work: Array


@kernel
def span_memory(n: int) -> SpanMemory:
    """Room for places of n joints."""
    # Rows of room for places: positions, velocities, accelerations, torques, those at rest.
    return SpanMemory(np.empty((5, n)), np.empty((6, n)), np.empty((n, WORK)))


@kernel(allocates=False)
def widen_for_loads_kernel(
    pieces: Array, spans: Array, loads: SpanLoads, places: int, room: SpanMemory, excess: Array
) -> None:
    """Raise ``excess`` (N,) to the factors by which spans are too short for loads.

    Args:
        pieces: Ascending powers of the time in the span, shape (N, k, >= n).
        spans: Shape (>= N,) [s].
        loads: The limits.
        places: Places in each span that are checked, its ends among them.
        room: Room of ``span_memory``.
        excess: Changed.
    """
    for i in range(excess.shape[0]):
        # The last place of a span is the first one of the next.
        for place in range(places - 1):
            _write_state(pieces[i], spans[i] * place / (places - 1), room.state)
            ratio = 0.0
            if loads.tool > 0.0:
                ratio = loads.tool * _tool_speed(loads.model, room)
            if loads.torques.shape[0] > 0:
                ratio = max(ratio, _torque_factor(loads, room))
            excess[i] = max(excess[i], ratio)
            if place == 0 and i > 0:
                excess[i - 1] = max(excess[i - 1], ratio)


@kernel(allocates=False)
def _write_state(piece: Array, t: float, state: Array) -> None:
    """Write position, velocity and acceleration of a piece (k, >= n) at a time."""
    degree = piece.shape[0] - 1
    for joint in range(state.shape[1]):
        q, v, a = piece[degree, joint], 0.0, 0.0
        for k in range(degree - 1, -1, -1):
            a = a * t + 2.0 * v
            v = v * t + q
            q = q * t + piece[k, joint]
        state[0, joint], state[1, joint], state[2, joint] = q, v, a


@kernel(allocates=False)
def _tool_speed(model: Array, room: SpanMemory) -> float:
    """Speed of the tip's origin [m/s]."""
    frame_and_jacobian_kernel(model, room.state[0], -1, room.J)
    square = 0.0
    for row in range(3):
        total = 0.0
        for joint in range(room.J.shape[1]):
            total += room.J[row, joint] * room.state[1, joint]
        square += total * total
    return math.sqrt(square)


@kernel(allocates=False)
def _torque_factor(loads: SpanLoads, room: SpanMemory) -> float:
    """Factor by which the motion is to be slower for its torques."""
    state = room.state
    inverse_kernel(loads.rows, state[0], state[1], state[2], room.work, state[3])
    gravity_kernel(loads.rows, state[0], room.work, state[4])
    square = 0.0
    for joint in range(state.shape[1]):
        limit, still = loads.torques[joint], state[4, joint]
        moving = state[3, joint] - still
        left = limit - still if moving > 0.0 else limit + still
        # A torque that holds the robot still and leaves less than this part of its limit binds no
        # motion: slower ones need as much.
        square = max(square, abs(moving) / max(left, 1e-3 * limit))
    return math.sqrt(square)
