"""The lines and arcs that a request asks for."""

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidGoal, InvalidOption
from kinematics.rounding import TOLD, rounding
from planning.options import CartesianOptions, ToolMotionOptions
from planning.tool_motions.tool_motion import ToolMotion, arc_via, line
from planning.tool_paths.written_arc import WrittenArc


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
        motions.append(tool_motion(T, item, i, options.max_deviation))
        T = motions[-1].T_end
    return tuple(motions)


def tool_motion(
    T_start: Array, item: ToolMotionOptions, index: int, max_deviation: float
) -> ToolMotion:
    """Return one motion that is asked for.

    Args:
        T_start: Where it begins, unless it says so itself, shape (4, 4).
        item: The motion.
        index: Its place in the request, for messages.
        max_deviation: So much an arc may be off the circle that is asked for, or more by
            rounding [m].

    Raises:
        InvalidGoal: An arc whose points name no circle.
    """
    T, end = T_start, np.array(item.T_base_tip)
    if item.T_base_start is not None:
        T = np.array(item.T_base_start)
    # The first begins where the arm stands, which nobody wrote.
    written = index > 0 or item.T_base_start is not None
    start_rounding = rounding(T[:3, 3]) if written else 0.0
    try:
        if item.kind == "lin":
            return line(T, end)
        if item.via is not None:
            return arc_via(T, end, item.via)
        assert item.center is not None
        arc = WrittenArc(T, end, np.array(item.center), item.normal, start_rounding)
        return arc.motion(max_deviation)
    except InvalidGoal as error:
        raise InvalidGoal(
            f"motions[{index}]: {error.message}", hint=error.hint, motion=index, **error.details
        ) from None


def repairs(options: CartesianOptions, motions: tuple[ToolMotion, ...]) -> tuple[str, ...]:
    """Notes on the arcs that are not quite the ones that were asked for.

    Args:
        options: The motions asked for.
        motions: The motions.
    """
    notes = []
    for i, (item, motion) in enumerate(zip(options.motions, motions, strict=False)):
        end = float(np.linalg.norm(motion.T_end[:3, 3] - item.T_base_tip[:3, 3]))
        center = 0.0 if item.center is None else float(np.linalg.norm(motion.center - item.center))
        if max(end, center) > TOLD:
            moved = f"its center was moved by {center:.2g} m"
            moved = moved if end <= TOLD else f"{moved}, its end to its start by {end:.2g} m"
            notes.append(f"motions[{i}] is a circle within rounding only: {moved}.")
    return tuple(notes)
