import json
import zipfile
from importlib.metadata import PackageNotFoundError
from pathlib import Path
from typing import Any

import pytest

from command_line.parameters import RobotSource
from command_line.robot_files import robot_document
from kinematics.robots import builtin_names
from tests.command_line.commands import Run
from tests.service.robots import BOX_OBJ, FLOOR, POST, urdf


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a URDF and its mesh."""
    path = tmp_path / "bench"
    (path / "meshes").mkdir(parents=True)
    (path / "arm.urdf").write_text(urdf("meshes/box.obj"))
    (path / "meshes" / "box.obj").write_text(BOX_OBJ)
    return path


def archive(folder: Path) -> Path:
    path = folder.with_suffix(".zip")
    with zipfile.ZipFile(path, "w") as file:
        for name in ("arm.urdf", "meshes/box.obj"):
            file.write(folder / name, name)
    return path


def test_all_built_in_robots_are_listed(run: Run) -> None:
    rows = run("robots", "--json").json["robots"]
    assert [row["name"] for row in rows] == list(builtin_names())
    assert next(row["joints"] for row in rows if row["name"] == "panda") == 7
    assert "planar_rr" in run("robots").out


def test_one_robot_is_shown_with_limits_and_states(run: Run) -> None:
    text = run("robots", "panda").out
    assert "panda_joint4" in text
    assert "-3.0718" in text
    assert "home" in text
    assert run("robots", "panda", "--json").json["tip_link"] == "panda_hand_tcp"


def test_a_robot_is_read_from_a_file_a_folder_an_archive_and_an_upload(
    run: Run, folder: Path, tmp_path: Path
) -> None:
    upload = tmp_path / "upload.json"
    upload.write_text(json.dumps({"urdf": urdf().replace("package://meshes/box.obj", "box.obj")}))
    hashes = set()
    for source in (folder / "arm.urdf", folder, archive(folder)):
        model = run("robots", str(source), "--json").json
        assert model["joint_names"] == ["shoulder", "elbow"]
        hashes.add(model["hash"])
    assert len(hashes) <= 2, "the name is part of the hash, the way it was read is not"
    answer = run("robots", str(upload), "--json")
    assert answer.code == 3
    assert answer.json["code"] == "INVALID_ROBOT_DESCRIPTION"
    assert "box.obj" in answer.json["detail"]


@pytest.mark.parametrize(
    ("source", "code"),
    [
        ("pandaa", "NOT_FOUND"),
        ("./none.urdf", "VALIDATION_ERROR"),
        ("{folder}/meshes/box.obj", "VALIDATION_ERROR"),
        ("{folder}/meshes", "VALIDATION_ERROR"),
    ],
)
def test_what_is_no_robot_is_refused(run: Run, folder: Path, source: str, code: str) -> None:
    source = source.format(folder=folder)
    answer = run("robots", source, "--json")
    assert (answer.code, answer.json["code"]) == (3, code)
    shown = run("robots", source)
    assert "Hint: " in shown.err
    assert "Traceback" not in shown.err
    assert shown.out == ""


def test_a_robot_of_example_robot_data_plans_without_an_edit(run: Run) -> None:
    arm = ("example-robot-data:TwoDofs", "--timeout", "60")
    free = ("--start", "0,0", "--goal", "0.5,0.3", "--json")
    missing = run("plan", *arm, *free)
    assert (missing.code, missing.json["code"]) == (3, "MISSING_LIMIT")
    assert "--default-limits" in run("plan", *arm, *free[:-1]).err
    rule = ("--default-limits", "acceleration=10 x velocity")
    answer = run("plan", *arm, *rule, *free)
    assert answer.code == 0, answer.out
    assert answer.json["certificate"]["verified"]
    wrong = run("plan", *arm, "--default-limits", "10 x velocity", *free)
    assert (wrong.code, wrong.json["code"]) == (3, "VALIDATION_ERROR")


def test_names_of_example_robot_data_are_listed(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    answer = run("robots", "example-robot-data:ur6")
    assert answer.code == 3
    assert "ur5_robot" in answer.err

    def absent(name: str) -> None:
        raise PackageNotFoundError(name)

    monkeypatch.setattr("importlib.metadata.distribution", absent)
    assert "pip install example-robot-data" in run("robots", "example-robot-data:ur5_robot").err


def test_pairs_that_seem_to_touch_are_allowed_by_a_flag(run: Run, tmp_path: Path) -> None:
    source = RobotSource(str(tmp_path / "arm.json"), allow_suspected=True)
    Path(source.robot).write_text("{}")
    assert robot_document(source)["allow_suspected"] is True


def test_meshes_of_links_that_collide_as_they_look_are_sent(folder: Path) -> None:
    (upload,) = folder.glob("*.urdf")
    looks = upload.read_text().replace("collision>", "visual>")
    upload = folder / "looks.urdf"
    upload.write_text(looks)
    assert "meshes" not in robot_document(RobotSource(str(upload)))
    document = robot_document(RobotSource(str(upload), visual_solids=True))
    assert document["visual_solids"] is True
    (uri,) = document["meshes"]
    assert uri.endswith("box.obj")


def test_obstacles_of_scene_files_are_shown(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "scene.json"
    path.write_text(json.dumps({"obstacles": [POST, FLOOR]}))
    rows: list[dict[str, Any]] = run("scenes", str(path), "--json").json["obstacles"]
    assert [row["id"] for row in rows] == ["post", "floor"]
    assert rows[0]["position"] == [0.42, 0.28, 0.6]
    moveit = tmp_path / "scene.yaml"
    moveit.write_text(
        "world:\n  collision_objects:\n    - id: shelf\n      primitives:\n"
        "        - {type: box, dimensions: [0.1, 0.2, 0.3]}\n      primitive_poses:\n"
        "        - {position: [1, 0, 0.5], orientation: [0, 0, 0, 1]}\n"
    )
    assert "shelf" in run("scenes", str(moveit)).out
    exported = tmp_path / "cell.scene"
    exported.write_text("cell\n* rack\n1\nsphere\n0.1\n1 0 0.5\n0 0 0 1\n0 0 0 0\n.\n")
    assert "rack" in run("scenes", str(exported)).out
    path.write_text('{"obstacles": [{"id": 3}]}')
    assert run("scenes", str(path)).code == 3


def test_no_scenes_are_stored_at_first(run: Run, tmp_path: Path) -> None:
    assert run("scenes", "--json").json == {"scenes": []}
    assert not (tmp_path / "data").exists(), "listing makes no database"
