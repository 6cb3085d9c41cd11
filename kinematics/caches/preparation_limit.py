"""The instant at which preparing robots and scenes for checks is given up.

Meshes are cut, covered by spheres and put into trees when they are first needed: that can take a
second, in the midst of work that has a deadline. What is done by then is kept for the next time.
"""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import ClassVar

from kinematics.errors import ArmwrightError

_until: ContextVar[float] = ContextVar("_until", default=math.inf)


class PreparationTimedOut(ArmwrightError):
    """Time was up while a robot or a scene was prepared for checks."""

    code: ClassVar[str] = "TIMED_OUT"


def limit_preparation(at: float) -> None:
    """Let preparation be given up at an instant, whatever was said before.

    Args:
        at: Instant on the clock of ``time.monotonic``; infinite for never [s].
    """
    _until.set(at)


@contextmanager
def preparation_limit(at: float) -> Iterator[None]:
    """Within, preparation is given up at an instant, or sooner if that was said before.

    Args:
        at: Instant on the clock of ``time.monotonic`` [s].
    """
    before = _until.set(min(at, _until.get()))
    try:
        yield
    finally:
        _until.reset(before)


def check_preparation_time() -> None:
    """Go on, unless time is up.

    Raises:
        PreparationTimedOut: Time is up.
    """
    if time.monotonic() >= _until.get():
        raise PreparationTimedOut(
            "time was up while meshes were being prepared for collision checks",
            hint="Allow more time, or ask again: what was prepared so far is kept.",
            stage="preparation",
        )
