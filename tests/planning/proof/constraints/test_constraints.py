"""Constraints of whole motions: reports, limits, the first violation."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.polynomial import Chebyshev, Polynomial
from scipy.interpolate import CubicSpline

from kinematics.errors import MissingLimit
from kinematics.forward import forward
from kinematics.model.chain import Chain
from kinematics.robots import builtin_chain
from kinematics.trajectory.trajectory import Trajectory
from planning.constraints import edge_bounds
from planning.constraints.constraint_set import ConstraintSet
from planning.constraints.kinds.constraint import (
    ClearanceConstraint,
    Geometric,
    JointConstraint,
    PositionConstraint,
    SphereRegion,
    ToolSpeedConstraint,
    TorqueConstraint,
)
from planning.constraints.row import WIDTH, Column, Row
from planning.proof.constraints.constraint_limits import constrained_efforts, constrained_margin
from planning.proof.constraints.constraints import check_motion
from planning.proof.constraints.rotation_bounds import pack
from planning.values.limits import EffortLimits
from tests.planning.constraints.samples import some_of_each
from tests.planning.slider import slider

CHAIN = builtin_chain("planar_rr")
FIRST, SECOND = CHAIN.joint_names


def turn(rate: float = 1.0) -> Trajectory:
    """Both joints turn from 0, at ``rate`` and half of it, for a second."""
    c = np.zeros((1, 2, 2))
    c[0, :, 1] = [rate, 0.5 * rate]
    return Trajectory(CHAIN.joint_names, np.array([0.0, 1.0]), c)


def test_what_is_kept_is_reported_with_what_is_to_spare() -> None:
    asked = (JointConstraint(FIRST, 0.0, 1.1, 1.1), JointConstraint(SECOND, 0.0, 0.6, 0.6))
    reports, violation = check_motion(ConstraintSet(CHAIN, asked), turn())
    assert violation is None
    assert [report.constraint for report in reports] == [0, 1]
    for report in reports:
        assert report.hard
        assert report.unit == "rad"
        assert -0.1 - 1e-9 <= report.residual <= -0.1 * 0.99
    assert reports[0].time > 0.9


def test_the_earliest_of_several_violations_is_the_one_told() -> None:
    # The first joint leaves 0.8 at 0.8 s, the second one 0.3 at 0.6 s.
    asked = (JointConstraint(FIRST, 0.0, 0.8, 0.8), JointConstraint(SECOND, 0.0, 0.3, 0.3))
    reports, violation = check_motion(ConstraintSet(CHAIN, asked), turn())
    assert violation is not None
    assert violation.kind == "path_constraint"
    assert violation.details["constraint"] == 1
    assert violation.time == pytest.approx(0.6, abs=1e-4)
    for report in reports:
        assert 0.2 <= report.residual <= 0.2 * 1.01


@pytest.mark.parametrize("second", [0.0, 0.01])
def test_a_slow_motion_is_told_the_millisecond_in_which_it_leaves_its_constraint(
    second: float,
) -> None:
    """q_1 = t / 20 for ten seconds, 0.3 at most: left at 6 s, and 0.2 beyond at the end."""
    c = np.zeros((1, 2, 2))
    c[0, :, 1] = [0.05, second]
    motion = Trajectory(CHAIN.joint_names, np.array([0.0, 10.0]), c)
    asked = ConstraintSet(CHAIN, (JointConstraint(FIRST, 0.0, 0.3, 0.3),))
    (report,), violation = check_motion(asked, motion)
    assert violation is not None
    assert violation.time == pytest.approx(6.0, abs=1e-3)
    assert 0.2 <= report.residual <= 0.2 * 1.01


def test_soft_constraints_are_reported_and_refuse_nothing() -> None:
    asked = (JointConstraint(FIRST, 0.0, 0.5, 0.5, weight=3.0), ClearanceConstraint(0.1))
    reports, violation = check_motion(ConstraintSet(CHAIN, asked), turn())
    assert violation is None
    (report,) = reports
    assert not report.hard
    assert 0.5 <= report.residual <= 0.5 * 1.01


@pytest.mark.parametrize("seed", range(12))
def test_violations_begin_when_they_do_and_get_no_worse_than_told(seed: int) -> None:
    """Cubics of both joints, against residuals at twenty thousand samples."""
    random = np.random.default_rng(seed)
    breaks = np.concatenate([[0.0], np.cumsum(random.uniform(0.2, 5.0, 3))])
    curve = CubicSpline(breaks, random.uniform(-2.0, 2.0, (4, 2)))
    coefficients = np.ascontiguousarray(curve.c[::-1].transpose(1, 2, 0))
    motion = Trajectory(CHAIN.joint_names, breaks, coefficients)
    start = motion.start
    asked = (
        JointConstraint(FIRST, float(start[0]), 0.3, 0.3),
        PositionConstraint(SphereRegion(forward(CHAIN, start)[:3, 3], 0.2)),
    )
    times = np.linspace(0.0, motion.duration, 20_001)
    for constraint in asked:
        wanted = ConstraintSet(CHAIN, (constraint,))
        residuals = wanted.residuals(motion.sample(times)).max(axis=1)
        (report,), violation = check_motion(wanted, motion)
        assert (violation is None) is bool(residuals.max() <= 1e-6)
        assert residuals.max() <= report.residual + 1e-12
        if violation is not None:
            assert report.residual <= 1.01 * residuals.max() + 1e-6
            first = times[int(np.argmax(residuals > 1e-6))]
            assert first - 2.0 * times[1] <= violation.time <= first + 1e-3


def polynomial(chain: Chain, random: np.random.Generator, kind: str) -> Trajectory:
    """Pieces that meet, of random coefficients."""
    pieces, duration, size = {
        "short": (3, 2.0, 6), "long": (4, 100.0, 6), "one long": (1, 100.0, 6), "high": (2, 3.0, 13)
    }[kind]  # fmt: skip
    low, high = chain.sampling_bounds()
    breaks = np.concatenate([[0.0], np.cumsum(random.uniform(0.3, 1.0, pieces))])
    breaks *= duration / breaks[-1]
    coefficients = random.normal(size=(pieces, chain.n, size)) * 0.8 ** np.arange(size)
    q = random.uniform(np.maximum(low, -2.0), np.minimum(high, 2.0))
    for i in range(pieces):
        coefficients[i, :, 0] = q
        q = coefficients[i].sum(axis=1)
        coefficients[i] /= (breaks[i + 1] - breaks[i]) ** np.arange(size)
    return Trajectory(chain.joint_names, breaks, coefficients)


def with_rows(chain: Chain, constraint: Geometric, wider: float) -> ConstraintSet:
    """A hard constraint that is wider in every row."""
    made = ConstraintSet(chain, (replace(constraint, weight=None),))
    rows = [replace(r, lower=r.lower - wider, upper=r.upper + wider) for r in made.rows]
    object.__setattr__(made, "rows", tuple(rows))
    object.__setattr__(made, "packed", np.array([row.packed() for row in rows]))
    return made


def crest(residual: Callable[[float], float], low: float, high: float) -> float:
    """The largest value in an interval, by golden sections."""
    best, share = max(residual(low), residual(high)), 0.5 * (5.0**0.5 - 1.0)
    for _ in range(40):
        a, b = high - share * (high - low), low + share * (high - low)
        at_a, at_b = residual(a), residual(b)
        best = max(best, at_a, at_b)
        low, high = (low, b) if at_a > at_b else (a, high)
    return best


@pytest.mark.parametrize("kind", ["short", "long", "one long", "high"])
@pytest.mark.parametrize("name", ["panda", "ur5e", "stanford", "planar_rr"])
def test_every_kind_of_constraint_is_told_to_the_millisecond_and_to_a_hundredth(
    name: str, kind: str
) -> None:
    """Violated at the very start, at the end, hardly, only touched: against golden sections."""
    chain = builtin_chain(name)
    random = np.random.default_rng([ord(letter) for letter in name + kind])
    motion = polynomial(chain, random, kind)
    times = np.linspace(0.0, motion.duration, 6001)
    violated = 0
    asked = [c for c in some_of_each(chain, int(random.integers(1000))) if c.rows(chain)]
    for case, number in enumerate(random.permutation(len(asked))[:10]):
        given = with_rows(chain, asked[number], 0.0)

        def residual(t: float, of: ConstraintSet = given) -> float:
            return float(of.residuals(motion.sample([t])).max())

        coarse = given.residuals(motion.sample(times)).max(axis=1)
        tops = np.argsort(coarse)[-4:]
        most = max(
            crest(residual, times[max(k - 1, 0)], times[min(k + 1, 6000)]) for k in tops
        )  # fmt: skip
        wider = (coarse[0] - 1e-4, coarse[-1] - 1e-4, most - 1e-5, most, most + 1e-3)[case % 5]
        (report,), violation = check_motion(with_rows(chain, asked[number], wider), motion)
        worst = most - wider
        assert worst - 1e-9 <= report.residual <= worst + max(0.01 * abs(worst), 1e-6), case
        assert (violation is not None) is bool(worst > 1e-6), case
        if violation is None:
            continue
        violated += 1
        assert residual(violation.time) - wider > 1e-6, case
        assert violation.details["residual"] == report.residual
        beyond = coarse - wider > 1e-6
        if not beyond.any():
            continue
        first = float(times[int(np.argmax(beyond))])
        low = max(first - times[1], 0.0)
        for _ in range(40):
            middle = 0.5 * (low + first)
            low, first = (low, middle) if residual(middle) - wider > 1e-6 else (middle, first)
        assert violation.time <= first + 1e-3, case
    assert violated >= 4


def test_a_motion_whose_digits_cancel_is_bounded_all_the_same() -> None:
    """Of degree 24, in powers that cancel: no more than its digits tell can be decided."""
    c = np.zeros((1, 2, 25))
    c[0, 0] = Chebyshev.basis(24, domain=[0.0, 1.0]).convert(kind=Polynomial).coef
    motion = Trajectory(CHAIN.joint_names, np.array([0.0, 1.0]), c)
    asked = ConstraintSet(CHAIN, (JointConstraint(FIRST, 0.0, 0.999, 0.999),))
    (report,), violation = check_motion(asked, motion)
    assert violation is not None
    assert report.residual >= 1e-3


def test_what_planners_say_of_their_edges_is_not_believed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(edge_bounds, "edge_holds", lambda *_: True)
    monkeypatch.setattr(edge_bounds, "edge_kernel", lambda *_: (edge_bounds.EdgeVerdict.HOLDS, 1.0))
    asked = (JointConstraint(FIRST, 0.0, 0.9, 0.9),)
    assert check_motion(ConstraintSet(CHAIN, asked), turn())[1] is not None


PANDA = builtin_chain("panda")


def given(
    *constraints: ClearanceConstraint | ToolSpeedConstraint | TorqueConstraint,
) -> ConstraintSet:
    """Constraints on the Panda."""
    return ConstraintSet(PANDA, constraints)


def test_the_largest_clearance_counts() -> None:
    both = given(ClearanceConstraint(0.01), ClearanceConstraint(0.03))
    assert constrained_margin(0.02, both) == 0.03
    assert constrained_margin(0.05, both) == 0.05
    assert constrained_margin(0.02, None) == 0.02


def test_the_strictest_limit_of_each_kind_counts() -> None:
    first, second = [80.0, 10.0, 90.0, 90.0, 10.0, 10.0, 10.0], [20.0] * 7
    asked = given(
        ToolSpeedConstraint(0.5), ToolSpeedConstraint(0.2),
        TorqueConstraint(first), TorqueConstraint(second),
    )  # fmt: skip
    limits = constrained_efforts(None, asked, PANDA)
    assert limits is not None
    assert limits.tool_speed == 0.2
    assert limits.effort is not None
    assert np.array_equal(limits.effort, np.minimum(first, second))
    stricter = EffortLimits(PANDA, np.full(7, 15.0), 0.1)
    limits = constrained_efforts(stricter, asked, PANDA)
    assert limits is not None
    assert limits.tool_speed == 0.1
    assert limits.effort is not None
    assert np.array_equal(limits.effort, np.minimum(np.minimum(first, second), 15.0))


def test_torques_without_numbers_are_the_robots() -> None:
    limits = constrained_efforts(None, given(TorqueConstraint()), PANDA)
    assert limits is not None
    assert limits.effort is not None
    assert np.array_equal(limits.effort, PANDA.limits.effort)
    assert limits.tool_speed is None


def test_limits_are_as_given_where_no_constraint_says_more() -> None:
    loads = EffortLimits(PANDA, np.full(7, 15.0), 0.1)
    assert constrained_efforts(loads, None, PANDA) is loads
    assert constrained_efforts(loads, given(ClearanceConstraint(0.1)), PANDA) is loads
    assert constrained_efforts(None, None, PANDA) is None


def test_a_torque_limit_that_is_not_known_is_named() -> None:
    unknown = replace(PANDA, limits=replace(PANDA.limits, effort=np.full(7, np.nan)))
    with pytest.raises(MissingLimit):
        constrained_efforts(None, ConstraintSet(unknown, (TorqueConstraint(),)), unknown)


VECTORS = {
    "point": Column.POINT,
    "axis": Column.AXIS,
    "center": Column.CENTER,
    "direction": Column.DIRECTION,
}


def rows() -> tuple[Row, ...]:
    both = (JointConstraint("jy", 0.2, 0.1, 0.3), JointConstraint("jx", -0.5, 0.0, 0.25))
    random = np.random.default_rng(1)
    # All that rows of joints leave at zero is given a value of its own.
    return tuple(
        replace(
            row, reference=k, point=random.normal(size=3), axis=random.normal(size=3),
            center=random.normal(size=3), direction=random.normal(size=3),
            turn=random.normal(size=(3, 3)),
        )
        for k, row in enumerate(ConstraintSet(slider().chain, both).rows)
    )  # fmt: skip


def test_every_number_is_in_its_column() -> None:
    packed = pack(rows())
    assert packed.shape == (2, WIDTH)
    for line, row in zip(packed, rows(), strict=True):
        assert line[Column.KIND] == row.kind
        assert line[Column.CARRIER] == row.carrier
        assert line[Column.REFERENCE] == row.reference
        for name, first in VECTORS.items():
            np.testing.assert_array_equal(line[first : first + 3], getattr(row, name))
        assert (line[Column.LOWER], line[Column.UPPER]) == (row.lower, row.upper)
        np.testing.assert_array_equal(line[Column.TURN :].reshape(3, 3), row.turn)


def test_bounds_are_those_that_were_asked_for() -> None:
    packed = pack(rows())
    assert packed[:, Column.LOWER] == pytest.approx([-0.1, -0.75])
    assert packed[:, Column.UPPER] == pytest.approx([0.3, -0.5])


def test_columns_do_not_overlap() -> None:
    sizes = {Column.POINT: 3, Column.AXIS: 3, Column.CENTER: 3, Column.DIRECTION: 3, Column.TURN: 9}
    at = 0
    for column in Column:
        assert column == at
        at += sizes.get(column, 1)
    assert at == WIDTH


def test_no_rows_pack_to_nothing() -> None:
    assert pack(()).shape == (0, WIDTH)
