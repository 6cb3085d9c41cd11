"""Ranges of sliders and the configuration to begin with."""

from armwright_client import Robot

#: Joints without limits are drawn between these positions [rad or m].
_FREE_RANGE = 3.141592653589793


def joint_ranges(model: Robot) -> list[tuple[float, float]]:
    """Range of each joint's slider [rad or m].

    Args:
        model: Model of the robot.
    """
    limits = zip(model.limits.lower, model.limits.upper, strict=True)
    return [
        (-_FREE_RANGE if low is None else low, _FREE_RANGE if high is None else high)
        for low, high in limits
    ]


def home(model: Robot) -> tuple[float, ...]:
    """The first named state of a robot, or the configuration in the middle of its limits.

    Args:
        model: Model of the robot.
    """
    if model.states:
        return tuple(next(iter(model.states.values())))
    return tuple(0.5 * (low + high) for low, high in joint_ranges(model))
