"""Every script in benchmarks/ runs on tiny input; peers that are not installed are left out."""

import importlib
import importlib.util
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
import trimesh
import yaml

from benchmarks import machines
from kinematics.robots import builtin_srdf, builtin_urdf
from tests.service.forked_commands import start_command

FOLDER = Path(__file__).parents[2] / "benchmarks"
#: Scripts that only a peer's own interpreter can run, and what they import first: the peer, or a
#: script beside them that needs it.
OF_PEERS = {
    "constrained_ik_drake": "pydrake",
    "optimize_peers_drake": "constrained_ik_drake",
    "peers_mplib": "mplib",
    "peers_roboplan": "roboplan",
    "peers_sscbirrt": "mujoco",
    "seam_descartes": "tesseract_robotics",
}
#: What other scripts import: nothing to run.
WITHOUT_MAIN = {
    "__init__", "crowd", "determinism_requests", "example_arms", "fcl_judge", "machines",
    "mbm_ompl", "mbm_problems", "memory", "mesh_scenes", "mesh_ways", "poses", "ratios", "recheck",
    "seam_arms", "seam_peers", "task_check", "task_export", "task_problems", "task_sampling",
    "triangles", "turns",
}  # fmt: skip
#: Have tests of their own, with services of their own: tests/service/jobs/test_agent_jobs.py makes
#: the faults of `agents`, in one process; tests/studio/test_workbench.py runs `studio_arms`, and
#: tests/studio/page drags, plans and plays as `first_motion` does, which installs everything anew.
ELSEWHERE = {"agents", "first_motion", "http", "studio_arms"}
#: Arguments of scripts that start a server.
OF_SERVERS: Mapping[str, list[str]] = {
    "batch": ["--count", "3", "--workers", "1", "--rounds", "1"],
    "interactive": ["--jobs", "3", "--requests", "3", "--pause", "0", "--settle", "0"],
    "overhead": ["--rounds", "1", "--scenes", "none", "moveit"],
    "overhead_turns": ["--rounds", "1", "--scenes", "none"],
    "overload": ["--clients", "4", "--seconds", "0.3", "--settle", "0", "--requests", "plan"],
    "determinism": [
        "--repeats",
        "2",
        "--servers",
        "1",
        "--busy",
        "1",
        "--kinds",
        "auto",
        "ik",
        "batch",
    ],
    "soak": ["--minutes", "0.02", "--clients", "2", "--rate", "50", "--kill-every", "0.4"],
}
#: A side of `overhead_turns`, which takes a server that is there.
_SIDE = """
import runpy
from contextlib import nullcontext
from benchmarks import machines
machines.local_server = lambda _environment: nullcontext({server!r})
runpy.run_path({script!r}, run_name="__main__")
"""
#: Runs all others.
ALL = {"__main__"}

