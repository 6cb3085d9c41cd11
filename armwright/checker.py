"""The checker that people import: kernels read arrays as they come, so their shapes are checked."""

import math
from collections.abc import Iterator
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinematics.arrays import Array, typed
from kinematics.errors import InvalidOption, InvalidRobotState
from obstacles.collision import checker
from obstacles.collision.checker import Bracket, Motion, Proximity
from obstacles.robots.robot_geometry import RobotGeometry
from obstacles.scenes.scene import Scene


class Checker(checker.Checker):
    """`obstacles.collision.checker.Checker`, its arguments checked on every call.

    Raises:
        InvalidRobotState: A configuration has the wrong length or shape, or is not finite.
        InvalidOption: A distance is none.
    """

    __slots__ = ()

    @classmethod
    @typed
    def of(cls, robot: RobotGeometry, scene: Scene, margin: float = 0.0) -> Self:
        """The checker of a robot in a scene, ``margin`` [m] to be kept from its obstacles."""
        if not 0.0 <= margin < math.inf:
            raise InvalidOption(f"margin is {margin}", hint="Give 0 or more [m].")
        return super().of(robot, scene, margin)

    def clearance(self, q: ArrayLike) -> tuple[float, tuple[str, str] | None]:
        """As there."""
        return super().clearance(self._state(q))

    def closest(
        self, states: ArrayLike, within: float
    ) -> tuple[float, int, tuple[str, str] | None]:
        """As there."""
        return super().closest(self._states(states), _distance(within))

    def gradient(self, q: ArrayLike, within: float) -> Proximity:
        """As there."""
        return super().gradient(self._state(q), _distance(within))

    def least_overlap(self, states: ArrayLike) -> tuple[float, tuple[str, str]] | None:
        """As there."""
        return super().least_overlap(self._states(states))

    def valid(self, q: ArrayLike) -> bool:
        """As there."""
        return super().valid(self._state(q))

    def all_valid(self, states: ArrayLike) -> bool:
        """As there."""
        return super().all_valid(self._states(states))

    def each_valid(self, states: ArrayLike) -> NDArray[np.bool_]:
        """As there."""
        return super().each_valid(self._states(states))

    def bracket(self, q: ArrayLike) -> Bracket:
        """As there."""
        return super().bracket(self._state(q))

    def segment(self, start: ArrayLike, end: ArrayLike) -> Motion:
        """As there."""
        return super().segment(self._state(start, "start"), self._state(end, "end"))

    def curve(
        self, b0: ArrayLike, b1: ArrayLike, b2: ArrayLike, b3: ArrayLike | None = None
    ) -> Motion:
        """As there."""
        c0, c1, c2 = (self._state(b, f"b{k}") for k, b in enumerate((b0, b1, b2)))
        return super().curve(c0, c1, c2, None if b3 is None else self._state(b3, "b3"))

    def free(self, start: ArrayLike, end: ArrayLike) -> bool:
        """As there."""
        return super().free(self._state(start, "start"), self._state(end, "end"))

    def straight(self, start: ArrayLike, end: ArrayLike) -> Motion:
        """As there."""
        return super().straight(self._state(start, "start"), self._state(end, "end"))

    def round_corners(
        self, waypoints: ArrayLike, reaches: Array, halvings: int, *, keep: bool, smooth: bool
    ) -> Iterator[int]:
        """As there."""
        points = self._states(waypoints, "waypoints")
        fits = isinstance(reaches, np.ndarray) and reaches.shape == (max(len(points) - 2, 0),)
        if not fits or reaches.dtype != np.float64 or not np.isfinite(reaches).all():
            raise InvalidOption(
                "reaches are not one finite number for each corner",
                hint="Give an array of float64, of the waypoints between the first and the last.",
            )
        if not (isinstance(halvings, int) and halvings > 0):
            raise InvalidOption(f"halvings is {halvings!r}", hint="Give a whole number, 1 or more.")
        return super().round_corners(points, reaches, halvings, keep=keep, smooth=smooth)

    def polyline(self, waypoints: ArrayLike) -> tuple[Motion, int]:
        """As there."""
        return super().polyline(self._states(waypoints, "waypoints"))

    def _state(self, values: ArrayLike, name: str = "q") -> Array:
        return self._checked(values, name, 1)

    def _states(self, values: ArrayLike, name: str = "states") -> Array:
        return self._checked(values, name, 2)

    def _checked(self, values: ArrayLike, name: str, dimensions: int) -> Array:
        chain = self.model.robot.chain
        array = chain.configuration(values, name)
        if array.ndim != dimensions:
            wanted = f"({chain.n},)" if dimensions == 1 else f"(k, {chain.n})"
            raise InvalidRobotState(
                f"{name} has the shape {array.shape}, not {wanted}",
                hint=f"The joints are: {', '.join(chain.joint_names)}.",
            )
        return array


def _distance(within: float) -> float:
    """A distance that is one: kernels compare with it."""
    if not isinstance(within, int | float) or math.isnan(within):
        raise InvalidOption(f"within is {within!r}", hint="Give a distance [m].")
    return float(within)
