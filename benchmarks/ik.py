"""Inverse kinematics beside its peers in one run: success, median and p99 a call from Python.

``python -m benchmarks.ik --peers PYTHON`` where PYTHON is an interpreter that has (some of)
pytracik, roboticstoolbox-python, EAIK and ik-geo; without it only ours is measured. Success means
1e-6 m, 1e-6 rad and all joint limits, judged by pinocchio. ``--poses`` and ``--edges`` say how many
poses ours is tried on, ``--shared`` how many of each all of them are timed on.
"""

import argparse
import subprocess
import tempfile
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin

from armwright.model import ik
from benchmarks.peers.ik_peers import time_calls
from benchmarks.problems.poses import edge_configurations, random_configurations
from benchmarks.rounds import once, rounds
from kinematics.arrays import Array
from kinematics.forward import forward
from kinematics.ik.closed_form.analytic import Branches, branches
from kinematics.ik.closed_form.structure import structure
from kinematics.ik.numeric.numeric import AXES, Axis, SearchOptions, solve, solve_many
from kinematics.ik.ranking import whole_turns
from kinematics.jacobian import geometric
from kinematics.model.chain import Chain
from kinematics.pose import to_quaternions
from kinematics.robots import builtin_chain, builtin_urdf

Answer = TypeVar("Answer")
ROBOTS = ("panda", "ur5e", "kr6_sixx", "puma560", "iiwa14", "scara")
NUMERIC_PEERS = ("TRAC-IK", "toolbox ik_LM")
ANALYTIC_PEERS = ("EAIK", "ik-geo")
POSITION_AND_YAW: tuple[Axis, ...] = ("x", "y", "z", "rz")
#: Rounding of a judge's own arithmetic, relative to the tolerance.
_ROOM = 1.001
#: Batches are timed so often, and the closed form beside its peers.
_ROUNDS, _TURNS = 15, 7


class Judge:
    """Errors of configurations by pinocchio."""

    def __init__(self, chain: Chain, name: str) -> None:
        self._model = pin.buildModelFromXML(builtin_urdf(name))
        self._data = self._model.createData()
        self._frame = self._model.getFrameId(chain.tip_link)
        self._chain = chain

    def good(self, q: Array, T: Array, tolerance: float = 1e-6) -> bool:
        """Whether a configuration reaches the pose inside the limits."""
        lower, upper = self._chain.limits.lower, self._chain.limits.upper
        if (q < lower - 1e-12).any() or (q > upper + 1e-12).any():
            return False
        position, orientation = self.errors(q, T)
        return max(position, orientation) <= tolerance * _ROOM

    def errors(self, q: Array, T: Array) -> tuple[float, float]:
        """Distance [m] and angle [rad]."""
        pin.framesForwardKinematics(self._model, self._data, q)
        reached = self._data.oMf[self._frame]
        turn = pin.log3(reached.rotation.T @ T[:3, :3])
        away = reached.translation - T[:3, 3]
        return float(np.linalg.norm(away)), float(np.linalg.norm(turn))


def time_each(call: Callable[..., Answer], *columns: Iterable[Any]) -> tuple[list[Answer], Array]:
    """Answers of a call to each row of some columns, and the times that they took [us]."""
    rows = list(zip(*columns, strict=True))
    return time_calls(lambda k: call(*rows[k]), len(rows))


def ask_peers(
    python: str | None, name: str, chain: Chain, poses: Array, starts: Array, peers: tuple[str, ...]
) -> dict[str, Any]:
    """What the peers answer to the same poses, in their own interpreter."""
    if python is None:
        return {}
    form = structure(chain)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "case.npz"
        np.savez(
            path, poses=poses, starts=starts, quaternions=to_quaternions(poses[:, :3, :3]),
            lower=chain.limits.lower, upper=chain.limits.upper, types=chain.joint_types,
            offsets=chain.offsets, tip_offset=chain.tip.T_joint_link, urdf=builtin_urdf(name),
            tip=chain.tip_link, base=chain.base_link, kind="" if form is None else form.kind,
        )  # fmt: skip
        script = str(Path(__file__).parent / "peers" / "ik_peers.py")
        subprocess.run([python, script, str(path), *peers], check=True)
        with np.load(path.with_suffix(".answers.npz"), allow_pickle=False) as told:
            return {key: told[key] for key in told.files}


def split(told: dict[str, Any], peer: str) -> list[Array]:
    """A peer's solutions pose by pose."""
    ends = np.cumsum(told[f"{peer}: counts"])[:-1]
    return np.split(told[f"{peer}: joints"], ends)


