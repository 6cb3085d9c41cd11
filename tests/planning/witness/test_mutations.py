"""Mutations of true witnesses: each is rejected, or it is harmless by the checker's own bounds."""

from collections.abc import Callable
from copy import deepcopy
from typing import Any

import numpy as np
import pytest

from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.fcl_distance import FclWorld
from tests.planning.witness.problems import Proved, planned, rejected

Document = dict[str, Any]
Random = np.random.Generator


def _fact(d: Document, random: Random) -> int:
    return int(random.integers(len(d["facts"]["plane"])))


def turned(d: Document, random: Random) -> None:
    """A plane is turned round."""
    row = d["facts"]["plane"][_fact(d, random)]
    row[3:] = [-x for x in row[3:]]


def dropped(d: Document, random: Random) -> None:
    """A fact is dropped."""
    del d["facts"]["plane"][_fact(d, random)]


def forgotten(d: Document, random: Random) -> None:
    """All facts of a pair are dropped."""
    rows = d["facts"]["plane"]
    pair = rows[_fact(d, random)][:2]
    d["facts"]["plane"] = [row for row in rows if row[:2] != pair]


def swapped(d: Document, random: Random) -> None:
    """The two solids of a fact are swapped."""
    row = d["facts"]["plane"][_fact(d, random)]
    row[:2] = row[1::-1]


def shrunk(d: Document, random: Random) -> None:
    """A cell is shrunk."""
    cell = d["cells"][random.integers(len(d["cells"]))]
    share = random.uniform(0.01, 0.5)
    cell[random.integers(2)] = cell[0] + share * (cell[1] - cell[0])


def widened(d: Document, random: Random) -> None:
    """A cell is taken for all of time."""
    cells = d["cells"]
    k = random.choice([k for k, cell in enumerate(cells) if cell[1] - cell[0] < d["knots"][-1] / 3])
    cells[k] = [0.0, d["knots"][-1]]


def enlarged(d: Document, random: Random) -> None:
    """A solid grows by half a metre."""
    d["solids"][random.integers(len(d["solids"]))]["rounding"] += 0.5


def unallowed(d: Document, random: Random) -> None:
    """A pair that touches may touch no longer."""
    d["may_touch"] = []


def slowed(d: Document, random: Random) -> None:
    """A limit of velocity is below the fastest instant."""
    motion = _trajectory(d)
    times = np.linspace(0.0, motion.duration, 500)
    fastest = np.abs(motion.sample(times, 1)).max(axis=0)
    j = int(random.integers(len(fastest)))
    d["limits"]["velocity"][j] = float(fastest[j] * (1.0 - 1e-5))


def narrowed(d: Document, random: Random) -> None:
    """A limit of position is inside the motion."""
    positions = _trajectory(d).sample(np.linspace(0.0, d["knots"][-1], 500))
    j = int(random.integers(positions.shape[1]))
    d["limits"]["position"][j][0] = float(positions[:, j].min() + 1e-6)


def bent(d: Document, random: Random) -> None:
    """A coefficient is another one."""
    pieces = d["polynomials"]
    row = pieces[random.integers(len(pieces))][random.integers(len(pieces[0]))]
    row[random.integers(3)] += random.choice([-1, 1]) * random.uniform(1e-4, 1e-1)


def misplaced(d: Document, random: Random) -> None:
    """The motion ends elsewhere than it says."""
    d[random.choice(["start", "goal"])][random.integers(2)] += 1e-6


MUTATIONS: tuple[Callable[[Document, Random], None], ...] = (
    turned, dropped, forgotten, swapped, shrunk, widened, enlarged, unallowed, slowed, narrowed,
    bent, misplaced,
)  # fmt: skip


def _trajectory(d: Document) -> Trajectory:
    names = tuple(row["name"] for row in d["joints"] if "follows" not in row)
    return Trajectory(names, np.array(d["knots"]), np.array(d["polynomials"]))


@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda f: f.__name__)
def test_mutations_are_rejected(mutation: Callable[[Document, Random], None]) -> None:
    """Of motions of two arms, each several times."""
    random, harmless = np.random.default_rng(17), 0
    items = [*planned("ur5e", "crowd", 4), planned("panda", "shelf", 2)[1]]
    for item in items:
        for _ in range(3):
            mutant = deepcopy(item.document)
            mutation(mutant, random)
            said = rejected(mutant)
            if said is None:
                harmless += 1
                assert mutation in {dropped, shrunk, widened, enlarged}, mutant["hashes"]
    # Others may hold what a fact or a cell did, and a solid may be far from all; not often.
    assert harmless <= (0 if mutation is dropped else 3)


def _least(item: Proved, obstacle: str) -> float:
    """Least distance of an obstacle at many instants, by FCL [m]."""
    world, times = FclWorld(item.robot, item.scene), np.linspace(0.0, item.trajectory.duration, 60)
    moving = {name for name, j in zip(item.robot.links, item.robot.joints, strict=True) if j >= 0}
    return min(
        world.distance_between(q, (name, obstacle))
        for q in item.trajectory.sample(times)
        for name in moving
    )


def test_a_solid_grows_until_it_would_touch() -> None:
    """Of solids that grow a little at a time, none is accepted that FCL finds too near."""
    random = np.random.default_rng(4)
    accepted = 0
    for item in planned("ur5e", "crowd", 4):
        least = _least(item, "post")
        for grown in random.uniform(0.0, 2.0, 6) * least:
            mutant = deepcopy(item.document)
            row = next(row for row in mutant["solids"] if row["name"] == "post")
            row["rounding"] += float(grown)
            said = rejected(mutant)
            assert said is not None or grown <= least
            accepted += said is None
    assert accepted > 0
