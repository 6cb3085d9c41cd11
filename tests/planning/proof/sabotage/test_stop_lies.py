"""Stops under lies: what the gate and a single stop believe, pinocchio and coal find clean."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kinematics.trajectory.trajectory import Trajectory, concatenate
from planning.guard.gate import Guard
from planning.proof.certificate import Certificate, certify
from planning.stops import certificate
from planning.stops.certificate import Surroundings, stop_motion
from tests.planning.guard.cases import cases, limit_faults, positions
from tests.planning.proof.sabotage.stop_lies import GATE_LIES, STOP_LIES
from tests.planning.proof.sabotage.trial import Lie, Sabotage, installed
from tests.planning.stops.motions import judge, motions

_INSTANTS = 400


def _proposed(name: str) -> Iterator[tuple[Trajectory, Certificate, Surroundings]]:
    """Motions with their stops that the gate has proved or refused."""
    for case in cases(name, 16, seed=3):
        handed: list[tuple[Trajectory, Certificate]] = []

        def listening(motion: Trajectory, *values: Any, **more: Any) -> Certificate:
            found = certify(motion, *values, **more)
            handed.append((motion, found))  # noqa: B023
            return found

        with ExitStack() as undo:
            Sabotage(undo).module(certificate, "certify", listening)
            guard = Guard(case.around.robot, case.around.scene, "joints", limits=case.around.limits)
            verdict = guard.propose(case.state, case.proposal)
        for motion, found in handed:
            yield motion, found, case.around
        if verdict.trajectory is not None:
            # What is run and what is stopped are what was proved, end to end.
            run, rest = verdict.trajectory, verdict.stop.trajectory
            assert np.allclose(run.end, rest.start, atol=1e-9) or not verdict.stop.stops.proved


def _stopped(name: str) -> Iterator[tuple[Trajectory, Certificate, Surroundings]]:
    """Single stops of proved motions, of both kinds."""
    for moved in motions(name, 4, 4.0):
        for at in moved.trajectory.duration * np.array([0.05, 0.3, 0.5, 0.8]):
            for kind in ("path", "joints"):
                stop = stop_motion(moved.trajectory, moved.around, float(at), kind)
                # With what is run before it.
                whole = concatenate([moved.trajectory.split(float(at))[0], stop.trajectory])
                yield whole, stop.certificate, moved.around


def _bad(
    name: str, motion: Trajectory, around: Surroundings, folder: Path, *, jerk: bool
) -> list[str]:
    found = list(limit_faults(motion, around, _INSTANTS, jerk=jerk))
    rows = positions(motion, 0, _INSTANTS)
    if judge(name, around.scene, folder).overlaps(rows).any():
        found.append("overlaps")
    for order in range(2):
        steps = np.abs(np.diff(positions(motion, order, 4000), axis=0)).max()
        rate = np.abs(positions(motion, order + 1, 4000)).max() * motion.duration / 3999
        if steps > 2.0 * rate + 1e-6:
            found.append(f"order {order} jumps")
    return found


Made = Callable[[str], Iterator[tuple[Trajectory, Certificate, Surroundings]]]


def _all_bad(made: Made, names: Sequence[str], lie: Lie, folder: Path, *, jerk: bool) -> list[bool]:
    """Whether each bad motion that was made under a lie is believed."""
    with installed(lie):
        handed = [(name, *one) for name in names for one in made(name)]
    return [
        proof.verified
        for name, motion, proof, around in handed
        if _bad(name, motion, around, folder, jerk=jerk)
    ]


def test_the_gate_believes_stops_without_lies() -> None:
    assert any(proof.verified for _, proof, _ in _proposed("panda"))


@pytest.mark.parametrize("lie", GATE_LIES, ids=str)
def test_the_gate_believes_no_lie(lie: Lie, tmp_path: Path) -> None:
    believed = _all_bad(_proposed, ("panda", "meshes"), lie, tmp_path, jerk=True)
    assert believed
    assert not any(believed)


@pytest.mark.parametrize("lie", STOP_LIES, ids=str)
def test_a_stop_believes_no_lie(lie: Lie, tmp_path: Path) -> None:
    believed = _all_bad(_stopped, ("panda", "mimic joints"), lie, tmp_path, jerk=False)
    assert believed
    assert not any(believed)