def numeric(name: str, options: argparse.Namespace) -> None:
    """The numeric method on one robot: all poses, then beside the peers."""
    chain = builtin_chain(name)
    judge = Judge(chain, name)
    search = SearchOptions(axes=AXES if chain.n >= 6 else POSITION_AND_YAW)
    sets = {
        "random": random_configurations(chain, options.poses, 1),
        "edges": edge_configurations(chain, options.edges, 2),
    }
    for kind, q in sets.items():
        poses = forward(chain, q)
        starts = random_configurations(chain, len(q), 3)
        found, spent = time_each(
            lambda T, start: solve(chain, T, search, seed_joints=start), poses, starts
        )
        failures = [
            k
            for k, result in enumerate(found)
            if not result.solutions or not judge.good(result.solutions[0].joints, poses[k])
        ]
        steps = [result.nearest.iterations for result in found]
        print(
            f"{name:9s} numeric {kind:7s} {len(q):6d} poses  success "
            f"{100 * (1 - len(failures) / len(q)):.3f} %  median {np.median(spent):6.1f} us  "
            f"p99 {np.percentile(spent, 99):6.1f} us  steps {np.median(steps):.0f}"
        )
        for k in failures[:10]:
            print(f"    failed: {np.array2string(q[k], precision=4)}  {found[k].advice}")
        m = min(options.shared, len(q))
        told = ask_peers(options.peers, name, chain, poses[:m], starts[:m], NUMERIC_PEERS)
        ours = float(np.median(spent[:m]))
        report_peers(told, NUMERIC_PEERS, judge, poses[:m], ours)
    poses = forward(chain, sets["random"][:1000])
    starts = random_configurations(chain, len(poses), 3)
    report_batch(chain, poses, starts, search)


def report_batch(chain: Chain, poses: Array, starts: Array, options: SearchOptions) -> None:
    """Print what a pose of a batch costs beside single calls from the same seeds."""
    medians: list[float] = []

    def single() -> None:
        _, spent = time_each(
            lambda T, start: solve(chain, T, options, seed_joints=start), poses, starts
        )
        medians.append(float(np.median(spent)))

    batch = partial(solve_many, chain, poses, options, seed_joints=starts, threads=1)
    spent = rounds({"batch": batch, "single": single}, _ROUNDS)
    one, alone = (float(np.median(values)) / len(poses) for values in spent.values())
    median = np.median(medians)
    print(
        f"{chain.name:9s} numeric batch of {len(poses)}: {one:.2f} us of processor time a pose, "
        f"one thread; single calls {alone:.2f} on average, {median:.2f} in the median: "
        f"{alone / one:.2f} x and {median / one:.2f} x"
    )


def answered(told: dict[str, Any], peers: tuple[str, ...]) -> list[str]:
    """Peers that have answered; prints why others were left out."""
    for peer in peers:
        if f"{peer}: missing" in told:
            print(f"    {peer}: left out, {told[f'{peer}: missing']}")
    return [peer for peer in peers if f"{peer}: spent" in told]


def report_peers(
    told: dict[str, Any], peers: tuple[str, ...], judge: Judge, poses: Array, ours: float
) -> None:
    """Print what the peers did on the shared poses."""
    for peer in answered(told, peers):
        spent = told[f"{peer}: spent"]
        good = [
            any(judge.good(q, T, 1.5e-6) for q in rows)
            for rows, T in zip(split(told, peer), poses, strict=True)
        ]
        median = float(np.median(spent))
        print(
            f"    {peer:14s} {len(poses):5d} poses  success {100 * np.mean(good):.2f} %  median "
            f"{median:7.1f} us  p99 {np.percentile(spent, 99):8.1f} us   ours / theirs = "
            f"1 / {median / ours:.1f}"
        )


