"""The environment of Gymnasium: its own checker, and a gate that agents can't get around."""

import runpy
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.utils.env_checker import check_env

EXAMPLE = runpy.run_path(str(Path(__file__).parents[3] / "examples/guard_gymnasium.py"))


def environment() -> Any:
    return EXAMPLE["GuardedReach"]()


def test_gymnasium_takes_it_for_an_environment() -> None:
    check_env(environment(), skip_render_check=True)


def test_an_agent_that_wants_into_the_wall_is_stopped_in_front_of_it() -> None:
    arm = environment()
    arm.reset(seed=3)
    forwards = np.array([0.0, 1.0, 0.0, 0.7, 0.0, 0.0, 0.0])
    accepted = []
    for _ in range(60):
        seen, reward, _, _, told = arm.step(forwards)
        assert told["proved"]
        assert arm.observation_space.contains(seen)
        assert arm.clearance() > 0.0
        assert reward < 0.0
        accepted.append(told["accepted"])
    assert accepted[0]
    assert not accepted[-1]
    assert arm.clearance() < 0.09
    np.testing.assert_allclose(seen[7:14], 0.0, atol=1e-9)


def test_the_example_is_safe_with_a_random_agent() -> None:
    assert EXAMPLE["run"](40, 1)
