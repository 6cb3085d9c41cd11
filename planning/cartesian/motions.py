"""The lines and arcs that a request asks for."""

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidGoal, InvalidOption
from planning.options import CartesianOptions, ToolMotionOptions
from planning.tool_motion import ToolMotion, arc_about, arc_via, line


def tool_motions(
    T_start: Array, options: CartesianOptions, target: Array | None = None
) -> tuple[ToolMotion, ...]:
    """Return the motions that options ask for, each from where it begins, or the one before ends.

    Args:
        T_start: Pose of the tool at the start, shape (4, 4).
        options: The motions asked for.
        target: The goal's pose, shape (4, 4): what one line leads to if no motions are asked for.

    Raises:
        InvalidGoal: An arc whose points name no circle; the message says which motion.
        InvalidOption: There are neither motions nor a goal.
    """
    if not options.motions:
        if target is None:
            raise InvalidOption("there is no motion to be carried out")
        return (line(T_start, target),)
    motions: list[ToolMotion] = []
    T = T_start
    for i, item in enumerate(options.motions):
        motions.append(tool_motion(T, item, i))
        T = motions[-1].T_end
    return tuple(motions)


def tool_motion(T_start: Array, item: ToolMotionOptions, index: int) -> ToolMotion:
    """Return one motion that is asked for.

    Args:
        T_start: Where it begins, unless it says so itself, shape (4, 4).
        item: The motion.
        index: Its place in the request, for messages.

    Raises:
        InvalidGoal: An arc whose points name no circle.
    """
    T, end = T_start, np.array(item.T_base_tip)
    if item.T_base_start is not None:
        T = np.array(item.T_base_start)
    try:
        if item.kind == "lin":
            return line(T, end)
        if item.via is not None:
            return arc_via(T, end, item.via)
        assert item.center is not None
        return arc_about(T, end, item.center, item.normal)
    except InvalidGoal as error:
        raise InvalidGoal(
            f"motions[{index}]: {error.message}", hint=error.hint, motion=index, **error.details
        ) from None
