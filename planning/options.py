"""How to plan: which planner, which timing, how long, which seed."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from kinematics.errors import InvalidOption

#: Longest a single plan may take [s].
MAX_TIMEOUT = 600.0


@dataclass(frozen=True, slots=True)
class TimingOptions:
    """How the path is timed.

    Args:
        method: "toppra".
        velocity_scaling: Share of the velocity limits to use, in (0, 1].
        acceleration_scaling: Share of the acceleration limits to use, in (0, 1].

    Raises:
        InvalidOption: An unknown method or a share outside (0, 1].
    """

    method: str = "toppra"
    velocity_scaling: float = 1.0
    acceleration_scaling: float = 1.0

    def __post_init__(self) -> None:
        for name in ("velocity_scaling", "acceleration_scaling"):
            if not 0.0 < getattr(self, name) <= 1.0:
                raise InvalidOption(f"timing.{name} must be in (0, 1]")


@dataclass(frozen=True, slots=True)
class Options:
    """How a problem is planned.

    Args:
        planner: "auto" (the ladder) or the name of one planner.
        planner_options: Its parameters, by name.
        timing: How the path is timed.
        timeout: Seconds for all stages together.
        seed: Of everything random; the same seed gives the same answer.

    Raises:
        InvalidOption: The timeout is not in (0, 600].
    """

    planner: str = "auto"
    planner_options: Mapping[str, Any] = field(default_factory=lambda: MappingProxyType({}))
    timing: TimingOptions = field(default_factory=TimingOptions)
    timeout: float = 5.0
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0.0 < self.timeout <= MAX_TIMEOUT:
            raise InvalidOption(f"timeout must be in (0, {MAX_TIMEOUT:g}] seconds")
