"""Preferred clearance as plans ask for it."""

from dataclasses import dataclass

from kinematics.errors import InvalidOption

#: Preferred distance from obstacles where none is asked for [m].
DEFAULT_PREFERRED = 0.02
#: Largest distance that can be preferred [m].
MAX_PREFERRED = 1.0


@dataclass(frozen=True, slots=True)
class PreferredClearance:
    """Distances to be kept wherever there is space.

    Args:
        obstacles: Distance from obstacles, their own margins not counted [m]; 0 for none.

    Raises:
        InvalidOption: The distance is not in [0, 1].
    """

    obstacles: float = DEFAULT_PREFERRED

    def __post_init__(self) -> None:
        if not 0.0 <= self.obstacles <= MAX_PREFERRED:
            raise InvalidOption(
                f"clearance.preferred must be from 0 to {MAX_PREFERRED:g} m",
                hint="Two centimetres are usual; 0 prefers no distance.",
            )

    @property
    def own_links(self) -> float:
        """Between the robot's own links [m]."""
        # Preferred distance between the robot's own links, as a part of that from obstacles, and at
        # most [m]: a wrist's links are built 10 to 25 mm apart.
        return min(0.25 * self.obstacles, 0.005)