#: Arguments of each script, "PROBLEMS" for a folder with one problem; and constants made small.
SMALL: Mapping[str, tuple[list[str], Mapping[str, Any]]] = {
    "brackets": (["--robots", "planar_rr"], {}),
    "constrained_ik": (["PROBLEMS", "--count", "1"], {}),
    "constrained_cases": (["PROBLEMS", "--count", "6"], {"_ARMS": ("kr6_sixx",)}),
    "constrained_plan": (["PROBLEMS", "--timeout", "10"], {}),
    "goal_choice": (["--arms", "kr6_sixx", "--count", "1"], {"_STARTS": 20}),
    "goal_choice_sequences": (["--arms", "kr6_sixx", "--count", "1"], {}),
    "constrained_ways": (
        ["--robots", "built-in:iiwa14", "--kinds", "mixed", "--count", "1", "--timeout", "20"],
        {"_STEPS": 30, "_BOXES": 2},
    ),
    "dynamics": (["planar_rr"], {"ROUNDS": 1, "CALLS": 100, "STATES": 4}),
    # Without --peers it measures this code alone: the peers have an interpreter of their own.
    "ik": (["--robots", "kr6_sixx", "--poses", "2", "--edges", "2", "--shared", "2"], {}),
    "ik_peers": (["CASE", "nobody"], {}),
    "kinematics": (["scara"], {"ROUNDS": 1, "CALLS": 2, "BATCH": 4}),
    "mbm": (["PROBLEMS"], {}),
    "mbm_repeats": (["PROBLEMS", "shelf_panda/scene0001"], {}),
    # The arm with the fewest triangles; its meshes are decomposed once for both.
    "mesh_plans": (["PROBLEMS", "--robots", "ur3", "--timeout", "10"], {}),
    "meshes": (["--robots", "ur3", "--count", "2"], {"SCENES": 2}),
    "new_scenes": (["--arms", "ur5e", "--scenes", "1", "--boxes", "3"], {"_WARM_UP": 1}),
    "optimize": (["PROBLEMS"], {}),
    # Without --judge it leaves out drake, which has an interpreter of its own.
    "optimize_peers": (["PROBLEMS", "--timeout", "10"], {}),
    "peers": (["PROBLEMS", "--timeout", "5"], {}),
    "projection": (["--points", "3"], {"SOLIDS": 1}),
    "arms": (
        ["--arms", "UR5"],
        {"SCENES": 1, "PROBLEMS": 1, "ROUND_TRIPS": 2, "VERDICTS": 5, "STATES": 20},
    ),
    "clearance": (["--arm", "ur5e", "--count", "1"], {}),
    "clearance_room": (["--arm", "kr6_sixx", "--count", "1"], {"PREFERRED": (0.02,)}),
    "clearance_sharpness": (["--random", "2", "--samples", "20"], {"REPEATS": 1}),
    "reach": (["--poses", "200", "--robots", "kr6_sixx"], {"_ONE_BY_ONE": 2}),
    "tours": (["--spots", "4", "--timeout", "30"], {}),
    "tour_peers": (["CASE", "0.1", "nobody"], {}),
    "seams": (
        ["--seams", "1", "--arms", "ur5e", "--peer"],
        {"INSTANTS": 11, "SHAPES": ("line",), "WAYPOINTS": 40},
    ),
    "scale": (["--obstacles", "5", "--points", "50"], {"_STATES": 8, "_REPEATS": 1, "_PLANS": 1}),
    "startup": (["--runs", "1", "--workers", "1"], {"_WARM_UPS": 0, "_SETTLED": 0.2}),
    "tasks": (["PROBLEMS", "--robots", "panda", "--kinds", "shelf", "--count", "1"], {}),
    "timing": ([], {"PATHS": 1}),
    "timing_limits": (["2"], {}),
    "timing_optimum": (["--cases", "1", "--pieces", "4"], {}),
    "timing_plans": (["PROBLEMS"], {}),
    "edge_lanes": (["--scenes", "1", "--lengths", "0.5"], {"MOTIONS": 3, "ROUNDS": 1}),
    "mesh_costs": (["--scenes", "1"], {"STATES": 2}),
    "mesh_descriptions": (["URDF"], {"SCENES": 1, "STATES": 20, "EDGES": 2, "ROUNDS": 1}),
    "mbm_turns": (["PROBLEMS", "--rounds", "1"], {}),
    "mbm_arms": (["ROBOTS", "--robots", "panda", "--every", "1"], {"TIPS": {"panda": None}}),
    "pieces": (["PROBLEMS", "--every", "1", "--kinds", "plain", "line", "seam"], {"SEAMS": 2}),
    "tool_corners": (["--arms", "kr6_sixx", "--paths", "1", "--speeds", "0.1"], {}),
    "tracking": ([], {"ROUNDS": 1, "SECONDS": 0.2}),
    "verdict": (["--states", "40"], {"_BUDGET": 0.01, "_ALONG": 5, "_SCENES": 1}),
}

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
    (robot / "problems").symlink_to(kind.parent)
    return kind.parent


def test_every_script_is_here() -> None:
    scripts = {path.stem for path in FOLDER.glob("*.py")}
    assert scripts == set(SMALL) | set(OF_PEERS) | set(OF_SERVERS) | WITHOUT_MAIN | ELSEWHERE | ALL


@pytest.mark.parametrize("name", sorted(WITHOUT_MAIN | ELSEWHERE))
def test_modules_are_importable(name: str) -> None:
    importlib.import_module(f"benchmarks.{name}")


@pytest.mark.parametrize("name", sorted(OF_PEERS))
def test_scripts_of_peers_miss_nothing_but_the_peer(name: str) -> None:
    peer = OF_PEERS[name]
    if importlib.util.find_spec(peer) is None:
        with pytest.raises(ModuleNotFoundError) as missing:
            importlib.import_module(f"benchmarks.{name}")
        assert missing.value.name == peer
    else:
        importlib.import_module(f"benchmarks.{name}")


