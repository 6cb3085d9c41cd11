import json
from pathlib import Path

from tests.command_line.commands import Run

DOWN = [1, 0, 0, 0]


def test_poses_within_and_beyond_an_arm_are_told_apart(run: Run, tmp_path: Path) -> None:
    request = tmp_path / "poses.json"
    poses = [{"position": [x, 0.2, 0.3], "quaternion_xyzw": DOWN} for x in (0.5, 1.4)]
    request.write_text(json.dumps({"poses": poses}))
    answer = run("reach", "ur5e", str(request), "--json")
    assert answer.code == 0
    names = [answer.json["statuses"][status] for status in answer.json["status"]]
    assert names == ["reached", "out_of_reach"]
    assert "1 of 2 poses are reached" in run("reach", "ur5e", str(request)).out


def test_a_box_is_counted_and_drawn(run: Run, tmp_path: Path) -> None:
    request = tmp_path / "box.json"
    box = {"size": [1.0, 0.0, 0.0], "pose": {"position": [1.0, 0.1, 0.3]}, "spacing": 0.25}
    document = {"box": box | {"orientations": [DOWN]}}
    request.write_text(json.dumps(document))
    text = run("reach", "ur5e", str(request)).out
    assert "of 5 poses are reached" in text
    assert "out_of_reach" in text
    request.write_text(json.dumps(document | {"format": "svg"}))
    assert run("reach", "ur5e", str(request)).out.startswith("<svg")
    request.write_text(json.dumps(document | {"format": "glb"}))
    mesh = tmp_path / "reached.glb"
    assert "reached.glb" in run("reach", "ur5e", str(request), "-o", str(mesh)).out
    assert mesh.read_bytes().startswith(b"glTF")


def test_a_request_without_poses_is_refused(run: Run, tmp_path: Path) -> None:
    request = tmp_path / "empty.json"
    request.write_text("{}")
    answer = run("reach", "ur5e", str(request))
    assert answer.code == 3
    assert "poses" in answer.err
