"""Shell blocks of the documents: they run as they stand, or are checked where they can't run."""

import json
import os
import re
import shlex
import subprocess
import zipfile
from contextlib import ExitStack, redirect_stdout
from pathlib import Path

import numpy as np
import pytest

from command_line.main import main
from kinematics.forward import forward
from kinematics.robots import builtin_chain
from tests.dynamics.identification.logs import real_arm, table
from tests.service.conftest import Served
from tests.service.robots import urdf

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), ROOT / "client/README.md", *(ROOT / "docs").rglob("*.md")])
#: A shell block, and what it prints where the page says so.
BLOCK = re.compile(r"```sh\n(.*?)```(?:\s*prints\s*```\n(.*?)```)?", re.DOTALL)
#: Pages whose blocks do not run here, with what they would want.
CHECKED = {
    "CONTRIBUTING.md": "an installation, and these tests",
    "README.md": "an installation, and a server that runs until it is ended",
    "client/README.md": "an installation",
    "docs/agents.md": "an installation; test_agents.py runs agents",
    "docs/course/exam.md": "minutes; tests/course/test_exam.py asks a question of each kind",
    "docs/descriptions.md": "public repositories; tests/client/test_urdf.py and test_mjcf.py",
    "docs/install.md": "an installation; tests/test_wheels.py installs a wheel",
    "docs/work_stages.md": "a minute; tests/command_line/test_requests.py runs the example",
    "docs/mcp.md": "a server and a language model; tests/command_line/test_mcp.py",
    "docs/course/README.md": "a server in another terminal; tests/course runs the example",
    "docs/first_plan.md": "a clone and an installation",
    "docs/how_to/stream_positions.md": "a controller; planning/exports/test_streams.py plays one",
    "docs/how_to/back_up.md": "two databases; storage/test_back_up.py runs it",
    "docs/how_to/generated_clients.md": "npm; tests/client/test_generated.py makes one of both",
    "docs/how_to/release.md": "these tests, minutes, and a repository to push to",
    "docs/pick_and_place.md": "a public robot, a server; test_example_pick_and_place.py runs it",
    "docs/potential_fields.md": "a server beside it; test_example_potential_field.py runs it",
    "docs/studio.md": "an installation; tests/command_line/test_studio.py runs the page",
    "docs/tutorials/docker.md": "Docker",
    "docs/tutorials/studio.md": "a clone and an installation; tests/studio opens the page",
}
BLOCKS = {
    f"{page.relative_to(ROOT)}-{i}": block
    for page in PAGES
    for i, block in enumerate(BLOCK.findall(page.read_text("utf-8")))
}
RUN = [name for name in BLOCKS if name.rpartition("-")[0] not in CHECKED]
LOOKED_AT = [name for name in BLOCKS if name not in RUN]
#: The key of a page, which is another one in each installation.
KEY = "5be0cd19137e"
SEGMENT = {"robot": "panda", "start": {"state": "home"}, "keep": True}
SEGMENT |= {"goal": {"joints": [0.2, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]}}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the files that pages speak of."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ARMWRIGHT_DATA_DIR", str(tmp_path / "data"))
    monkeypatch.delenv("ARMWRIGHT_URL", raising=False)
    page = (ROOT / "docs/command_line.md").read_text("utf-8")
    scene = re.search(r"`post\.json`:\s*```json\n(.*?)```", page, re.DOTALL)
    assert scene is not None
    (tmp_path / "post.json").write_text(scene[1])
    (tmp_path / "log.csv").write_text(table(real_arm(builtin_chain("planar_rr"), 0), 0, 0.1))
    chain = builtin_chain("ur5e")
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (60, chain.n))
    columns = [*(f"position.{name}" for name in chain.joint_names), "x [m]", "y [m]", "z [m]"]
    measured = np.column_stack([q, forward(chain, q)[:, :3, 3]])
    np.savetxt(
        tmp_path / "measured.csv", measured, delimiter=",", header=",".join(columns), comments=""
    )
    with zipfile.ZipFile(tmp_path / "my_arm.zip", "w") as archive:
        archive.writestr("arm.urdf", urdf("box.obj"))
        archive.writestr(
            "box.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
        )
    return tmp_path


def armwright(line: str, folder: Path) -> int:
    """Run one command in this process; its output may go to a file."""
    words, _, file = line.partition(" > ")
    with ExitStack() as stack:
        if file:
            stack.enter_context(redirect_stdout(stack.enter_context((folder / file).open("w"))))
        return int(main(shlex.split(words, comments=True)[1:]))


@pytest.mark.parametrize("name", RUN)
def test_a_block_runs_as_it_stands(
    name: str, folder: Path, served: Served, capsys: pytest.CaptureFixture[str]
) -> None:
    block, printed = BLOCKS[name]
    address = str(served.client.base_url).removeprefix("http://").rstrip("/")
    kept = served.client.post("/v1/plan", json=SEGMENT).json() if "$ID" in block else {}
    variables = os.environ | {"ID": kept.get("plan_id", "")}
    out = ""
    for line in block.splitlines():
        if line.startswith("armwright "):
            key = re.search(r"aw_([0-9a-f]+)_", out)
            code = armwright(line.replace(KEY, key[1]) if key else line, folder)
            said = capsys.readouterr()
            out += said.out + said.err
            assert code == 0 or printed, f"{line}: {out}"
            continue
        command = re.sub(r"(127\.0\.0\.1|localhost):800\d", address, line)
        ran = subprocess.run(
            ["bash", "-c", command], env=variables, capture_output=True, text=True, check=True
        )
        # Metrics are lines of text; all else is JSON.
        answer = json.loads(ran.stdout or "{}") if "/metrics" not in line else {}
        assert answer.get("code") is None, answer
        variables["OTHER"] = answer.get("id", "")
        out += ran.stdout
    assert out == (printed or out)


@pytest.mark.parametrize("name", LOOKED_AT)
def test_a_block_that_does_not_run_here_is_well_formed(name: str) -> None:
    block, _ = BLOCKS[name]
    subprocess.run(["bash", "-n"], input=block, text=True, check=True)
    makefile = (ROOT / "Makefile").read_text("utf-8")
    for target in re.findall(r"^make ([a-z-]+)", block, re.MULTILINE):
        assert f"\n{target}:" in makefile, target
    for file in re.findall(r"^python (\S+)", block, re.MULTILINE):
        assert (ROOT / file).is_file(), file


def test_every_page_that_is_not_run_is_there_and_says_why() -> None:
    assert set(CHECKED) == {name.rpartition("-")[0] for name in LOOKED_AT}
    assert all(CHECKED.values())
    assert len(RUN) >= 4


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_stand_in_shell_blocks_and_json_is_json(page: Path) -> None:
    text = page.read_text("utf-8")
    for language, body in re.findall(r"^```(\w*)\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
        if language == "":
            assert not re.search(r"^(armwright|make|curl|pip|docker|npx|git) ", body, re.MULTILINE)
        if language == "json":
            json.loads(body if body[0] in "[{" else f"{{{body}}}")
