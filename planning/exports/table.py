"""A table of a motion in CSV."""

import csv
import io
from collections.abc import Sequence

import numpy as np

from planning.exports.points import ExportPoints

_COLUMNS = ("position", "velocity", "acceleration")


def table(joint_names: Sequence[str], points: ExportPoints) -> list[str]:
    """Lines of a table with a header; numbers have all their digits.

    Args:
        joint_names: n names.
        points: A row each: time [s], positions, and velocities and accelerations by the rule.
    """
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    kinds = _COLUMNS[: len(points.derivatives)]
    writer.writerow(["time", *(f"{kind}.{name}" for kind in kinds for name in joint_names)])
    rows = np.concatenate([points.times[:, None], *points.derivatives], axis=1)
    writer.writerows([[repr(value) for value in row] for row in rows.tolist()])
    return stream.getvalue().splitlines()
