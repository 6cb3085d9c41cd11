"""Checks of numbers among options."""

import math

from kinematics.errors import InvalidOption


def positive(name: str, value: object) -> None:
    """Check that an option is a finite number above 0.

    Raises:
        InvalidOption: It is not.
    """
    if isinstance(value, bool) or not (
        isinstance(value, int | float) and math.isfinite(value) and value > 0
    ):
        raise InvalidOption(f"{name} must be a positive number, not {value!r}")


def whole(name: str, value: object, least: int, most: int) -> None:
    """Check that an option is a whole number from ``least`` to ``most``.

    Raises:
        InvalidOption: It is not.
    """
    if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
        raise InvalidOption(f"{name} must be a whole number from {least} to {most}, not {value!r}")


def share(name: str, value: object) -> None:
    """Check that an option is a number from 0 to less than 1.

    Raises:
        InvalidOption: It is not.
    """
    if isinstance(value, bool) or not (isinstance(value, int | float) and 0.0 <= value < 1.0):
        raise InvalidOption(f"{name} must be a number from 0 to less than 1, not {value!r}")
