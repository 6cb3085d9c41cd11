"""Fields for numbers as people write them: texts, so that no sign and no digit is lost.

Fields for numbers of the browser turn a half-typed "-0" into 0 and cut digits to those of a step.
"""

import math
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
import viser

from armwright_client import Pose
from studio.page.panel import on_user_update, put_value
from studio.pose import roll_pitch_yaw, wxyz

Quantity = Literal["length", "angle"]
#: Units of each choice, with how many of them a metre or a radian has.
UNITS: dict[str, dict[Quantity, tuple[str, float]]] = {
    "m, rad": {"length": ("m", 1.0), "angle": ("rad", 1.0)},
    "mm, degrees": {"length": ("mm", 1e3), "angle": ("°", 180.0 / math.pi)},
}
#: Shown digits: more than a drag or a person means, fewer than rounding shows.
_DIGITS = 10
_SAME = 1e-12


class Units:
    """The units of all fields of the page.

    Args:
        gui: Interface of viser.
    """

    def __init__(self, gui: viser.GuiApi) -> None:
        self._fields: list[NumbersField] = []
        self._choice = gui.add_dropdown("Units", [*UNITS])
        on_user_update(self._choice, self._show)

    def of(self, quantity: Quantity) -> tuple[str, float]:
        """The unit's sign, and how many of it a metre or a radian has."""
        return UNITS[self._choice.value][quantity]

    def _show(self, _: str) -> None:
        for field in self._fields:
            field.show_units()

    def add(self, field: "NumbersField") -> None:
        """Have a field follow the choice."""
        self._fields.append(field)

    def remove(self, field: "NumbersField") -> None:
        """Have a field follow no more."""
        self._fields.remove(field)


class NumbersField:
    """One or several numbers in one field.

    Args:
        gui: Interface of viser.
        label: Label without the unit.
        units: Units of the page.
        quantity: Quantity of the numbers.
        values: Values that are shown first [m or rad].
        act: Called with the values that a person typed [m or rad].
        least: Values below are not taken: half-typed sizes are 0.
    """

    def __init__(
        self,
        gui: viser.GuiApi,
        label: str,
        units: Units,
        quantity: Quantity,
        values: Sequence[float],
        act: Callable[[list[float]], None],
        least: float = -math.inf,
    ) -> None:
        self._label, self._units, self._quantity = label, units, quantity
        self._values, self._act, self._least = tuple(values), act, least
        self._widget = gui.add_text(label, "")
        units.add(self)
        self.show_units()
        on_user_update(self._widget, lambda _: self._take())

    def show(self, values: Sequence[float]) -> None:
        """Show values, unless they are those that are typed, or being typed.

        Args:
            values: Values of the state [m or rad].
        """
        typed, before = self._typed(), self._values
        self._values = tuple(values)
        if _same(self._values, typed if typed is not None else before):
            return
        self._write()

    def show_units(self) -> None:
        """Show the values in the units of the page."""
        self._widget.label = f"{self._label} [{self._units.of(self._quantity)[0]}]"
        self._write()

    def remove(self) -> None:
        """Take the field from the page."""
        self._units.remove(self)
        self._widget.remove()

    def _write(self) -> None:
        factor = self._units.of(self._quantity)[1]
        texts = [f"{round(value * factor, _DIGITS):.{_DIGITS}g}" for value in self._values]
        put_value(self._widget, ", ".join(texts))

    def _typed(self) -> tuple[float, ...] | None:
        """The values as they are typed [m or rad]; None while they are no such numbers."""
        words = self._widget.value.replace(",", " ").replace(";", " ").split()
        try:
            numbers = [float(word) for word in words]
        except ValueError:
            return None
        if len(numbers) != len(self._values) or not all(map(math.isfinite, numbers)):
            return None
        factor = self._units.of(self._quantity)[1]
        values = tuple(number / factor for number in numbers)
        return values if min(values) >= self._least else None

    def _take(self) -> None:
        typed = self._typed()
        if typed is not None and not _same(typed, self._values):
            self._values = typed
            self._act(list(typed))


class PoseFields:
    """Position and fixed-axis angles of a pose.

    Args:
        gui: Interface of viser.
        units: Units of the page.
        pose: Pose that is shown first.
        act: Called with the pose that a person typed.
    """

    def __init__(
        self, gui: viser.GuiApi, units: Units, pose: Pose, act: Callable[[Pose], None]
    ) -> None:
        self._act = act
        self._at, self._turn = list(pose.position), list(roll_pitch_yaw(pose))
        label = "Roll, pitch, yaw"
        self._position = NumbersField(gui, "Position", units, "length", self._at, self._move)
        self._angles = NumbersField(gui, label, units, "angle", self._turn, self._rotate)

    def show(self, pose: Pose) -> None:
        """Show a pose; angles that mean the same stay as they were typed."""
        self._at = list(pose.position)
        typed = Pose(position=self._at, rpy=self._turn)
        if not np.allclose(wxyz(typed), wxyz(pose)) and not np.allclose(wxyz(typed), -wxyz(pose)):
            self._turn = list(roll_pitch_yaw(pose))
        self._position.show(self._at)
        self._angles.show(self._turn)

    def remove(self) -> None:
        """Take the fields from the page."""
        self._position.remove()
        self._angles.remove()

    def _move(self, position: list[float]) -> None:
        self._at = position
        self._act(Pose(position=self._at, rpy=self._turn))

    def _rotate(self, angles: list[float]) -> None:
        self._turn = angles
        self._act(Pose(position=self._at, rpy=self._turn))


def _same(a: Sequence[float], b: Sequence[float]) -> bool:
    return all(math.isclose(x, y, rel_tol=_SAME, abs_tol=_SAME) for x, y in zip(a, b, strict=True))
