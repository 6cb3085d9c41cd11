"""The gate: how long it takes, in process and over its WebSocket, and a judge of what it accepts.

    python -m benchmarks.gate                   # times, in process and beside a server of its own
    python -m benchmarks.gate --judge 100000    # proposals over all arms, by pinocchio and coal

Proposals of the judge are pieces of proved motions, clean and with noise, velocities that wander,
and targets aimed at what the arm can't be in. Each one accepted is run, and stopped often.
"""

import argparse
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from armwright_client import Box, GuardState, Obstacle, Pose, Scene, Sphere
from armwright_client import Guard as Session
from armwright_client import Proposal as ProposalBody
from planning.guard.gate import Guard
from planning.values.preferences import StopKinds
from service.app import create_app
from service.settings import Settings
from tests.planning.guard.cases import cases, faults
from tests.planning.stops.judge import CoalArm
from tests.planning.stops.motions import ARMS, judge
from tests.service.server import serving

#: What stands about the arm of the session.
SCENE = Scene(
    obstacles=[
        Obstacle(id="table", shape=Box(size=(1.0, 1.0, 0.1)), pose=Pose.at(0.6, 0.0, -0.1)),
        Obstacle(id="post", shape=Box(size=(0.1, 0.1, 1.0)), pose=Pose.at(0.6, 0.4, 0.5)),
        Obstacle(id="lamp", shape=Sphere(radius=0.1), pose=Pose.at(0.4, -0.5, 0.7)),
    ]
)
#: Proposals of a measurement, and messages of a session.
_COUNT = 400


def main() -> None:
    """Measure, or judge."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--judge", type=int, default=0, help="proposals to be judged")
    parser.add_argument("--instants", type=int, default=1000, help="looked at of each motion")
    parser.add_argument("--seed", type=int, default=0, help="of the proposals")
    parser.add_argument("--arms", nargs="*", default=list(ARMS), help="of the judge")
    given = parser.parse_args()
    if given.judge:
        for name in given.arms:
            for jerk in (True, False):
                _judge(name, "path", given, jerk=jerk)
                _judge(name, "joints", given, jerk=jerk)
        return
    _measure("path")
    _measure("joints")
    _measure_session()


def _judge(name: str, kind: StopKinds, given: argparse.Namespace, *, jerk: bool) -> None:
    """Judge a share of the proposals: those of one arm and one kind of stop."""
    count = -(-given.judge // (4 * len(given.arms)))
    counts: Counter[str] = Counter()
    last: tuple[Any, CoalArm] | None = None
    with tempfile.TemporaryDirectory() as folder:
        for case in cases(name, count, jerk=jerk, seed=given.seed):
            around = case.around
            guard = Guard(around.robot, around.scene, kind, limits=around.limits)
            verdict = guard.propose(case.state, case.proposal)
            counts[case.kind] += 1
            counts[f"{case.kind}, whole"] += verdict.scale == 1.0 and not verdict.violations
            counts[f"{case.kind}, in part"] += verdict.accepted_until > 0.0
            if verdict.trajectory is None:
                continue
            if last is None or last[0] is not around.scene:
                last = around.scene, judge(name, around.scene, Path(folder))
            for fault in faults(verdict, case, last[1], kind, given.instants, given.instants // 20):
                counts["FAULTS"] += 1
                print(f"  {name} {kind} {case.kind} {counts[case.kind]}: {fault}")
    print(
        f"{name}, {kind}, jerk {'limited' if jerk else 'free'}:",
        dict(sorted(counts.items())),
        flush=True,
    )


def _measure(kind: StopKinds) -> None:
    """Times of proposals in process, one core."""
    times: dict[str, list[float]] = {"accepted whole": [], "in part": [], "refused": []}
    for case in cases("panda", _COUNT, jerk=kind == "path"):
        around = case.around
        guard = Guard(around.robot, around.scene, kind, limits=around.limits)
        guard.propose(case.state, case.proposal)
        began = time.thread_time()
        verdict = guard.propose(case.state, case.proposal)
        seconds = time.thread_time() - began
        whole = verdict.scale == 1.0 and not verdict.violations
        part = "in part" if verdict.accepted_until > 0.0 else "refused"
        times["accepted whole" if whole else part].append(seconds)
    for name, found in times.items():
        _tell(f"in process, {kind}, {name}", found)


def _measure_session() -> None:
    """Times of proposals over the WebSocket of a server with one worker beside this process."""
    ready = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
    rows = np.array(ready) + np.linspace(0.0, 0.2, 17)[1:, None] * np.array([1.0, 0, 0, 0, 0, 0, 0])
    sound = ProposalBody(samples=rows, period=1 / 30, interpolation="clamped_spline")
    wild = ProposalBody(samples=rows * 4.0, period=1 / 30, interpolation="clamped_spline")
    settings = Settings(data_dir=Path(tempfile.mkdtemp()), workers=1)
    with (
        serving(create_app(settings)) as client,
        Session("panda", str(client.base_url).rstrip("/"), scene=SCENE) as session,
    ):
        for name, proposal in (("accepted", sound), ("refused", wild)):
            found = []
            for _ in range(_COUNT):
                began = time.perf_counter()
                session.propose(GuardState(positions=ready), proposal)
                found.append(time.perf_counter() - began)
            _tell(f"WebSocket, path, {name}", found[20:])


def _tell(name: str, seconds: list[float]) -> None:
    if seconds:
        middle, last = 1e3 * np.percentile(seconds, [50.0, 99.0])
        print(f"{name}: {len(seconds)}, median {middle:.2f} ms, p99 {last:.2f} ms", flush=True)


if __name__ == "__main__":
    main()
