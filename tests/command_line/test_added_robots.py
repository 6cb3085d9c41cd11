"""``armwright robots add``: descriptions by name, with their licence and source told."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from robot_descriptions import _repositories

from service.app import create_app
from service.settings import Settings
from tests.client.test_mjcf import ARM
from tests.client.test_urdf import FILES, MACRO, MAIN, TOOL, xacro_write
from tests.command_line.commands import Run
from tests.service.robots import BOX_OBJ
from tests.service.server import serving


@pytest.fixture
def package(tmp_path: Path) -> Path:
    return xacro_write(tmp_path, FILES) / "arm_description"


@pytest.fixture
def publish(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., str]:
    """Gives a repository of robot_descriptions other files, in a real repository on this disk."""
    monkeypatch.setenv("ROBOT_DESCRIPTIONS_CACHE", str(tmp_path / "fetched"))

    def publish(name: str, module: str, files: dict[str, str]) -> str:
        folder = xacro_write(tmp_path / f"{name}.git", files)

        def git(*words: str) -> str:
            identity = ("-c", "user.name=x", "-c", "user.email=x@localhost")
            command = ["git", "-C", str(folder), *identity, *words]
            return subprocess.run(command, check=True, capture_output=True, text=True).stdout

        git("init", "-q")
        git("add", "-A")
        git("commit", "-qm", "x")
        commit = git("rev-parse", "HEAD").strip()
        repository = _repositories.Repository(name, commit, str(folder))
        monkeypatch.setitem(_repositories.REPOSITORIES, name, repository)
        monkeypatch.delitem(sys.modules, f"robot_descriptions.{module}", raising=False)
        return commit

    return publish


def test_a_folder_is_added_shown_used_and_removed(run: Run, package: Path) -> None:
    added = run("robots", "add", str(package), "--xacro", "reach:=0.25", "--as", "bench")
    assert added.code == 0, added.err
    assert f"licence: MIT ({package / 'package.xml'})" in added.out
    assert f"source: {package / 'urdf' / 'bench.urdf.xacro'}" in added.out
    rows = {row["name"]: row for row in run("robots", "--json").json["robots"]}
    assert rows["bench"] == {"name": "bench", "built_in": False, "joints": 1}
    assert rows["panda"]["built_in"]
    answer = run("fk", "bench", "-q", "0", "--json")
    assert answer.json["links"]["lower"]["position"] == [0.0, 0.0, 0.5]
    again = run("robots", "add", str(package), "--xacro", "reach:=0.25", "--as", "bench")
    assert (again.code, "--as" in again.err) == (3, True)
    assert run("robots", "remove", "bench").code == 0
    assert run("fk", "bench", "-q", "0").code == 3
    assert run("robots", "remove", "bench").code == 3


def test_packages_that_are_installed_are_found_by_name(
    run: Run, package: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    xacro_write(package.parent / "ros" / "share", FILES)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(package.parent / "ros"))
    added = run("robots", "add", "arm", "--xacro", "reach:=1", "--json")
    assert added.code == 0, added.out
    assert added.json["source"] == f"package arm_description in {package.parent / 'ros'}"
    assert added.json["licence"].startswith("MIT")
    added = run("robots", "add", "ur5_robot", "--default-limits", "acceleration=10 x velocity")
    assert added.code == 0, added.err
    assert "source: example-robot-data 6" in added.out
    assert "licence: BSD" in added.out
    assert run("check", "ur5_robot", "-q", "0,-1,1,0,0,0").code in (0, 1)


def test_public_descriptions_are_fetched_by_name(run: Run, publish: Callable[..., str]) -> None:
    xacro = MAIN.replace("$(arg reach)", "$(arg hand)").replace("tool_description", "x_description")
    files = {
        "robots/fr3/fr3.urdf.xacro": xacro.replace("$(find x_description)/urdf/", ""),
        "robots/fr3/macro.xacro": MACRO.replace("arm_description", "franka_description"),
        "robots/fr3/tool.xacro": TOOL,
        "robots/fr3/fr3.srdf.xacro": "<robot name='fr3'><disable_collisions link1='base' "
        "link2='lower' reason='x'/></robot>",
        "meshes/a.obj": BOX_OBJ,
    }
    commit = publish("franka_description", "fr3_description", files)
    added = run("robots", "add", "fr3", "--xacro", "hand:=0.3", "--json")
    assert added.code == 0, added.out
    assert added.json["source"].startswith("fr3_description of robot_descriptions, ")
    assert added.json["source"].endswith(f"franka_description.git at {commit}")
    assert added.json["licence"] == "Apache-2.0"
    model = run("robots", "fr3", "--json").json
    assert model["allowed_collision_reasons"] == ["srdf"]
    publish("mujoco_menagerie", "panda_mj_description", {"franka_emika_panda/panda.xml": ARM})
    added = run("robots", "add", "panda_mj_description", "--as", "bent", "--tip-link", "tool")
    assert added.code == 0, added.err
    assert run("robots", "bent", "--json").json["joint_names"] == ["pan", "tilt", "slide", "roll"]


def test_what_is_not_found_or_not_fetched_is_told_with_the_remedy(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    refused = run("robots", "add", "ur10ee")
    assert refused.code == 3
    assert "ur10e_mj_description" in refused.err or "ur10_description" in refused.err
    monkeypatch.setenv("ROBOT_DESCRIPTIONS_CACHE", str(tmp_path))
    nowhere = _repositories.Repository("iiwa", "0" * 40, str(tmp_path / "nowhere"))
    for name in ("iiwa_description", "differentiable-robot-model", "drake_models"):
        monkeypatch.setitem(_repositories.REPOSITORIES, name, nowhere)
    refused = run("robots", "add", "iiwa14_description")
    assert refused.code == 3
    assert "can't be fetched" in refused.err
    assert "give its folder" in refused.err
    monkeypatch.setitem(sys.modules, "robot_descriptions._descriptions", None)
    assert "[descriptions]" in run("robots", "add", "ur10e").err
    (tmp_path / "arm.urdf").write_text("<robot name='x'><link name='l'/></robot>")
    assert run("robots", "add", str(tmp_path / "arm.urdf")).code == 3, "it has no joint"
    assert "remove" in run("robots", "one", "two").err


@pytest.fixture
def service(tmp_path: Path) -> Iterator[httpx.Client]:
    app = create_app(Settings(data_dir=tmp_path / "service", workers=1))
    with serving(app) as client:
        yield client


def test_a_service_keeps_what_is_added_to_it(
    run: Run, package: Path, service: httpx.Client
) -> None:
    url = str(service.base_url)
    words = ("--xacro", "reach:=0.25", "--as", "bench", "--url", url)
    added = run("robots", "add", str(package), *words)
    assert added.code == 0, added.err
    model: dict[str, Any] = service.get("/v1/robots/bench").json()
    assert model["joint_names"] == ["turn"]
    assert run("robots", "add", str(package), *words).code == 3
    assert run("robots", "remove", "bench", "--url", url).code == 0
    assert service.get("/v1/robots/bench").status_code == 404