def analytic(name: str, options: argparse.Namespace) -> None:
    """The closed form of one robot: completeness and time, beside the peers."""
    chain = builtin_chain(name)
    judge = Judge(chain, name)

    def solve_branches(T: Array, seed: Array | None) -> Branches:
        return branches(chain, T, seed_joints=seed)

    for kind, q in {
        "random": random_configurations(chain, options.poses, 4),
        "edges": edge_configurations(chain, options.edges, 5),
    }.items():
        poses = forward(chain, q)
        form = structure(chain)
        seeds = q if form is not None and form.redundant else None
        held = [None] * len(q) if seeds is None else q
        found, spent = time_each(solve_branches, poses, held)
        unanswered = [k for k, table in enumerate(found) if not table.within_limits.any()]
        worst = max(
            float(judge_worst(judge, table.joints, poses[k])) for k, table in enumerate(found)
        )
        few, some = poses[:1000], None if seeds is None else seeds[:1000]
        batch = partial(branches, chain, few, seed_joints=some, threads=1)
        batched = once(batch, _ROUNDS) / len(few)
        copies = np.mean([
            sum(len(whole_turns(chain, row, 10_000)) for row in table.joints[table.within_limits])
            for table in found[:200]
        ])  # fmt: skip
        print(
            f"{name:9s} analytic {kind:7s} {len(q):6d} poses  answered "
            f"{100 * (1 - len(unanswered) / len(q)):.3f} %  branches "
            f"{np.mean([len(table.table) for table in found]):.2f} (with whole turns {copies:.1f})"
            f"  worst error {worst:.1e}  median {np.median(spent):5.2f} us  p99 "
            f"{np.percentile(spent, 99):5.1f} us  in batch, one thread "
            f"{batched:.2f} us"
        )
        for k in unanswered[:10]:
            print(f"    unanswered: {np.array2string(q[k], precision=6)}")
        m = min(options.shared, len(q))
        if options.peers is None:
            continue
        turns, best = [], []
        for _ in range(_TURNS):
            # In turn, as the machine is faster at some times than at others.
            _, spent = time_each(solve_branches, poses[:m], held[:m])
            _, whole = time_each(partial(ik, chain), poses[:m])
            told = ask_peers(options.peers, name, chain, poses[:m], q[:m], ANALYTIC_PEERS)
            turns.append((float(np.median(spent)), told))
            best.append(float(np.median(whole)))
        for peer in answered(told, ANALYTIC_PEERS):
            theirs = [float(np.median(answer[f"{peer}: spent"])) for _, answer in turns]
            ours = [median for median, _ in turns]
            ratios = np.array(ours) / theirs
            print(
                f"    {peer:8s} {m} poses  median {np.median(theirs):6.2f} us (ours "
                f"{np.median(ours):.2f}, {np.median(ratios):.2f} x, from {ratios.min():.2f} to "
                f"{ratios.max():.2f} x in {len(ratios)} turns; aw.ik {np.median(best):.2f} us)"
            )
            if seeds is None:
                missed, nothing, total = compare_branches(
                    chain, judge, split(told, peer), found, poses
                )
                print(
                    f"        it answers nothing on {100 * nothing / m:.1f} %  of its {total} "
                    f"right branches we miss {missed}"
                )


def judge_worst(judge: Judge, joints: Array, T: Array) -> float:
    """The largest error among the solutions of a pose."""
    return max((max(judge.errors(q, T)) for q in joints), default=0.0)


def compare_branches(
    chain: Chain, judge: Judge, theirs: list[Array], ours: list[Any], poses: Array
) -> tuple[int, int, int]:
    """How many of their branches we miss, their poses without any, and their right branches.

    Where the arm is singular a pose has families, of which each names another member: those are
    not compared.
    """
    missed = nothing = total = 0
    for k, rows in enumerate(theirs):
        right = [row for row in rows if max(judge.errors(row, poses[k])) < 1e-6]
        nothing += not right
        for row in right:
            J = singular_value(chain, row)
            if J < 1e-4:
                continue
            total += 1
            away = np.abs((ours[k].joints - row + np.pi) % (2 * np.pi) - np.pi)
            missed += not (len(away) and away.max(axis=1).min() < 1e-3)
    return missed, nothing, total


def singular_value(chain: Chain, q: Array) -> float:
    """The least singular value of the Jacobian."""
    return float(np.linalg.svd(geometric(chain, q), compute_uv=False)[-1])


def main() -> None:
    """Measure all robots."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--peers", help="an interpreter that has the peers")
    parser.add_argument("--poses", type=int, default=10_000)
    parser.add_argument("--edges", type=int, default=3_000)
    parser.add_argument("--shared", type=int, default=1_000)
    parser.add_argument("--only", choices=("numeric", "analytic"))
    parser.add_argument("--robots", nargs="*", default=ROBOTS)
    options = parser.parse_args()
    for name in options.robots:
        if options.only != "analytic":
            numeric(name, options)
        if options.only != "numeric" and structure(builtin_chain(name)) is not None:
            analytic(name, options)


if __name__ == "__main__":
    main()
