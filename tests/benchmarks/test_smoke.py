"""Benchmarks import, and one of each folder runs on tiny input."""

import importlib
import importlib.util
import sys
from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest
import yaml

from benchmarks.server import machines
from kinematics.robots import builtin_srdf, builtin_urdf

ROOT = Path(__file__).parents[2]
#: Scripts that only a peer's own interpreter can run, and the peer.
OF_PEERS = {
    "benchmarks.peers.mplib_peer": "mplib",
    "benchmarks.peers.roboplan_peer": "roboplan",
    "benchmarks.peers.sscbirrt_peer": "sscbirrt",
}
MODULES = [
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in sorted((ROOT / "benchmarks").rglob("*.py"))
    if path.stem != "__init__"
]
#: Arguments, "PROBLEMS" for a folder with one problem, and constants made small.
SMALL: Mapping[str, tuple[list[str], Mapping[str, Any]]] = {
    "benchmarks.mbm": (["PROBLEMS"], {}),
    "benchmarks.peers.__main__": (["PROBLEMS", "--timeout", "5"], {}),
    "benchmarks.planning.seams": (
        ["--seams", "1", "--arms", "ur5e"],
        {"INSTANTS": 11, "SHAPES": ("line",), "WAYPOINTS": 10},
    ),
}
#: Arguments of benchmarks that start a server.
OF_SERVERS: Mapping[str, list[str]] = {
    "benchmarks.overhead": ["--rounds", "1", "--scenes", "none", "moveit"],
    "benchmarks.server.overload": ["--clients", "4", "--seconds", "0.2"],
    "benchmarks.server.soak": [
        "--minutes", "0.02", "--clients", "2", "--rate", "50", "--kill-every", "0.4",
    ],
}  # fmt: skip

SCENE = """
name: shelf
robot_model_name: panda
world:
  collision_objects:
    - id: shelf
      header: {frame_id: panda_link0}
      primitives: [{type: box, dimensions: [0.1, 0.1, 0.2]}]
      primitive_poses: [{position: [0.5, 0.3, 0.4], orientation: [0, 0, 0, 1]}]
"""
JOINTS = [f"panda_joint{i}" for i in range(1, 8)]
START = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
GOAL = [-0.4, -0.6, 0.1, -2.2, 0.0, 1.6, 0.7]


@pytest.fixture(scope="module")
def problems(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder like MotionBenchMaker's with one problem, beside the folder of the robot."""
    root = tmp_path_factory.mktemp("data")
    robot, kind = root / "panda", root / "mbm" / "panda" / "shelf_panda"
    (robot / "meshes").mkdir(parents=True)
    (robot / "panda.urdf").write_text(builtin_urdf("panda"))
    (robot / "panda.srdf").write_text(builtin_srdf("panda") or "")
    kind.mkdir(parents=True)
    (kind / "scene0001.yaml").write_text(SCENE)
    constraints = [
        {"joint_name": name, "position": value} for name, value in zip(JOINTS, GOAL, strict=True)
    ]
    request = {
        "start_state": {"joint_state": {"name": JOINTS, "position": START}},
        "goal_constraints": [{"joint_constraints": constraints}],
    }
    (kind / "request0001.yaml").write_text(yaml.safe_dump(request))
    return kind.parent


@pytest.mark.parametrize("name", MODULES)
def test_modules_are_importable(name: str) -> None:
    peer = OF_PEERS.get(name)
    if peer is None or importlib.util.find_spec(peer) is not None:
        importlib.import_module(name)
        return
    with pytest.raises(ModuleNotFoundError) as missing:
        importlib.import_module(name)
    assert missing.value.name == peer


@pytest.mark.parametrize("name", sorted(SMALL))
def test_benchmarks_run_on_tiny_input(
    name: str, problems: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    module = importlib.import_module(name)
    arguments, constants = SMALL[name]
    for constant, value in constants.items():
        assert hasattr(module, constant), constant
        monkeypatch.setattr(module, constant, value)
    given = [str(problems) if item == "PROBLEMS" else item for item in arguments]
    monkeypatch.setattr(sys, "argv", [name, *given])
    module.main()
    assert capsys.readouterr().out.strip()


@pytest.fixture(scope="module")
def local_server() -> Iterator[tuple[int, str]]:
    """One server for all benchmarks that start one."""
    with machines.local_server({"ARMWRIGHT_WORKERS": "1"}) as started:
        yield started


@pytest.mark.parametrize("name", sorted(OF_SERVERS))
def test_benchmarks_of_a_server_run_for_a_moment(
    name: str,
    local_server: tuple[int, str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    module = importlib.import_module(name)
    monkeypatch.setattr(module, "local_server", lambda _environment: nullcontext(local_server))
    monkeypatch.setattr(sys, "argv", [name, *OF_SERVERS[name]])
    exits: list[int] = []
    monkeypatch.setattr(sys, "exit", lambda code=0: exits.append(int(code)))
    module.main()
    told = capsys.readouterr().out
    assert not any(exits), told
    assert told.strip()
