"""Options of OMPL's planners: names, values and ranges."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

#: Words of OMPL's names that are not written as words of ours are.
_SPELLINGS = {"cc": "CC", "fmt": "FMT"}

Value = float | int | bool | None


@dataclass(frozen=True, slots=True)
class Parameter:
    """An option of a planner.

    Args:
        name: Name on the wire.
        kind: Kind of its values.
        default: Value where the request names none; None leaves it to OMPL.
        least: Smallest value.
        most: Largest value.
        above: Whether ``least`` itself is too small.
    """

    name: str
    kind: Literal["number", "whole", "switch"]
    default: Value
    least: float = 0.0
    most: float = 1.0
    above: bool = False

    def takes(self, value: object) -> bool:
        """Whether it can have this value."""
        if isinstance(value, bool) or self.kind == "switch":
            return isinstance(value, bool) and self.kind == "switch"
        if not isinstance(value, int if self.kind == "whole" else int | float):
            return False
        assert isinstance(value, int | float)
        fits = math.isfinite(value) and self.least <= value <= self.most
        return fits and not (self.above and value == self.least)

    @property
    def requirement(self) -> str:
        """The values that it takes, for a person."""
        if self.kind == "switch":
            return "true or false"
        noun = "a number" if self.kind == "number" else "a whole number"
        low = f"above {self.least:g}" if self.above else f"from {self.least:g}"
        return f"{noun} {low} to {self.most:g}"

    def setter(self, solver: Any) -> Callable[[Value], None]:
        """The method of an OMPL planner that sets this option."""
        words = (_SPELLINGS.get(word, word.capitalize()) for word in self.name.split("_"))
        method: Callable[[Value], None] = getattr(solver, f"set{''.join(words)}")
        return method
