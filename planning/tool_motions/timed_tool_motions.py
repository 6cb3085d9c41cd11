"""Motions of the tool in time: what a trajectory is held to."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidGoal
from planning.tool_motions.tool_corner import ToolCorner, ToolCurve
from planning.tool_motions.tool_motion import ToolMotion
from planning.tool_motions.tool_tolerance import ToolTolerance


@dataclass(frozen=True, slots=True)
class SpeedBand:
    """Speeds that the tool is to keep to at times.

    Args:
        low: Least speed [m/s].
        high: Largest speed [m/s].
        spans: Pairs of times between which they are asked for [s].
    """

    low: float
    high: float
    spans: tuple[tuple[float, float], ...]

    @classmethod
    def of_spans(
        cls, spans: Sequence[tuple[float, float, float | None]], width: float
    ) -> "tuple[SpeedBand, ...]":
        """The bands about the speeds that are asked for in spans of time.

        Args:
            spans: Times at which each begins and ends [s], and the speed asked for [m/s]; None for
                none.
            width: Largest difference from a speed, as part of it.
        """
        bands = []
        for speed in dict.fromkeys(speed for *_, speed in spans if speed is not None):
            mine = joined_spans([(begins, ends) for begins, ends, own in spans if own == speed])
            bands.append(cls(speed * (1.0 - width), speed * (1.0 + width), mine))
        return tuple(bands)


def joined_spans(spans: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """Spans of time, those joined that follow each other at once."""
    joined: list[tuple[float, float]] = []
    for begins, ends in spans:
        follows = bool(joined) and joined[-1][1] == begins
        joined.append((joined.pop()[0] if follows else begins, ends))
    return tuple(joined)


@dataclass(frozen=True, slots=True, eq=False)
class TimedToolMotions:
    """Motions of the tool in turn, when each is carried out, and how far the tool may be off.

    Args:
        motions: k motions.
        times: Times at which each begins, and the last one ends, shape (k + 1,) [s].
        max_position: How far the tool's origin may be off [m].
        max_orientation: How far its orientation may be off [rad]; None where it is free.
        tolerances: Tolerances of each motion the box that the tool may be in, to which the two
            deviations are added on all sides; None where they alone count. Empty where they do for
            all motions.
        speeds: Speeds to be kept, each at times of its own: the largest is a limit, of the least it
            is reported where it holds.
        begins: Times at which each begins where that is later than the end of the one before, so
            that the tool is free in between, shape (k,) [s]; None where each follows at once.

    Raises:
        InvalidGoal: The times are not as many as that, or they descend; a corner has a tolerance.
    """

    motions: tuple[ToolCurve, ...]
    times: Array
    max_position: float
    max_orientation: float | None = None
    tolerances: tuple[ToolTolerance | None, ...] = ()
    speeds: tuple[SpeedBand, ...] = ()
    begins: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "times", frozen(self.times))
        begins = self.times[:-1] if self.begins is None else self.begins
        object.__setattr__(self, "begins", frozen(begins))
        if self.times.shape != (len(self.motions) + 1,) or (np.diff(self.times) < 0.0).any():
            raise InvalidGoal(
                f"{len(self.motions)} motion(s) of the tool need {len(self.motions) + 1} times "
                "that do not descend",
                hint="Give when each motion begins, and when the last one ends.",
            )
        boxes = self.tolerances or (None,) * len(self.motions)
        for motion, box in zip(self.motions, boxes, strict=True):
            if isinstance(motion, ToolCorner) and box is not None:
                raise InvalidGoal(
                    "a rounded corner of the tool has no tolerance of its own",
                    hint="Allow larger deviations from the motions, or give lines and arcs.",
                )
        begins = np.asarray(self.begins)
        fits = begins.shape == (len(self.motions),)
        if not fits or (begins < self.times[:-1]).any() or (begins > self.times[1:]).any():
            raise InvalidGoal(
                "a motion of the tool begins before the one before ends, or after its own end",
                hint="Give times that do not descend.",
            )

    @property
    def exact(self) -> list[tuple[ToolCurve, float, float]]:
        """Motions without a tolerance of their own, with the times when they begin and end [s]."""
        return [row[:3] for row in self._rows if row[3] is None]

    @property
    def tolerant(self) -> list[tuple[ToolMotion, float, float, ToolTolerance]]:
        """Motions with a tolerance of their own, likewise."""
        return [
            (motion, begin, end, box)
            for motion, begin, end, box in self._rows
            if box is not None and not isinstance(motion, ToolCorner)
        ]

    @property
    def _rows(self) -> list[tuple[ToolCurve, float, float, ToolTolerance | None]]:
        begins, ends = np.asarray(self.begins).tolist(), self.times[1:].tolist()
        boxes = self.tolerances or (None,) * len(self.motions)
        return list(zip(self.motions, begins, ends, boxes, strict=True))
