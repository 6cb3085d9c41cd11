"""Picture of the reach in a box: slices across its shortest edge, coloured by manipulability."""

import numpy as np

from kinematics.arrays import Array
from planning.reach.evaluation import PoseGrid, Reach, Status

#: Longest edge of a slice [px].
_SIDE = 260.0
_GAP = 36.0
_COLUMNS = 4
#: Slices that are drawn, evenly chosen where there are more.
_MAX_SLICES = 16
_NAMES = "xyz"
#: Colours of a pose that is not reached, by status.
_MISSED = {
    Status.OUT_OF_REACH: "#ffffff",
    Status.OUTSIDE_LIMITS: "#d9d9d9",
    Status.IN_COLLISION: "#4d4d4d",
}
#: Ends of the scale of manipulability, dark blue to yellow.
LOW, HIGH = np.array([45.0, 20.0, 110.0]), np.array([250.0, 225.0, 40.0])


def draw(grid: PoseGrid, found: Reach) -> str:
    """An SVG of a grid's slices.

    White is out of reach, light grey outside the limits, dark grey in collision; reached points
    go from blue at the least manipulability to yellow at the largest.

    Args:
        grid: Points with one orientation.
        found: Reach of the points.
    """
    shape = grid.shape[:3]
    across = int(np.argmin(shape))
    status = np.moveaxis(found.status.reshape(shape), across, 0)
    figure = np.moveaxis(found.manipulability.reshape(shape), across, 0)
    axes = list(grid.axes())
    level = axes.pop(across)
    names = [name for k, name in enumerate(_NAMES) if k != across]
    shown = np.unique(np.linspace(0, len(level) - 1, min(len(level), _MAX_SLICES)).astype(np.int64))
    largest = float(np.nanmax(figure)) if found.is_reached.any() else 1.0
    cell = _SIDE / max(status.shape[1:])
    width, height = (count * cell for count in status.shape[1:])
    columns = min(_COLUMNS, len(shown))
    rows = -(-len(shown) // columns)
    parts = [
        _head(columns * (width + _GAP) + _GAP, rows * (height + 2 * _GAP) + _GAP),
        f"<title>Reach: {int(found.is_reached.sum())} of {found.completed} poses</title>",
        '<rect width="100%" height="100%" fill="#f4f4f4"/>',
    ]
    for number, k in enumerate(shown):
        x = _GAP + (number % columns) * (width + _GAP)
        y = _GAP + (number // columns) * (height + 2 * _GAP)
        parts.append(
            f'<text x="{x:.1f}" y="{y - 8:.1f}">{_NAMES[across]} = {level[k]:.3g} m '
            f"({names[0]} right, {names[1]} up)</text>"
        )
        parts.extend(_slice(status[k], figure[k] / max(largest, 1e-12), (x, y), cell))
    return "\n".join([*parts, "</svg>"])


def _head(width: float, height: float) -> str:
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.0f} {height:.0f}" font-family="sans-serif" font-size="12">'
    )


def _slice(status: Array, share: Array, corner: tuple[float, float], cell: float) -> list[str]:
    """Squares of one slice, the first axis to the right and the second upwards."""
    parts = []
    high = status.shape[1]
    for i, j in np.ndindex(*status.shape):
        x, y = corner[0] + i * cell, corner[1] + (high - 1 - j) * cell
        parts.append(
            f'<rect x="{x:.2f}" y="{y:.2f}" width="{cell:.2f}" height="{cell:.2f}" '
            f'fill="{_colour(Status(int(status[i, j])), float(share[i, j]))}"/>'
        )
    return parts


def _colour(status: Status, share: float) -> str:
    if status is not Status.REACHED:
        return _MISSED[status]
    red, green, blue = (LOW + share * (HIGH - LOW)).astype(np.int64)
    return f"#{red:02x}{green:02x}{blue:02x}"
