"""Limits along stretches of a path: each is held there, and only there."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

import armwright as aw
from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from planning.proof.certificate import certify_limits
from planning.values.limits import LimitsBetween, MotionLimits
from tests.planning.retiming.test_near_exact_paths import METHODS

ON_PATH = METHODS[:6]
LIMITS: dict[str, Any] = {"velocity": [2.0, 2.0], "acceleration": [8.0, 8.0], "jerk": [200.0] * 2}
BEND = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [2.0, 1.5]])


def retimed(points: Array, stretches: Sequence[aw.Stretch], **options: Any) -> aw.Retimed:
    tolerance = options.pop("tolerance", None)
    limits = options.pop("limits", LIMITS)
    return aw.retime(
        points, limits=limits, timing_options=aw.TimingOptions(**options), tolerance=tolerance,
        limits_at=stretches,
    )  # fmt: skip


def along(begin: float, end: float, by_length: bool = False, **limits: Any) -> aw.Stretch:
    """A stretch whose limits are lists or numbers."""
    given = {name: np.asarray(row) for name, row in limits.items() if name != "tool_speed"}
    return aw.Stretch(begin, end, by_length, **(limits | given))


def lengths(points: Array) -> Array:
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


@pytest.mark.parametrize("method", ON_PATH, ids=lambda one: "-".join(one.values()) or "usual")
def test_each_stretch_keeps_its_limits_at_every_instant(method: dict[str, Any]) -> None:
    rng = np.random.default_rng(ON_PATH.index(method))
    slowed = 0
    for _ in range(25):
        n, k = int(rng.integers(1, 7)), int(rng.integers(2, 12))
        points = np.cumsum(rng.normal(size=(k, n)), axis=0)
        limits = {"velocity": rng.uniform(0.5, 3.0, n), "acceleration": rng.uniform(2.0, 15.0, n)}
        limits["jerk"] = 10.0 ** rng.uniform(1.0, 3.0) * limits["acceleration"]
        at, stretches, ends = lengths(points), [], []
        for _ in range(int(rng.integers(1, 5))):
            by_length = bool(rng.random() < 0.5)
            most = at[-1] if by_length else k - 1
            begin, end = np.sort(rng.uniform(0.0, most, 2))
            if not by_length and rng.random() < 0.6:
                begin, end = np.floor(begin), np.ceil(end)
            v, a = rng.uniform(0.02, 2.0, n), rng.uniform(0.5, 10.0, n)
            stretches.append(aw.Stretch(begin, end, by_length, v, a))
            ends.append((begin, end) if by_length else np.interp((begin, end), np.arange(k), at))
        found = retimed(points, stretches, limits=limits, **method)
        assert found.certificate.verified
        assert found.lower_bound <= found.trajectory.duration
        free = retimed(points, (), limits=limits, **method)
        slowed += found.trajectory.duration > 1.01 * free.trajectory.duration
        # Straight lines are followed exactly: the way gone tells the place.
        motion = found.trajectory
        times = np.unique(np.linspace(motion.breaks[:-1], motion.breaks[1:], 9))
        q, rates, pushes = (motion.sample(times, order) for order in range(3))
        place = lengths(q)
        assert place[-1] == pytest.approx(at[-1], rel=1e-6)
        for stretch, (begin, end) in zip(stretches, ends, strict=True):
            hair = 1e-5 * at[-1]
            inside = (begin + hair < place) & (place < end - hair)
            assert stretch.velocity is not None
            assert stretch.acceleration is not None
            assert (np.abs(rates[inside]) <= stretch.velocity * (1.0 + 1e-9)).all()
            assert (np.abs(pushes[inside]) <= stretch.acceleration * (1.0 + 1e-9)).all()
        if method.get("method") == "toppra":
            assert found.trajectory.duration < 1.1 * found.lower_bound
    assert slowed > 15


def test_the_tools_speed_is_held_along_a_stretch() -> None:
    robot, rng = aw.load_robot("ur5e"), np.random.default_rng(2)
    for method in ({"method": "toppra"}, {"method": "jerk_limited"}, {}):
        points = np.array([0.0, -1.4, 1.2, -1.0, 0.3, 0.1]) + rng.uniform(-0.4, 0.4, (5, 6))
        options = aw.TimingOptions(**method)  # type: ignore[arg-type]
        stretch = along(1, 3, tool_speed=0.1)
        limits = {"jerk": np.full(6, 100.0)}
        found = aw.retime(points, robot, timing_options=options, limits=limits, limits_at=[stretch])
        assert found.certificate.verified
        assert found.certificate.limits["tool_speed"].worst_ratio <= 1.0 + 1e-9
        assert found.timing is not None
        ((begin, end, _),) = found.timing.limits_at
        for first, last, fast in ((begin, end, False), (0.0, begin, True)):
            times = np.linspace(first, last, 2000)
            tips = aw.fk(robot, found.trajectory.sample(times))[:, :3, 3]
            speed = np.linalg.norm(np.diff(tips, axis=0), axis=1) / np.diff(times)
            assert (speed.max() > 0.15) if fast else (0.08 < speed.max() < 0.1 * (1.0 + 1e-6))


def test_where_stretches_overlap_the_tighter_limits_hold() -> None:
    narrow, wide = [0.3, 0.5], [0.6, 0.2]
    both = [along(0, 2, velocity=narrow), along(1, 3, velocity=wide)]
    apart = [
        along(0, 1, velocity=narrow),
        along(1, 2, velocity=[0.3, 0.2]),
        along(2, 3, velocity=wide),
    ]
    for options in ({"method": "toppra"}, {"method": "jerk_limited"}):
        first, second = retimed(BEND, both, **options), retimed(BEND, apart, **options)
        assert first.trajectory.duration == pytest.approx(second.trajectory.duration, rel=1e-9)
    # Wider limits than those of the whole motion change nothing.
    wider = retimed(BEND, [along(0, 3, velocity=[9.0, 9.0])], method="toppra")
    free = retimed(BEND, (), method="toppra")
    assert wider.trajectory.duration == pytest.approx(free.trajectory.duration, rel=1e-7)


@pytest.mark.parametrize("method", ["toppra", "jerk_limited"])
def test_a_stretch_takes_in_the_curves_at_its_ends(method: str) -> None:
    stretch = along(1, 2, velocity=[0.1, 0.1])
    found = retimed(BEND, [stretch], method=method, blend_tolerance=0.05)
    assert found.timing is not None
    ((begin, end, _),) = found.timing.limits_at
    before, after = found.trajectory.sample([begin, end])
    assert before[1] == pytest.approx(0.0, abs=1e-9)
    assert before[0] < 0.95
    assert after[0] > 1.02
    assert after[1] - 1.0 == pytest.approx(0.5 * (after[0] - 1.0), abs=1e-9)


@pytest.mark.parametrize("method", ["toppra", "jerk_limited"])
def test_stretches_of_a_spline_begin_at_waypoints(method: str) -> None:
    rng = np.random.default_rng(4)
    points = np.cumsum(rng.normal(size=(7, 2)), axis=0)
    stretch = along(2, 4, velocity=[0.2, 0.2], acceleration=[1.0, 1.0])
    found = retimed(points, [stretch], method=method, interpolation="clamped_spline")
    assert found.certificate.verified
    assert found.timing is not None
    ((begin, end, _),) = found.timing.limits_at
    np.testing.assert_allclose(found.trajectory.sample([begin, end]), points[[2, 4]], atol=1e-9)
    times = np.linspace(begin, end, 1000)
    assert np.abs(found.trajectory.sample(times, 1)).max() <= 0.2 * (1.0 + 1e-9)
    longer = retimed(
        points, [stretch], method=method, interpolation="clamped_spline", duration=60.0
    )
    assert longer.certificate.verified
    assert longer.trajectory.duration == 60.0


def test_a_certificate_judges_each_part_by_its_own_limits() -> None:
    motion = retimed(BEND, (), method="toppra").trajectory
    rng = np.random.default_rng(1)
    for _ in range(50):
        begin, end = np.sort(rng.uniform(0.0, motion.duration, 2))
        begin, end = (begin, motion.duration) if rng.random() < 0.3 else (begin, end)
        most = np.abs(motion.sample(np.linspace(begin, end, 4000), 1)).max(axis=0)
        for share, holds in ((1.001, True), (0.99, False)):
            own = MotionLimits({"velocity": share * most + 1e-6})
            wanted = MotionLimits(LIMITS, None, False, (LimitsBetween(begin, end, own),))
            proof = certify_limits(motion, None, wanted)
            assert proof.verified is holds
            if proof.violation is not None:
                assert begin <= proof.violation.time <= end


def test_odd_stretches_are_refused() -> None:
    for ends, said in (
        ((2, 2), "has no length"),
        ((2, 1), "has no length"),
        ((-1, 1), "has no length"),
        ((0, np.nan), "has no length"),
    ):
        with pytest.raises(InvalidOption, match=said):
            along(*ends, velocity=[1.0, 1.0])
    with pytest.raises(InvalidOption, match="has no limit"):
        along(0, 1)
    with pytest.raises(InvalidOption, match="not positive"):
        along(0, 1, velocity=[0.0, 1.0])
    whole = along(0, 3, velocity=[1.0, 1.0])
    for points, stretch, options, said in (
        (BEND, along(0, 4, velocity=[1.0, 1.0]), {}, "ends at 4, and the path at 3"),
        (BEND, along(0, 9, True, velocity=[1.0, 1.0]), {}, "ends at 9, and the path at 3.11"),
        (BEND[[0, 1, 1, 2]], along(1, 2, velocity=[1.0, 1.0]), {}, "has no length"),
        (BEND[[0, 0]], whole, {}, "ends at 3"),
        (BEND, along(0, 1, velocity=[1.0]), {}, r"1 value\(s\) for 2"),
        (BEND, along(0, 1, tool_speed=0.1), {}, "needs a robot"),
        (BEND, whole, {"method": "spline"}, "belongs to methods that follow a path"),
    ):
        with pytest.raises(InvalidOption, match=said):
            retimed(points, [stretch], **options)
    with pytest.raises(InvalidOption, match="stops"):
        aw.retime(BEND, limits=LIMITS, limits_at=[whole], stops="path")
