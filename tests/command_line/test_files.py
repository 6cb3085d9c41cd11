"""Commands that write files of motions, project points and measure times."""

import io
import json
import re
from pathlib import Path

import pytest
import trimesh
from mcap.reader import make_reader

from tests.command_line.commands import Run

TURN = {
    "segments": [
        {"t0": 0.0, "t1": 1.0, "coefficients": [[0, 0, 0, 1, -1.5, 0.6], [0.5, 0, 0, 2, -3, 1.2]]}
    ]
}
BALL = {"id": "ball", "shape": {"type": "sphere", "radius": 0.1}, "pose": {"position": [0.5, 0, 0]}}


@pytest.fixture
def motion(tmp_path: Path) -> str:
    path = tmp_path / "motion.json"
    path.write_text(json.dumps(TURN))
    return str(path)


def test_a_motion_is_written_for_a_controller(run: Run, motion: str, tmp_path: Path) -> None:
    words = ("export", "planar_rr", motion, "--format", "csv", "--sample-period", "0.5")
    shown = run(*words)
    assert shown.code == 0, shown.err
    assert shown.out.splitlines()[-1].startswith("1.0,0.09999999999999998,0.7")
    assert "proved" in shown.err
    file = tmp_path / "motion.csv"
    assert run(*words, "-o", str(file)).code == 0
    assert file.read_text().rstrip("\n") == shown.out.rstrip("\n")
    assert run(*words, "--json").json["point_count"] == 3


def test_a_recording_is_a_file(run: Run, motion: str, tmp_path: Path) -> None:
    words = ("export", "planar_rr", motion, "--format", "mcap", "--sample-period", "0.5")
    file = tmp_path / "motion.mcap"
    assert run(*words, "-o", str(file)).code == 0
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_end_time == 1_000_000_000
    refused = run(*words)
    assert (refused.code, refused.out) == (3, "")
    assert "-o motion.mcap" in refused.err


def test_an_export_that_collides_exits_with_1(run: Run, motion: str, tmp_path: Path) -> None:
    scene = tmp_path / "scene.json"
    scene.write_text(json.dumps({"obstacles": [BALL]}))
    refused = run("export", "planar_rr", motion, "--format", "csv", "--scene", str(scene))
    assert refused.code == 1
    assert "not proved" in refused.err
    assert "NOT PROVED" in refused.out


def test_the_space_of_a_motion_is_written(run: Run, motion: str, tmp_path: Path) -> None:
    meshes = {}
    for suffix in (".stl", ".glb"):
        file = tmp_path / f"swept{suffix}"
        made = run("sweep", "planar_rr", motion, "-o", str(file), "--tolerance", "0.02", "--json")
        assert made.code == 0, made.err
        loaded = trimesh.load(io.BytesIO(file.read_bytes()), file_type=suffix[1:], force="mesh")
        assert len(loaded.faces) == made.json["triangles"]
        meshes[suffix] = loaded
    assert meshes[".stl"].area == pytest.approx(meshes[".glb"].area, rel=1e-4)
    assert run("sweep", "planar_rr", motion, "-o", "swept.obj").code == 3


def test_points_are_projected(run: Run, tmp_path: Path) -> None:
    scene = tmp_path / "scene.json"
    scene.write_text(json.dumps({"obstacles": [BALL]}))
    one = run("project", str(scene), "--points", "0,0,0", "--json")
    assert one.code == 0, one.err
    ((item,),) = one.json["projections"]
    assert item["projection"] == pytest.approx([0.4, 0.0, 0.0])
    assert item["distance"] == pytest.approx(0.4)
    shown = run("project", str(scene), "--points", "[[0,0,0],[0.5,0,0.05]]")
    assert "0.4000" in shown.out
    assert "-0.0500" in shown.out
    assert re.findall(r"│ (\d) ", shown.out) == ["0", "1"]
    for points in ("0,0", "here", "[]"):
        assert run("project", str(scene), "--points", points).code == 3
    assert run("project", "stored", "--points", "0,0,0").code == 3


def test_times_are_measured(run: Run) -> None:
    rows = run("bench", "planar_rr", "--repeats", "2", "--json").json
    assert [row["request"] for row in rows] == ["fk", "ik", "check", "plan"]
    assert all(0.0 < row["median"] <= row["longest"] for row in rows)
    assert "median" in run("bench", "planar_rr", "--repeats", "2").out
