"""The law of time that options ask for, with the limits of a robot or those given."""

from collections.abc import Mapping, Sequence

import numpy as np

from dynamics.payload import with_payload
from kinematics.arrays import Array
from kinematics.chain import Chain, Limits
from kinematics.errors import InvalidOption, MissingLimit
from planning.effort_limits import EffortLimits
from planning.timing.options import TimingOptions
from planning.timing.parametrization import TimeParametrization

# Which limits each method must know.
_NEEDED = ("velocity", "acceleration")


def chosen_parametrization(
    timing: TimingOptions,
    joint_names: Sequence[str],
    limits: Limits,
    overrides: Mapping[str, Array] | None = None,
    chain: Chain | None = None,
) -> TimeParametrization:
    """The law that options ask for.

    Args:
        timing: The options.
        joint_names: n names.
        limits: Of the joints, NaN where not given.
        overrides: In place of them, by quantity.
        chain: The robot, for torque and tool speed limits.

    Raises:
        MissingLimit: A limit that is needed is not known; the message names the joints.
        MissingInertia: Torques are limited and some link's inertia is not known.
        InvalidOption: A boundary velocity has the wrong length, or the robot is missing.
    """
    given = dict(overrides or {})
    needed = (*_NEEDED, "jerk") if timing.method == "jerk_limited" else _NEEDED
    found = {
        name: given[name] if name in given else limits.require(name, joint_names) for name in needed
    }
    if timing.method == "spline" and not np.isnan(limits.jerk).all():
        # Its jerk is bounded, so that what is known of the limits can be kept.
        found["jerk"] = np.where(np.isnan(limits.jerk), np.inf, limits.jerk)
    if "jerk" in given and timing.method != "toppra":
        found["jerk"] = given["jerk"]
    scaled = {name: values * getattr(timing, f"{name}_scaling") for name, values in found.items()}
    return TimeParametrization(
        timing.method,
        scaled["velocity"],
        scaled["acceleration"],
        scaled.get("jerk"),
        _loads(timing, joint_names, given, chain),
        _velocity(timing.start_velocity, "start_velocity", joint_names),
        _velocity(timing.end_velocity, "end_velocity", joint_names),
    )


def _loads(
    timing: TimingOptions,
    joint_names: Sequence[str],
    given: Mapping[str, Array],
    chain: Chain | None,
) -> EffortLimits | None:
    if not (timing.torque_limits or timing.tool_speed is not None):
        return None
    if chain is None:
        raise InvalidOption(
            "limits of torque and tool speed need a robot", hint="Name one, or leave them out."
        )
    if timing.payload is not None:
        load = timing.payload
        chain = with_payload(chain, load.mass, load.center_of_mass, load.inertia, link=load.link)
    effort = None
    if timing.torque_limits:
        effort = (
            given["effort"] if "effort" in given else chain.limits.require("effort", joint_names)
        )
    return EffortLimits(chain, effort, timing.tool_speed)


def _velocity(given: Sequence[float] | None, name: str, joint_names: Sequence[str]) -> Array | None:
    if given is None:
        return None
    velocity = np.array(given, dtype=np.float64)
    if velocity.shape != (len(joint_names),) or not np.isfinite(velocity).all():
        raise InvalidOption(
            f"timing.{name} must be {len(joint_names)} finite numbers, one for each joint",
            hint=f"The order is: {', '.join(joint_names)}.",
        )
    return velocity


def require_limits(
    names: Sequence[str], joint_names: Sequence[str], given: Mapping[str, Array]
) -> None:
    """Refuse a request without a robot that leaves out limits which are needed.

    Raises:
        MissingLimit: Some are not given; the message names the joints.
    """
    for name in names:
        if name not in given:
            raise MissingLimit(
                f"no {name} limit is known for joint(s) {', '.join(joint_names)}",
                hint=f"Name a robot, or give limits.{name}, one for each joint.",
                quantity=name,
                joints=list(joint_names),
            )
