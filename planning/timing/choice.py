"""The time parametrization that options ask for, within the limits of a robot or those given."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from dynamics.model.payload import with_payload
from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidOption, MissingLimit
from kinematics.model.chain import Chain, Limits
from planning.timing.method import JerkUse, TimingMethod, timing_method
from planning.timing.options import Method, Solver, TimingOptions
from planning.timing.parametrization import TimeParametrization
from planning.values.limits import EffortLimits, MotionLimits

# Limits that every method must know.
_REQUIRED = ("velocity", "acceleration")
# Jerk limit by rule, as a multiple of the acceleration limit [1/s]: full acceleration in 40 ms. No
# arm whose jerk limits are published has less (25 to 500, docs/timing.md).
_JERK_FACTOR = 25.0
#: Rule for jerk limits that are not known, where no method of timing is named.
JERK_RULE = f"{_JERK_FACTOR:g} x acceleration"


def chosen_parametrization(
    timing: TimingOptions,
    joint_names: Sequence[str],
    limits: Limits,
    overrides: Mapping[str, Array] | None = None,
    chain: Chain | None = None,
) -> TimeParametrization:
    """The time parametrization that options ask for.

    Args:
        timing: The options.
        joint_names: n names.
        limits: Limits of the joints, NaN where not given.
        overrides: Limits in place of them, by quantity.
        chain: The robot, for torque and tool speed limits.

    Raises:
        MissingLimit: A limit that is needed is not known; the message names the joints.
        MissingInertia: Torques are limited and some link's inertia is not known.
        InvalidOption: A boundary velocity has the wrong length, or the robot is missing.
    """
    usual = not (overrides or timing.torque_limits or timing.tool_speed is not None)
    if usual and chain is not None and limits is chain.limits:
        scalings = timing.velocity_scaling, timing.acceleration_scaling, timing.jerk_scaling
        parametrization = _within_limits_of(chain, timing.method, timing.solver, scalings)
        if timing.start_velocity is None and timing.end_velocity is None:
            return parametrization
    else:
        parametrization = _within_limits(timing, joint_names, limits, dict(overrides or {}), chain)
    return replace(
        parametrization,
        start_velocity=_velocity(timing.start_velocity, "start_velocity", joint_names),
        end_velocity=_velocity(timing.end_velocity, "end_velocity", joint_names),
    )


#: Requests for a robot mostly ask for the same.
@lru_cache(maxsize=64)
def _within_limits_of(
    chain: Chain, method: Method | None, solver: Solver | None, scalings: tuple[float, float, float]
) -> TimeParametrization:
    """``_within_limits`` of a robot, of its positions' derivatives alone."""
    velocity, acceleration, jerk = scalings
    timing = TimingOptions(method, velocity, acceleration, jerk, solver=solver)
    return _within_limits(timing, chain.joint_names, chain.limits, {}, chain)


def _within_limits(
    timing: TimingOptions,
    joint_names: Sequence[str],
    limits: Limits,
    overrides: Mapping[str, Array],
    chain: Chain | None,
) -> TimeParametrization:
    """``chosen_parametrization`` from rest to rest."""
    given = {name: row for name, row in overrides.items() if name != "effort"}
    MotionLimits(given).check_lengths(joint_names)
    method = timing_method(timing.method, timing.solver)
    chosen = {
        name: overrides[name] if name in overrides else limits.require(name, joint_names)
        for name in required_limits(method)
    }
    if method.jerk is JerkUse.WHERE_KNOWN and not np.isnan(limits.jerk).all():
        chosen["jerk"] = np.where(np.isnan(limits.jerk), np.inf, limits.jerk)
    if method.jerk is not JerkUse.UNUSED and "jerk" in overrides:
        chosen["jerk"] = overrides["jerk"]
    ruled: tuple[str, ...] = ()
    if method.jerk is JerkUse.RULED and "jerk" not in chosen:
        missing = np.isnan(limits.jerk)
        chosen["jerk"] = np.where(missing, _JERK_FACTOR * chosen["acceleration"], limits.jerk)
        ruled = tuple(name for name, is_ruled in zip(joint_names, missing, strict=True) if is_ruled)
    scaled = {
        name: frozen(values * getattr(timing, f"{name}_scaling")) for name, values in chosen.items()
    }
    return TimeParametrization(
        method,
        scaled["velocity"],
        scaled["acceleration"],
        scaled.get("jerk"),
        _loads(timing, joint_names, overrides, chain),
        ruled=ruled,
        ignored_jerk=overrides.get("jerk") if method.jerk is JerkUse.UNUSED else None,
    )


def required_limits(method: TimingMethod) -> tuple[str, ...]:
    """The quantities whose limits a method must know."""
    return (*_REQUIRED, "jerk") if method.jerk is JerkUse.REQUIRED else _REQUIRED


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
