"""The command ``armwright identify``."""

import json
from pathlib import Path

import numpy as np
import pytest

from dynamics.inverse import inverse_dynamics
from dynamics.model.payload import with_payload
from kinematics.calibration.calibrate import poses_of, with_corrections
from kinematics.forward import forward
from kinematics.robots import builtin_chain
from tests.client.test_recordings import State, bag2
from tests.command_line.commands import Run
from tests.dynamics.identification.logs import exciting, real_arm, table

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
    assert "no positions of joint_1, joint_2; there are those of joint_1" in refused.err


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
    slow, fast = (
        run(*words, "--retime", "--scaling", scaling, "--json").json for scaling in ("0.2", "1.0")
    )
    assert slow["certificate"]["verified"]
    assert slow["timing"]["method"] == "jerk_limited"
    assert slow["deviation"] <= 0.002
    assert 1.3 * fast["trajectory"]["duration"] < slow["trajectory"]["duration"]
    assert fast["trajectory"]["duration"] < 19.9
    assert "waypoint(s) are left out" in run(*words, "--retime").out
    refused = run(*words, "--method", "toppra")
    assert refused.code != 0
    assert "Give --retime" in refused.err


def test_a_rosbag_is_read_by_all_commands_that_take_recordings(run: Run, tmp_path: Path) -> None:
    truth = real_arm(CHAIN, 1)
    t, q, qd, qdd = exciting(CHAIN, 1, 0.01)
    tau = truth.torques(q, qd, qdd)
    names = [f"arm/{name}" for name in CHAIN.joint_names]
    rows: list[State] = list(zip(t.tolist(), [names] * len(t), q, tau, strict=True))
    path = str(bag2(tmp_path / "bag", {"/joint_states": rows}))
    told = run("identify", "planar_rr", path, "--span", "1,15")
    assert told.code == 0, told.err
    assert "joints are called arm/joint_1" in told.out
    found = run("identify", "planar_rr", path, "--prefix", "arm/", "--json").json
    friction = found["inertias"]["viscous_friction"]
    np.testing.assert_allclose(friction, truth.chain.viscous_friction, atol=0.05)
    fitted = run("fit", "planar_rr", path, "--tolerance", "0.002", "--span", "0,5")
    assert "polynomials of 5.0" in fitted.out, fitted.err
    timed = run("retime", "planar_rr", path, "--tolerance", "0.002", "--span", "0,5")
    assert "joints are called arm/joint_1" in timed.out, timed.err
    refused = run("retime", "planar_rr", path, "--span", "0")
    assert "--span: '0' are no two numbers" in refused.err
    other = run("identify", "ur5e", path)
    assert other.code == 3
    assert other.err.splitlines()[1].startswith(f"{path}: there are no positions of shoulder_pan")


@pytest.mark.parametrize("words", ["identify", "fit --tolerance 1", "retime", "calibrate"])
def test_degrees_that_are_not_called_so_are_refused(run: Run, tmp_path: Path, words: str) -> None:
    path = tmp_path / "log.csv"
    np.savetxt(path, np.full((60, 3), 57.0) + np.arange(60)[:, None], delimiter=",", comments="",
               header="time,position.joint_1,position.joint_2")  # fmt: skip
    command, *options = words.split()
    refused = run(command, "planar_rr", str(path), *options)
    assert refused.code == 3
    assert "positions of joint_1 are between 57 and 116, far beyond" in refused.err
    assert "position.JOINT [deg]" in refused.err


def test_a_motion_is_found_to_identify_an_arm_by(run: Run, tmp_path: Path) -> None:
    file = tmp_path / "motion.json"
    words = ("--start", "0.1,0.5", "--period", "5", "--evaluations", "50", "-o", str(file))
    told = run("excite", "planar_rr", *words)
    assert told.code == 0, told.err
    assert "duration 5.0000 s" in told.out
    assert "condition number" in told.out
    assert "proved" in told.out
    again = run("convert", str(file), "--format", "csv", "--sample-period", "0.01")
    log = tmp_path / "motion.csv"
    log.write_text(again.out)
    fitted = run("fit", "planar_rr", str(log), "--tolerance", "0.001")
    assert "polynomials of 5.0000 s" in fitted.out, fitted.err
    refused = run("identify", "planar_rr", str(log))
    assert "neither torques nor currents" in refused.err


def test_tables_of_measurements_give_the_frames_of_joints(run: Run, tmp_path: Path) -> None:
    chain = builtin_chain("ur5e")
    rng = np.random.default_rng(0)
    made = poses_of(1e-3 * rng.standard_normal((6, 6)))
    truth = with_corrections(chain, dict(zip(chain.joint_names, made, strict=True)))
    q = rng.uniform(-2.0, 2.0, (60, 6))
    p = forward(truth, q)[:, :3, 3] + 5e-5 * rng.standard_normal((60, 3))
    joints = [f"position.{name} [deg]" for name in chain.joint_names]
    path = tmp_path / "measured.csv"

    def write(header: list[str], rows: np.ndarray) -> None:
        lines = [",".join(map(repr, row)) for row in rows.tolist()]
        path.write_text("\n".join([",".join([*joints, *header]), *lines]))

    write(["x [mm]", "y [mm]", "z [mm]"], np.column_stack([np.degrees(q), 1e3 * p]))
    told = run("calibrate", "ur5e", str(path))
    assert told.code == 0, told.err
    assert "Margins" in told.out
    found = run("calibrate", "ur5e", str(path), "--json").json
    assert found["error_after"] < 1e-4
    assert found["error_before"] > 1e-3
    away = np.linalg.norm(p - [1.0, 0.0, 0.0], axis=1)
    write(["distance [m]"], np.column_stack([np.degrees(q), away]))
    of_distances = run("calibrate", "ur5e", str(path), "--anchor", "1,0,0", "--json").json
    assert of_distances["error_after"] < 1e-4
    refused = run("calibrate", "ur5e", str(path))
    assert "distances needs anchor" in refused.err
    write(["distance"], np.column_stack([np.degrees(q), away]))
    assert "has no unit that is known" in run("calibrate", "ur5e", str(path)).err
