"""Memory of processes over time, and whether it grows: of one, within lives, and over lives.

A server lives for the whole of a run, its workers do not: they are killed, and replaced by their
count of jobs, age and size. A leak shows as growth within the lives of workers that live for long,
or, where what workers are forked from takes more and more, as growth of the largest memory in a
life from one life to the next.
"""

import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

_PAGE = os.sysconf("SC_PAGE_SIZE")
_MEBIBYTE = 2.0**20
#: Parts of the time whose means are taken for independent, and looks that these need.
_PARTS, _LEAST = 10, 20


class Growth(NamedTuple):
    """Slope of memory over time.

    Attributes:
        rate: [MiB/h].
        error: its standard error [MiB/h]; infinite where there is too little to tell.
        samples: looks, or lives, that it is of.
    """

    rate: float
    error: float
    samples: int

    def __str__(self) -> str:
        """The growth for people."""
        if not np.isfinite(self.error):
            return "too little to tell its growth"
        return f"{self.rate:+.1f} +- {self.error:.1f} MiB/h"


_UNKNOWN = Growth(0.0, float("inf"), 0)


def resident(pid: int) -> float:
    """Memory of a process [MiB]; 0 where it has ended."""
    with suppress(OSError, IndexError):
        return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * _PAGE / _MEBIBYTE
    return 0.0


def growth(times: Sequence[float], values: Sequence[float]) -> Growth:
    """Slope of a line through values, and its standard error from ten parts of the time.

    Neighbouring looks tell the same, so that the error of a common fit would be far too small:
    means of parts are taken for independent.

    Args:
        times: Increasing [s].
        values: Of each [MiB].
    """
    if len(times) < _LEAST:
        return _UNKNOWN
    x, y = np.array(times) / 3600.0, np.array(values)
    parts = zip(np.array_split(x, _PARTS), np.array_split(y, _PARTS), strict=True)
    at, mean = np.array([(a.mean(), b.mean()) for a, b in parts]).T
    line = np.polynomial.Polynomial.fit(at, mean, 1)
    rest = float(np.sum((mean - line(at)) ** 2)) / (_PARTS - 2)
    error = float(np.sqrt(rest / np.sum((at - at.mean()) ** 2)))
    return Growth(float(line.convert().coef[-1]), error, len(times))


@dataclass(slots=True)
class Lives:
    """Memory of processes that come and go.

    Args:
        looks: Times [s] and memory [MiB] of each process.
    """

    looks: dict[int, list[tuple[float, float]]] = field(default_factory=dict)

    def look(self, time: float, memory: Mapping[int, float]) -> None:
        """Write down the memory of all processes that there are.

        Args:
            time: Now [s].
            memory: Of each process by number [MiB]; 0 for one that has just ended.
        """
        for pid, value in memory.items():
            if value > 0.0:
                self.looks.setdefault(pid, []).append((time, value))

    @property
    def largest(self) -> float:
        """The largest memory of any [MiB]."""
        return max((value for life in self.looks.values() for _, value in life), default=0.0)

    def within(self, warm_up: float) -> Growth:
        """Growth within lives: the mean of those that last long, each by its certainty.

        Args:
            warm_up: Seconds of each life that do not count: caches fill.
        """
        rates = []
        for life in self.looks.values():
            late = [look for look in life if look[0] >= life[0][0] + warm_up]
            rate = growth([time for time, _ in late], [value for _, value in late])
            if np.isfinite(rate.error):
                rates.append(rate)
        if not rates:
            return _UNKNOWN
        # A life of one constant value has no error; that of a page an hour is as good as none.
        weights = np.array([max(rate.error, _PAGE / _MEBIBYTE) for rate in rates]) ** -2.0
        mean = float(weights @ [rate.rate for rate in rates] / weights.sum())
        return Growth(mean, float(weights.sum() ** -0.5), len(rates))

    def over(self, begin: float) -> Growth:
        """Growth of the largest memory in a life, over the lives that end after ``begin`` [s]."""
        ends = sorted(
            (life[-1][0], max(value for _, value in life))
            for life in self.looks.values()
            if life[-1][0] >= begin
        )
        return growth([time for time, _ in ends], [value for _, value in ends])
