"""Timing options, limits and paths from wire to domain, and timed paths back."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from armwright_wire.motions import retime as retime_schema
from armwright_wire.motions.timing import Timing
from armwright_wire.motions.trajectory import LimitsBody
from armwright_wire.plans import plan as schema
from dynamics.model.payload import with_payload
from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidTrajectory
from kinematics.model.chain import Chain
from kinematics.trajectory.trajectory import Trajectory
from planning.retiming.limits_at import Stretch
from planning.retiming.retimed import PathToTime
from planning.timing.choice import JERK_RULE
from planning.timing.jerk.state_to_state import JointState
from planning.timing.options import Payload, TimingOptions
from planning.timing.parametrization import TimingReport
from planning.values.limits import EffortLimits
from service.fields import shared

#: What holds where a request says nothing else, and what it may say of its answer alone.
_USUAL, _NOT_OF_TIMING = TimingOptions(), frozenset({"sample_period", "sample_count"})
_QUANTITIES = ("velocity", "acceleration", "jerk", "effort")


def timing_options(timing: Timing, *, several: bool = False) -> TimingOptions:
    """Options of the timing.

    Args:
        timing: The options of a request.
        several: Whether they are of several motions, which have no duration in common.

    Raises:
        InvalidOption: Values that do not go together.
    """
    for name in ("duration", "sample_count"):
        if several and getattr(timing, name) is not None:
            raise InvalidOption(
                f"timing.{name} belongs to one motion, and this request has several",
                hint="Leave it out, or plan or retime the motion by itself.",
            )
    if timing.sample_count is not None and timing.sample_period is not None:
        raise InvalidOption(
            "both timing.sample_count and timing.sample_period are given", hint="Give one."
        )
    if timing.model_fields_set <= _NOT_OF_TIMING:
        return _USUAL
    given = shared(timing, TimingOptions, without=("payload",))
    load = timing.payload
    return TimingOptions(
        **{name: value for name, value in given.items() if value is not None},
        payload=None if load is None else Payload(**shared(load, Payload)),
    )


def given_limits(body: LimitsBody | None, joint_names: Sequence[str]) -> dict[str, Array]:
    """The limits that a request gives, by quantity.

    Raises:
        InvalidOption: A limit is not positive, or their number is wrong.
    """
    rows = {} if body is None else {name: getattr(body, name) for name in _QUANTITIES}
    return {
        name: given_limit(row, name, joint_names) for name, row in rows.items() if row is not None
    }


def given_limit(given: Sequence[float], quantity: str, joint_names: Sequence[str]) -> Array:
    """The limits of one quantity.

    Raises:
        InvalidOption: One is not positive, or their number is wrong.
    """
    if len(given) != len(joint_names) or not all(value > 0.0 for value in given):
        raise InvalidOption(
            f"limits.{quantity} must be {len(joint_names)} positive numbers, one for each joint",
            hint=f"The order is: {', '.join(joint_names)}.",
        )
    return np.array(given, dtype=np.float64)


def limits(body: LimitsBody | None, chain: Chain) -> dict[str, Array]:
    """Limits to hold a trajectory to: those of the request, else those of the robot.

    Where the acceleration jumps, a jerk limit of the robot's is told as one that is not proved, and
    one of a request is broken.

    Raises:
        MissingLimit: A velocity or acceleration limit is known from neither.
        InvalidOption: A limit is not positive, or their number is wrong.
    """
    bounds: dict[str, Array] = {}
    for quantity in ("velocity", "acceleration", "jerk"):
        given = None if body is None else getattr(body, quantity)
        if given is not None:
            bounds[quantity] = given_limit(given, quantity, chain.joint_names)
        elif quantity != "jerk":
            bounds[quantity] = chain.limits.require(quantity, chain.joint_names)
    return bounds


def effort_loads(body: schema.ValidateRequest, chain: Chain) -> EffortLimits | None:
    """Limits of torque and tool speed that a motion is to be held to, where a request gives some.

    Raises:
        InvalidOption: A limit is not positive, their number is wrong, or a load is none of a body.
        MissingLimit: The robot's effort limits are asked for, and one is not known.
    """
    effort = None
    if body.limits is not None and body.limits.effort is not None:
        effort = given_limit(body.limits.effort, "effort", chain.joint_names)
    elif body.torque_limits:
        effort = chain.limits.require("effort", chain.joint_names)
    load = body.payload
    if load is not None:
        chain = with_payload(chain, load.mass, load.center_of_mass, load.inertia, link=load.link)
    if effort is None and body.tool_speed is None and load is None:
        return None
    return EffortLimits(chain, effort, body.tool_speed)


def path_to_time(
    body: retime_schema.RetimePath,
    chain: Chain | None,
    limits_at: Sequence[retime_schema.LimitsAt] | None = None,
) -> PathToTime:
    """The path of a request, with limits along stretches of it.

    Raises:
        InvalidTrajectory: Waypoints of different lengths, or names that do not fit.
        InvalidOption: A stretch has no length or no limit.
    """
    names, points = joint_path(body, chain)
    stretches = tuple(
        Stretch(
            one.begin,
            one.end,
            one.by == "length",
            None if one.velocity is None else np.array(one.velocity),
            None if one.acceleration is None else np.array(one.acceleration),
            one.tool_speed,
        )
        for one in limits_at or ()
    )
    knots = None if body.knots is None else np.array(body.knots, dtype=np.float64)
    return PathToTime(names, points, knots, body.tolerance, stretches)


def equal_rows(
    rows: Sequence[Sequence[float]], name: str, n: int | None = None
) -> Sequence[Sequence[float]]:
    """Rows of a request, checked to have n values each, or as many as the first one.

    Raises:
        InvalidTrajectory: One has another number.
    """
    n = len(rows[0]) if n is None else n
    wrong = next((i for i, row in enumerate(rows) if len(row) != n), None)
    if wrong is not None:
        raise InvalidTrajectory(
            f"{name}[{wrong}] has {len(rows[wrong])} value(s) in place of {n}",
            hint="Give one value for each joint in every row.",
        )
    return rows


def joint_path(body: retime_schema.PathBody, chain: Chain | None) -> tuple[tuple[str, ...], Array]:
    """Names of the joints of a path, and its waypoints (k, n).

    Raises:
        InvalidTrajectory: Waypoints of different lengths, or names that do not fit.
    """
    rows = equal_rows(body.joints, "path.joints", None if chain is None else chain.n)
    n = len(rows[0])
    names = joint_names(body.joint_names, n, chain, "path.")
    return names, np.array(rows, dtype=np.float64)


def joint_names(
    given: Sequence[str] | None, n: int, chain: Chain | None, where: str
) -> tuple[str, ...]:
    """Names of n joints: those of the robot, those given, or numbers.

    Args:
        given: Names that a request gives.
        n: Number of the joints.
        chain: The robot, if there is one.
        where: Place of the names in the request, for messages.

    Raises:
        InvalidTrajectory: Names that do not fit.
    """
    if chain is not None:
        if given is not None and tuple(given) != chain.joint_names:
            raise InvalidTrajectory(
                f"{where}joint_names are not those of the robot in its order",
                hint=f"They are: {', '.join(chain.joint_names)}.",
            )
        return chain.joint_names
    names = tuple(f"joint{i + 1}" for i in range(n)) if given is None else tuple(given)
    if len(names) != n or len(set(names)) != n:
        raise InvalidTrajectory(f"{where}joint_names must be {n} different names")
    return names


def joint_state(body: retime_schema.JointStateBody | None, label: str) -> JointState:
    """A state of a request.

    Args:
        body: The state.
        label: Field of the request, for messages.

    Raises:
        InvalidTrajectory: Its rows have different lengths.
    """
    assert body is not None
    rows = {
        name: None if row is None else np.array(row, dtype=np.float64)
        for name, row in (("velocity", body.velocity), ("acceleration", body.acceleration))
    }
    for name, row in rows.items():
        if row is not None and len(row) != len(body.position):
            raise InvalidTrajectory(
                f"{label}.{name} has {len(row)} value(s) for {len(body.position)} position(s)",
                hint="Give one value for each joint.",
            )
    return JointState(np.array(body.position, dtype=np.float64), **rows)


def timing_answer(
    report: TimingReport | None, motion: Trajectory, begins: float = 0.0
) -> dict[str, Any] | None:
    """Method and limits of a motion's timing as answers give them.

    Args:
        report: Method and limits; None where nothing was timed.
        motion: The motion.
        begins: Time at which it begins [s].
    """
    if report is None:
        return None
    least = report.lower_bound(motion)
    held = [
        {
            "from": begins + begin,
            "to": begins + end,
            **{name: there.bounds[name].tolist() for name in ("velocity", "acceleration")},
            "tool_speed": None if there.effort is None else there.effort.tool_speed,
        }
        for begin, end, there in report.limits_at
    ]
    ruled = {"jerk": {"rule": JERK_RULE, "joints": list(report.ruled_jerk)}}
    return {
        "method": report.method,
        "solver": report.solver,
        "limits": {name: row.tolist() for name, row in report.limits.items()},
        "ruled": ruled if report.ruled_jerk else {},
        "limits_at": held,
        "lower_bound": least or None,
        "gap": motion.duration / least - 1.0 if least else None,
    }
