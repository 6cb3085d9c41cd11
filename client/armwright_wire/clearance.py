"""Preferred clearance as requests ask for it and answers tell it."""

from typing import Annotated

from pydantic import Field

from armwright_wire.base import Answer, Body, NonNegative
from armwright_wire.check import Margin

#: As planning has it; tests compare the two [m].
DEFAULT_PREFERRED = 0.02
MAX_PREFERRED = 1.0


class Clearance(Body):
    """Distances from obstacles: one to keep wherever there is room, one to keep always."""

    preferred: Annotated[NonNegative, Field(le=MAX_PREFERRED)] = Field(
        DEFAULT_PREFERRED,
        description="kept wherever there is room [m]; a quarter of it, 5 mm at most, between the "
        "robot's own links; 0 prefers no distance",
    )
    least: Margin | None = Field(None, description="another name of margin [m]")

    def check_margin(self, margin: float) -> None:
        """Refuse a margin that is given beside another least clearance.

        Raises:
            ValueError: They differ.
        """
        if self.least is not None and margin not in {0.0, self.least}:
            raise ValueError("margin and clearance.least are one distance: give one of them")


class CloseSpanAnswer(Answer):
    """A span of the motion that is nearer to something than preferred."""

    begins: float = Field(description="[s]")
    ends: float = Field(description="[s]")
    distance: float = Field(description="the least in it, margins of obstacles taken off [m]")
    pair: tuple[str, str] = Field(description="the two bodies that come so near")


class ClearanceAnswer(Answer):
    """Preferred distances, and where the motion does not keep them."""

    preferred: float = Field(description="from obstacles [m]")
    own_links: float = Field(description="between the robot's own links [m]")
    least: float = Field(description="the margin that the certificate proves [m]")
    time_below: float = Field(description="time in which the motion is nearer than preferred [s]")
    period: float = Field(description="between two instants that were looked at [s]")
    spans: list[CloseSpanAnswer] = Field(
        description="spans of time nearer than preferred, in their order"
    )
