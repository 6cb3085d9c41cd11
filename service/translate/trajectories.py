"""Trajectories from wire to domain and back."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from armwright_wire.motions import trajectory as schema
from kinematics.arrays import Array
from kinematics.errors import InvalidOption, InvalidTrajectory
from kinematics.model.chain import Chain, Limits
from kinematics.trajectory.trajectory import MAX_DEGREE, Trajectory, interpolate
from service.fields import picked

#: Samples of one answer: at a kilobyte each, a hundred megabytes.
_MAX_SAMPLES = 100_000
#: Rounding error of summed times, as part of the duration.
_TIME_ROUNDING = 1e-9


def trajectory(body: schema.TrajectoryBody, chain: Chain) -> tuple[Trajectory, float]:
    """The domain's trajectory with the robot's joints in their order, and when it begins [s].

    Raises:
        InvalidTrajectory: Joints or lengths do not fit the robot, or times do not ascend.
        InvalidOption: The interpolation is unknown, or what it needs is not given.
    """
    order = _order(body.joint_names, chain)
    if body.segments is not None:
        return _from_segments(body.segments, chain, order), body.segments[0].t0
    samples = body.samples
    assert samples is not None
    position, *rates = (
        None if given is None else _columns(given, name, chain, order)
        for name, given in picked(samples, "position", "velocity", "acceleration").items()
    )
    assert position is not None
    times, names = np.array(samples.time), chain.joint_names
    made = interpolate(names, times, position, body.interpolation or "", *rates)
    return made, samples.time[0]


def answered_body(motion: Mapping[str, Any]) -> schema.TrajectoryBody:
    """The motion of an answer as a request has it.

    Args:
        motion: The field ``trajectory`` of the answer.

    Raises:
        LookupError: It is no motion.
        ValueError: It is malformed.
    """
    fields = {name: motion[name] for name in ("joint_names", "segments")}
    return schema.TrajectoryBody.model_validate(fields)


def answered_trajectory(motion: Mapping[str, Any], chain: Chain) -> tuple[Trajectory, float]:
    """The motion of an answer, and when it begins [s]; raises as `answered_body`.

    Args:
        motion: The field ``trajectory`` of the answer.
        chain: Chain of the robot.
    """
    return trajectory(answered_body(motion), chain)


def named_trajectory(body: schema.TrajectoryBody) -> Trajectory:
    """The domain's trajectory of a motion that names its joints, for which no robot is needed.

    Raises:
        InvalidTrajectory: Joints or lengths do not fit each other, or times do not ascend.
        InvalidOption: The interpolation is unknown, or what it needs is not given.
    """
    assert body.joint_names is not None
    names = tuple(body.joint_names)
    if len(set(names)) != len(names):
        raise InvalidTrajectory(
            "trajectory.joint_names: a joint is named twice", hint="Name each joint once."
        )
    return trajectory(body, _nameless(names))[0]


def _nameless(names: tuple[str, ...]) -> Chain:
    """A chain of joints that are only known by their names."""
    n = len(names)
    offsets = np.broadcast_to(np.eye(4), (n, 4, 4))
    types = np.zeros(n, dtype=np.int64)
    limits = Limits.unlimited(n)
    return Chain("", names, types, offsets, (), "", "", limits, np.zeros(n, dtype=np.bool_))


def _order(joint_names: Sequence[str] | None, chain: Chain) -> list[int]:
    """Index in the trajectory of each joint of the chain."""
    names = list(chain.joint_names if joint_names is None else joint_names)
    if sorted(names) != sorted(chain.joint_names):
        raise InvalidTrajectory(
            f"the trajectory is of the joints {', '.join(names)}",
            hint=f"Robot {chain.name!r} has: {', '.join(chain.joint_names)}; name each once.",
            joint_names=list(chain.joint_names),
        )
    return [names.index(name) for name in chain.joint_names]


def _columns(rows: Sequence[Sequence[float]], name: str, chain: Chain, order: list[int]) -> Array:
    wrong = next((i for i, row in enumerate(rows) if len(row) != chain.n), None)
    if wrong is not None:
        raise InvalidTrajectory(
            f"samples.{name}[{wrong}] has {len(rows[wrong])} value(s), robot {chain.name!r} has "
            f"{chain.n} joints",
            hint="One value for each joint, in the order of joint_names.",
        )
    return np.asarray(np.array(rows, dtype=np.float64)[:, order])


def _from_segments(
    segments: Sequence[schema.Segment], chain: Chain, order: list[int]
) -> Trajectory:
    size = max(len(row) for segment in segments for row in segment.coefficients)
    if size > MAX_DEGREE + 1:
        raise InvalidTrajectory(f"segments have up to {size} coefficients", hint="Take fewer.")
    coefficients = np.zeros((len(segments), chain.n, size))
    slack = _TIME_ROUNDING * (segments[-1].t1 - segments[0].t0)
    for i, segment in enumerate(segments):
        if len(segment.coefficients) != chain.n:
            raise InvalidTrajectory(
                f"segments[{i}] is of {len(segment.coefficients)} joint(s), robot {chain.name!r} "
                f"has {chain.n}",
                hint="Give coefficients[joint][power], the joints in the order of joint_names.",
            )
        if i > 0 and abs(segment.t0 - segments[i - 1].t1) > slack:
            raise InvalidTrajectory(
                f"segments[{i}] begins at {segment.t0:g} s, the one before ends at "
                f"{segments[i - 1].t1:g} s",
                hint="Each segment begins where the one before ends.",
            )
        for j, place in enumerate(order):
            row = segment.coefficients[place]
            coefficients[i, j, : len(row)] = row
    breaks = np.array([segments[0].t0, *(segment.t1 for segment in segments)])
    return Trajectory(chain.joint_names, breaks - breaks[0], coefficients)


def trajectory_answer(
    timed: Trajectory, period: float | None, begins: float = 0.0, count: int | None = None
) -> dict[str, Any]:
    """A trajectory as answers give it.

    Args:
        timed: The trajectory.
        period: Period of samples [s]; none are answered where None.
        begins: Time at which the trajectory begins [s].
        count: Number of samples, in place of a period.

    Raises:
        InvalidOption: The period would give too many samples.
    """
    breaks, pieces = (timed.breaks + begins).tolist(), timed.coefficients.tolist()
    answer: dict[str, Any] = {
        "joint_names": list(timed.joint_names),
        "duration": timed.duration,
        "segments": [
            {"t0": t0, "t1": t1, "coefficients": rows}
            for t0, t1, rows in zip(breaks, breaks[1:], pieces, strict=False)
        ],
        "samples": None,
    }
    if count is not None:
        period = timed.duration / (count - 1)
    if period is not None:
        answer["samples"] = _samples(timed, period, begins)
    return answer


def _samples(timed: Trajectory, period: float, begins: float) -> dict[str, Any]:
    if timed.duration / period > _MAX_SAMPLES:
        raise InvalidOption(
            f"timing.sample_period: {period:g} s over {timed.duration:g} s gives more than "
            f"{_MAX_SAMPLES} samples",
            hint=f"Give at least {timed.duration / _MAX_SAMPLES:.3g} s.",
        )
    times = timed.uniform_samples(period)
    return {
        "time": (times + begins).tolist(),
        "position": timed.sample(times).tolist(),
        "velocity": timed.sample(times, 1).tolist(),
        "acceleration": timed.sample(times, 2).tolist(),
    }
