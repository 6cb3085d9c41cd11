"""Each verdict that planners use lies in turn; the certificate refuses every bad motion."""

from functools import cache

import pytest

from obstacles.collision.checker import Checker
from planning.constraints import edge_bounds
from tests.planning.proof.sabotage.cases import names
from tests.planning.proof.sabotage.lies import LIES
from tests.planning.proof.sabotage.trial import Lie, Motion, installed, tried


@cache
def without_lies(name: str) -> tuple[Motion, ...]:
    return tried([name], None)


#: Problems of which nothing is answered where nothing lies.
_WITHOUT_A_WAY = (
    "panda along a blocked line", "panda straight through a post", "panda starting in a box",
    "panda ending in a box",
)  # fmt: skip


@cache
def under(lie: Lie) -> tuple[Motion, ...]:
    # Without lies first: every kernel is compiled then, and none ever with a lie inside.
    for name in lie.cases:
        without_lies(name)
    return tried(lie.cases, lie)


@pytest.mark.parametrize("name", names())
def test_without_a_lie_motions_are_good_and_the_last_is_proved(name: str) -> None:
    motions = without_lies(name)
    if name in _WITHOUT_A_WAY:
        assert motions == ()
        return
    assert motions[-1].believed
    assert not [motion for motion in motions if motion.believed and motion.faults]


@pytest.mark.parametrize("lie", LIES, ids=str)
def test_the_lie_makes_bad_motions(lie: Lie) -> None:
    assert [motion for motion in under(lie) if lie.faults & motion.faults.keys()]


@pytest.mark.parametrize("lie", LIES, ids=str)
def test_the_certificate_refuses_every_bad_motion(lie: Lie) -> None:
    assert not [motion for motion in under(lie) if motion.faults and motion.believed]


@pytest.mark.parametrize("lie", LIES, ids=str)
def test_a_lie_leaves_nothing_behind(lie: Lie) -> None:
    before = Checker.segment, Checker.valid, edge_bounds.edge_kernel
    with installed(lie):
        pass
    assert (Checker.segment, Checker.valid, edge_bounds.edge_kernel) == before