@pytest.mark.parametrize("name", sorted(SMALL))
def test_scripts_run_on_tiny_input(
    name: str,
    problems: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    module = importlib.import_module(f"benchmarks.{name}")
    arguments, constants = SMALL[name]
    for constant, value in constants.items():
        assert hasattr(module, constant), constant
        monkeypatch.setattr(module, constant, value)
    paths = {
        "PROBLEMS": str(problems), "ROBOTS": str(problems.parents[1]),
        "CASE": str(case_of_ik(tmp_path)), "URDF": str(described_arm(tmp_path)),
    }  # fmt: skip
    monkeypatch.setattr(sys, "argv", [name, *(paths.get(item, item) for item in arguments)])
    # Some tell faults by their exit status.
    monkeypatch.setattr(sys, "exit", lambda code=0: exits.append(int(code)))
    exits: list[int] = []
    module.main()
    assert not any(exits)
    if name in ("ik_peers", "tour_peers"):
        answers = tmp_path / "case.answers.npz"
        assert answers.exists()
        return
    assert capsys.readouterr().out.strip()


@pytest.fixture(scope="module")
def local_server() -> Iterator[tuple[int, str]]:
    """One server for all scripts that start one, forked from one that has loaded all."""

    def start(command: list[str], *, text: bool, **options: Any) -> "subprocess.Popen[str]":
        assert text
        assert command[:3] == [sys.executable, "-m", "service.cli"]
        return start_command(command[3:], **options)

    forked = SimpleNamespace(Popen=start, PIPE=subprocess.PIPE, DEVNULL=subprocess.DEVNULL)
    with (
        patch.object(machines, "subprocess", forked),
        machines.local_server({"ARMWRIGHT_WORKERS": "1"}) as started,
    ):
        yield started


@pytest.mark.parametrize("name", sorted(OF_SERVERS))
def test_scripts_that_start_a_server_run_for_a_moment(
    name: str,
    local_server: tuple[int, str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    module = importlib.import_module(f"benchmarks.{name}")
    arguments = OF_SERVERS[name]
    if name == "overhead_turns":
        script, side = str(FOLDER / f"{name}.py"), tmp_path / "side.py"
        side.write_text(_SIDE.format(server=local_server, script=script))
        monkeypatch.setattr(module, "__file__", str(side))
        monkeypatch.setattr(module, "_FIRST", 1)
        arguments = [str(FOLDER.parent), *arguments]
    else:
        monkeypatch.setattr(module, "local_server", lambda _environment: nullcontext(local_server))
    monkeypatch.setattr(sys, "argv", [name, *arguments])
    exits: list[int] = []
    monkeypatch.setattr(sys, "exit", lambda code=0: exits.append(int(code)))
    module.main()
    told = capsys.readouterr().out
    assert not any(exits), told
    assert told.strip()


def described_arm(folder: Path) -> Path:
    """A URDF of two joints in a package, with a block as a mesh of its last link."""
    package = folder / "small_arm"
    for name in ("urdf", "meshes"):
        (package / name).mkdir(parents=True)
    trimesh.creation.box((0.05, 0.05, 0.4)).export(package / "meshes" / "block.stl")
    limit = '<limit lower="-2" upper="2" velocity="1" effort="10"/>'
    links = '<link name="base"/><link name="upper"/><link name="tool"><collision><geometry>'
    links += '<mesh filename="package://small_arm/meshes/block.stl"/></geometry></collision></link>'
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{offset}"/><axis xyz="{axis}"/>{limit}</joint>'
        for name, parent, child, offset, axis in (
            ("first", "base", "upper", "0 0 0.4", "0 0 1"),
            ("second", "upper", "tool", "0.3 0 0", "0 1 0"),
        )
    )
    path = package / "urdf" / "small_arm.urdf"
    path.write_text(f'<robot name="small_arm">{links}{joints}</robot>')
    return path


def case_of_ik(folder: Path) -> Path:
    """A file of poses as benchmarks.ik hands it to its peers."""
    path = folder / "case.npz"
    np.savez(path, poses=np.eye(4)[None], lower=np.zeros(6), upper=np.ones(6))
    return path
