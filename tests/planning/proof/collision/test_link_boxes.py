"""Boxes about the pieces of links: the proof compares every pair, and says the same with them."""

from itertools import product

import numpy as np
import pytest

from kinematics.trajectory.trajectory import Trajectory
from obstacles.collision.checker import Checker
from obstacles.collision.fcl_distance import FclWorld
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box
from planning.proof.collision import link_boxes, pair_table
from planning.proof.collision.collision_proof import CollisionProof
from planning.proof.collision.pair_table import HOLDER, PairTable
from tests.obstacles.arms import cut_arm

ARM = cut_arm()
SCENE = Scene((Obstacle("box", Box(np.full(3, 0.2)), np.eye(4) + np.eye(4, k=3) * 0.9),))


def forget() -> None:
    """Forget what was packed with boxes about links, or without."""
    kept = (
        link_boxes.link_parts, link_boxes.part_pairs, pair_table._own, pair_table._asked_rows,
        pair_table._asked_of_pieces, pair_table._roots, pair_table._arrays,
    )  # fmt: skip
    for function in kept:
        function.cache_clear()


def below(table: PairTable, k: int) -> list[int]:
    """The elements that hold nothing below one."""
    arrays = table.arrays
    if arrays.kinds[k] != HOLDER:
        return [k]
    kids = arrays.kids[arrays.below[k] : arrays.below[k + 1]]
    return [leaf for kid in kids for leaf in below(table, int(kid))]


@pytest.mark.parametrize("allowed", [frozenset(), frozenset({("base", "two"), ("box", "one")})])
def test_every_pair_of_pieces_hangs_below_one_root(allowed: frozenset[tuple[str, str]]) -> None:
    scene = Scene(SCENE.obstacles, allowed)
    table = PairTable.of(ARM, scene, 0.0)
    pieces, pairs = len(ARM.pieces), list[tuple[int, int]]()
    assert len(table.arrays.roots) < 12
    for i, j in table.arrays.roots.tolist():
        pairs += product(below(table, i), below(table, j))
    own = [(min(p), max(p)) for p in pairs if max(p) < pieces]
    expected = {
        (int(min(p)), int(max(p)))
        for p in ARM.self_pairs
        if not scene.allows(ARM.links[p[0]], ARM.links[p[1]])
    }
    assert len(own) == len(set(own))
    assert set(own) == expected
    against = [j for i, j in pairs if i >= table.arrays.moving]
    met = [
        k for k, link in enumerate(ARM.links) if link != "base" and not scene.allows(link, "box")
    ]
    assert sorted(against) == met


def test_boxes_and_balls_hold_the_pieces_below_them() -> None:
    arrays = PairTable.of(ARM, Scene(), 0.0).arrays
    holders = [k for k in range(arrays.moving) if arrays.kinds[k] == HOLDER]
    assert len(holders) > 20
    for k in holders:
        for kid in arrays.kids[arrays.below[k] : arrays.below[k + 1]]:
            assert arrays.joints[kid] == arrays.joints[k]
            corners = arrays.columns[:, arrays.starts[kid] : arrays.starts[kid + 1]].T
            points = corners @ arrays.poses[kid, :3, :3].T + arrays.poses[kid, :3, 3]
            if len(points):
                assert (np.abs(points - arrays.boxes[k, :3]) <= arrays.boxes[k, 3:] + 1e-12).all()
                away = np.linalg.norm(points - arrays.centers[k], axis=1)
                assert away.max() <= arrays.radii[k] + 1e-12


@pytest.mark.parametrize("length", [0.2, 1.0, 4.0])
def test_motions_are_proved_as_without_boxes(
    length: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Short and long ones, that are free or not, among them some whose ends are just free."""
    random, checker = np.random.default_rng(11), Checker.of(ARM, SCENE)
    world, outcomes = FclWorld(ARM, SCENE), set()
    starts = [q for q in random.uniform(-np.pi, np.pi, (120, 3)) if checker.valid(q)][:14]
    for q in starts:
        step = random.normal(size=3)
        end = q + length * step / np.linalg.norm(step)
        coefficients = np.stack([q, (end - q) / 2.0], axis=1)[None]
        motion = Trajectory(ARM.chain.joint_names, np.array([0.0, 2.0]), coefficients)
        proof = CollisionProof(motion, ARM, SCENE, 0.0, None)
        proof.run()
        forget()
        with monkeypatch.context() as without:
            without.setattr(link_boxes, "_FEW", len(ARM.pieces))
            plain = CollisionProof(motion, ARM, SCENE, 0.0, None)
            plain.run()
        forget()
        assert (proof.violation is None) == (plain.violation is None)
        outcomes.add(proof.violation is None)
        if proof.violation is None:
            for share in np.linspace(0.0, 1.0, 60):
                world.set_configuration(q + share * (end - q))
                assert not world.collisions(q + share * (end - q))
            least = min(proof.clearances)
            assert least >= 0.9 * min(plain.clearances) - 1e-9
        else:
            assert plain.violation is not None
            assert proof.violation.time == pytest.approx(plain.violation.time, abs=1e-3)
    assert True in outcomes
