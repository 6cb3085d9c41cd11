"""Lies about stops: what the gate looks at before it proves, and how stops are made."""

from collections.abc import Callable
from typing import Any

import numpy as np

from kinematics.arrays import Array
from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from planning.guard import gate
from planning.guard.faults import Look, look_at, sound_stops
from planning.stops.braking import BrakingLimits
from planning.stops.path_stops import PathCells, path_stop
from planning.stops.stop_family import braking_motion, joint_stop, state_at
from tests.planning.proof.sabotage.trial import Lie, Sabotage

#: What the limits that stops brake at are multiplied by.
_TOO_MUCH = 1.3


def _nothing_is_seen(sabotage: Sabotage) -> None:
    def blind(motion: Trajectory, *_: Any) -> Look:
        return Look((), 1.0, motion.duration, motion.duration)

    sabotage.replace(look_at, blind)


def _every_stop_is_sound(sabotage: Sabotage) -> None:
    sabotage.replace(sound_stops, lambda states, *_: np.ones(states.shape[1], dtype=np.bool_))
    _nothing_is_seen(sabotage)


def _every_state_is_free(sabotage: Sabotage) -> None:
    def free(self: Checker, states: Array) -> Array:
        return np.ones(len(states), dtype=np.bool_)

    sabotage.method(Checker, "each_valid", free)
    sabotage.method(Checker, "all_valid", lambda *_: True)
    sabotage.method(Checker, "valid", lambda *_: True)


def _brakes_too_hard(sabotage: Sabotage) -> None:
    def hard(true: Callable[..., Trajectory], names: Any, state: Array, limits: BrakingLimits,
             *more: Any) -> Trajectory:  # fmt: skip
        harder = BrakingLimits(*(_TOO_MUCH * row for row in limits))
        return true(names, state, harder, *more)

    sabotage.wrap(braking_motion, hard)


def _brakes_too_softly(sabotage: Sabotage) -> None:
    """Stops take twice as long as they need, and so go on into what is beyond the motion."""

    def soft(true: Callable[..., Trajectory], names: Any, state: Array, limits: BrakingLimits,
             *more: Any) -> Trajectory:  # fmt: skip
        return true(names, state, BrakingLimits(*(0.05 * row for row in limits)), *more)

    sabotage.wrap(braking_motion, soft)
    _nothing_is_seen(sabotage)


def _begins_elsewhere(sabotage: Sabotage) -> None:
    """The stop begins where the motion is a hundredth of a second before it ends."""

    def early(true: Callable[..., Array], motion: Trajectory, at: float | None = None) -> Array:
        end = motion.duration if at is None else at
        return true(motion, max(end - 0.01, 0.0))

    # The gate alone: proposals begin where they should.
    sabotage.module(gate, "state_at", lambda *values: early(state_at, *values))


def _path_brakes_too_hard(sabotage: Sabotage) -> None:
    true = PathCells.deceleration

    def hard(self: PathCells, *values: Any) -> Array:
        return _TOO_MUCH * true(self, *values)

    sabotage.method(PathCells, "deceleration", hard)


def _path_is_left(sabotage: Sabotage) -> None:
    """The stop along the path bulges by a tenth of a radian."""

    def beside(true: Callable[..., Trajectory], *values: Any) -> Trajectory:
        stop = true(*values)
        away = 0.1 * np.sin(np.linspace(0.0, np.pi, stop.pieces))
        c = stop.coefficients.copy()
        c[:, :, 0] += away[:, None]
        return Trajectory(stop.joint_names, stop.breaks, c)

    sabotage.wrap(path_stop, beside)


def _stop_of_another_instant(sabotage: Sabotage) -> None:
    """A stop is begun with the speed of the middle of the motion."""

    def other(true: Callable[..., Trajectory], motion: Trajectory, at: float,
              limits: BrakingLimits) -> Trajectory:  # fmt: skip
        fast = true(motion, 0.5 * motion.duration, limits)
        c = fast.coefficients.copy()
        c[:, :, 0] += (motion.sample([at])[0] - fast.start)[None]
        return Trajectory(fast.joint_names, fast.breaks, c)

    sabotage.wrap(joint_stop, other)


#: Lies that the gate's proposals are made under.
GATE_LIES = (
    Lie("gate", "nothing is seen", _nothing_is_seen, (), frozenset()),
    Lie("gate", "every stop is sound", _every_stop_is_sound, (), frozenset()),
    Lie("gate", "every state is free", _every_state_is_free, (), frozenset()),
    Lie("braking", "limits scaled by 1.3", _brakes_too_hard, (), frozenset()),
    Lie("braking", "limits a twentieth", _brakes_too_softly, (), frozenset()),
    Lie("braking", "begins before the end of the motion", _begins_elsewhere, (), frozenset()),
)
#: Lies that stops of proved motions are made under.
STOP_LIES = (
    Lie("braking", "limits scaled by 1.3", _brakes_too_hard, (), frozenset()),
    Lie("braking", "begins at another speed", _stop_of_another_instant, (), frozenset()),
    Lie("stop along the path", "limits scaled by 1.3", _path_brakes_too_hard, (), frozenset()),
    Lie("stop along the path", "leaves the path", _path_is_left, (), frozenset()),
)
