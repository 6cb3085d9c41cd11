"""The lines and arcs that a request asks for."""

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidGoal, InvalidOption
from planning.options import CartesianOptions
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
        end = np.array(item.T_base_tip)
        if item.T_base_start is not None:
            T = np.array(item.T_base_start)
        try:
            if item.kind == "lin":
                motions.append(line(T, end))
            elif item.via is not None:
                motions.append(arc_via(T, end, item.via))
            else:
                assert item.center is not None
                motions.append(arc_about(T, end, item.center, item.normal))
        except InvalidGoal as error:
            raise InvalidGoal(
                f"motions[{i}]: {error.message}", hint=error.hint, motion=i, **error.details
            ) from None
        T = end
    return tuple(motions)
