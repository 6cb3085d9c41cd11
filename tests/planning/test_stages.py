"""Sampling, shortening and rounding, each on its own."""

import numpy as np
import pytest

from kinematics.errors import InvalidOption
from obstacles.collision.checker import Checker
from obstacles.scenes.scene import Scene
from planning.sampling import search
from planning.sampling.planners import PLANNERS
from planning.sampling.search import sample
from planning.search.shortcut import shortcut
from planning.search.straight_line import straight_line
from planning.timing.path.blend import blend, certified_reaches, merge
from planning.values.deadline import Deadline
from tests.planning.scenes import HOME, builtin, pillar

START, GOAL = HOME.copy(), HOME.copy()
START[0], GOAL[0] = -0.9, 0.9
SCENE = pillar(0.0, 0.4)


def sampled(seed: int) -> np.ndarray:
    robot = builtin("panda")
    checker = Checker.of(robot, SCENE)
    result = sample(
        "rrt_connect", robot.chain, checker, START, [GOAL], {}, seed, Deadline.after(30.0)
    )
    assert result.waypoints is not None
    assert "edges checked" in result.detail
    return result.waypoints


def test_straight_line_is_blocked_and_says_by_what() -> None:
    checker = Checker.of(builtin("panda"), SCENE)
    waypoints, motions = straight_line(checker, START, [GOAL])
    assert waypoints is None
    assert motions[0].pair is not None
    assert motions[0].pair[1] == "post"
    waypoints, motions = straight_line(checker, START, [GOAL, START + 0.05])
    assert waypoints is not None
    assert len(motions) == 2


@pytest.mark.parametrize("seed", range(5))
def test_sampled_paths_are_proved_and_reproducible(seed: int) -> None:
    checker = Checker.of(builtin("panda"), SCENE)
    first, second = sampled(seed), sampled(seed)
    assert np.array_equal(first, second)
    assert np.array_equal(first[0], START)
    assert np.array_equal(first[-1], GOAL)
    assert checker.polyline(first)[0].free
    limits = builtin("panda").chain.limits
    assert ((first >= limits.lower) & (first <= limits.upper)).all()


def test_seeds_differ() -> None:
    assert len({sampled(seed).tobytes() for seed in range(4)}) > 1


def test_trees_that_take_long_are_started_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    alone = [sampled(seed) for seed in range(3)]
    monkeypatch.setattr(search, "_FIRST_BUDGET", 8)
    robot = builtin("panda")
    checker = Checker.of(robot, SCENE)
    arguments = ("rrt_connect", robot.chain, checker, START, [GOAL])
    results = [sample(*arguments, {}, seed, Deadline.after(30.0)) for seed in range(3)]
    again = [sample(*arguments, {}, seed, Deadline.after(30.0)) for seed in range(3)]
    for result, same in zip(results, again, strict=True):
        assert result.waypoints is not None
        assert same.waypoints is not None
        assert np.array_equal(result.waypoints, same.waypoints)
        assert checker.polyline(result.waypoints)[0].free
    assert any(
        result.waypoints is not None and not np.array_equal(result.waypoints, path)
        for result, path in zip(results, alone, strict=True)
    )


def test_planner_stops_at_its_deadline_and_checks_its_options() -> None:
    robot = builtin("panda")
    checker = Checker.of(robot, SCENE)
    arguments = ("rrt_connect", robot.chain, checker, START, [GOAL])
    assert sample(*arguments, {}, 0, Deadline.after(-1.0)).waypoints is None
    with pytest.raises(InvalidOption, match="no option 'rage'"):
        sample(*arguments, {"rage": 1.0}, 0, Deadline.after(1.0))
    for wrong in (-1.0, 0.0, "long", float("nan"), True):
        with pytest.raises(InvalidOption, match="range"):
            sample(*arguments, {"range": wrong}, 0, Deadline.after(1.0))
    with pytest.raises(InvalidOption, match="magic"):
        sample("magic", *arguments[1:], {}, 0, Deadline.after(1.0))
    assert "rrt_connect" in PLANNERS


@pytest.mark.parametrize("seed", range(4))
def test_shortcut_shortens_and_stays_proved(seed: int) -> None:
    checker = Checker.of(builtin("panda"), SCENE)
    path = sampled(seed)
    short = shortcut(checker, path, Deadline.after(30.0))
    assert np.array_equal(short, shortcut(checker, path, Deadline.after(30.0)))
    assert np.array_equal(short[[0, -1]], path[[0, -1]])
    assert checker.polyline(short)[0].free
    lengths = [np.linalg.norm(np.diff(points, axis=0), axis=1).sum() for points in (short, path)]
    assert lengths[0] <= lengths[1] + 1e-12


def test_corner_in_free_space_is_dropped_and_one_around_a_post_stays_cut() -> None:
    robot = builtin("planar_rr")
    free = Checker.of(robot, Scene())
    bent = np.array([[0.0, 0.0], [0.5, 0.9], [1.0, 0.0]])
    assert np.array_equal(shortcut(free, bent, Deadline.after(30.0)), bent[[0, 2]])
    straight = np.array([[0.0, 0.0], [0.5, 0.0], [1.0, 0.0]])
    assert np.array_equal(shortcut(free, straight, Deadline.after(30.0)), straight[[0, 2]])
    assert np.array_equal(shortcut(free, bent, Deadline.after(-1.0)), bent[[0, 2]])


def test_rounded_corners_are_proved() -> None:
    checker = Checker.of(builtin("panda"), SCENE)
    points = merge(shortcut(checker, sampled(1), Deadline.after(30.0)))
    reaches = certified_reaches(checker, points, Deadline.after(30.0))
    assert reaches.shape == (len(points) - 2,)
    assert (reaches > 0.0).any()
    path = blend(points, reaches)
    for piece, length in zip(path.coefficients, path.lengths, strict=True):
        b = piece * length ** np.arange(piece.shape[1])
        b2 = b[:, 2] if b.shape[1] > 2 else np.zeros(len(b))
        assert checker.curve(b[:, 0], b[:, 1], b2).free
    late = certified_reaches(checker, points, Deadline.after(-1.0))
    assert not late.any()
