"""The command ``armwright identify``."""

import json
from pathlib import Path

import numpy as np

from dynamics.inverse import inverse_dynamics
from dynamics.model.payload import with_payload
from kinematics.robots import builtin_chain
from tests.command_line.commands import Run
from tests.dynamics.identification.logs import real_arm, table

CHAIN = builtin_chain("planar_rr")


def test_a_table_of_a_motion_gives_the_bodies_of_a_robot(run: Run, tmp_path: Path) -> None:
    truth = real_arm(CHAIN, 1)
    path = tmp_path / "log.csv"
    path.write_text(table(truth, 1, 0.01))
    told = run("identify", "planar_rr", str(path))
    assert told.code == 0, told.err
    assert "B1" in told.out
    file = tmp_path / "found.json"
    found = run("identify", "planar_rr", str(path), "--json", "--output", str(file))
    assert json.loads(file.read_text()) == found.json
    friction = found.json["inertias"]["viscous_friction"]
    np.testing.assert_allclose(friction, truth.chain.viscous_friction, atol=0.05)
    path.write_text("time,position.joint_1\n0.0,1.0")
    refused = run("identify", "planar_rr", str(path))
    assert refused.code == 3
    assert "missing: position.joint_2" in refused.err


def test_messages_of_poses_give_a_load(run: Run, tmp_path: Path) -> None:
    loaded = with_payload(CHAIN, 2.0, [0.1, 0.05, 0.0])
    q = np.random.default_rng(0).uniform(-2.0, 2.0, (40, 2))
    tau = inverse_dynamics(loaded, q, 0.0 * q, 0.0 * q)
    names = list(CHAIN.joint_names)[::-1]
    points = [
        {"positions": a[::-1].tolist(), "effort": b[::-1].tolist(), "velocities": [],
         "time_from_start": {"sec": i, "nanosec": 0}}
        for i, (a, b) in enumerate(zip(q, tau, strict=True))
    ]  # fmt: skip
    path = tmp_path / "message.json"
    path.write_text(json.dumps({"joint_names": names, "points": points}))
    still = tmp_path / "poses.json"
    still.write_text(json.dumps({"positions": q.tolist(), "torques": tau.tolist()}))
    found = run("identify", "planar_rr", str(still), "--payload", "--json").json
    np.testing.assert_allclose(found["payload"]["mass"], 2.0, rtol=1e-5)
    refused = run("identify", "planar_rr", str(path), "--payload", "--cutoff", "0.9")
    assert "Hz" in refused.err
    told = run("identify", "planar_rr", str(still), "--payload")
    assert "payload {" in told.out
    assert "not excited: Izz" in told.out


def test_a_recorded_motion_becomes_few_polynomials(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(table(real_arm(CHAIN, 1), 1, 0.01))
    told = run("fit", "planar_rr", str(path), "--tolerance", "0.002")
    assert told.code == 0, told.err
    assert "polynomials of 19.99" in told.out
    assert "from the record at every instant" in told.out
    file = tmp_path / "motion.json"
    words = ("fit", "planar_rr", str(path), "--tolerance", "0.002", "--output", str(file))
    assert len(run(*words, "--json").json["trajectory"]["segments"]) < 400
    again = run("convert", str(file), "--format", "joint_trajectory")
    assert again.code == 0, again.err
