import gc
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from command_line.app import _MODULES
from command_line.backends.local import DEFAULT_TIMEOUT
from command_line.main import SERVER_COMMANDS, main
from command_line.problems import ExitCode
from service.settings import Settings
from service.version import VERSION
from tests.command_line.commands import Run
from tests.service.processes import wait_until

COMMANDS = list(_MODULES)
ROOT = Path(__file__).parents[2]


def test_version_and_help(run: Run) -> None:
    assert run("--version") == (0, f"armwright {VERSION}\n", "")
    assert run()[0] == 2
    text = run("--help").out
    for name in (*COMMANDS, *SERVER_COMMANDS):
        assert f"  {name} " in text


def test_garbage_is_searched_for_seldom_while_a_command_runs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    before, seen = gc.get_threshold(), list[int]()

    def run(_: list[str]) -> int:
        seen.append(gc.get_threshold()[0])
        raise KeyboardInterrupt

    monkeypatch.setattr("command_line.app.run", run)
    main(["robots"])
    assert seen[0] > 10 * before[0]
    assert gc.get_threshold() == before


@pytest.mark.parametrize("words", [("dance",), ("fk",), ("fk", "panda", "--joint", "1")])
def test_wrong_usage_has_its_own_exit_code(run: Run, words: tuple[str, ...]) -> None:
    answer = run(*words)
    assert answer.code == 2
    assert "Usage: armwright" in answer.err


def test_commands_of_the_server_keep_their_flags_and_exit_codes(
    run: Run, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = str(tmp_path / "keys")
    assert run("serve", "--data-dir", folder, "--port", "70000").code == 1
    made = run("keys", "create", "--name", "mine", "--data-dir", folder)
    assert made.code == 0
    assert made.out.startswith("aw_")
    assert "mine" in run("keys", "list", "--data-dir", folder).out
    assert run("audit", "--limit", "5", "--data-dir", folder).code == 0
    with pytest.raises(SystemExit) as end:
        main(["serve", "--help"])
    assert end.value.code == 0
    assert "--insecure" in capsys.readouterr().out


def test_the_server_starts_without_what_commands_for_people_need() -> None:
    program = (
        "import sys; from command_line.main import main; main(['serve', '--port', '70000']); "
        "print({'typer', 'rich', 'numba'} & set(sys.modules))"
    )
    answer = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert answer.stdout == "set()\n"


def test_a_plan_here_needs_no_client_and_no_optimiser() -> None:
    words = ["plan", "panda", "--start", "home", "--goal", "0,-0.5,0,-2,0,1.6,0.8"]
    large = "'casadi', 'httpx', 'pydantic_settings', 'scipy.interpolate', 'scipy.optimize'"
    program = (
        f"import sys; from command_line.main import main; main({[*words, '--json']}); "
        f"print({{{large}}} & set(sys.modules))"
    )
    answer = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    first, last = answer.stdout.splitlines()
    assert json.loads(first)["certificate"]["verified"]
    assert last == "set()"


def test_a_request_here_has_the_time_of_one_at_a_service() -> None:
    assert Settings.model_fields["default_timeout"].default == DEFAULT_TIMEOUT


def test_every_command_is_documented() -> None:
    page = (ROOT / "docs/command_line.md").read_text("utf-8")
    for name in (*COMMANDS, *SERVER_COMMANDS):
        assert f"| `{name}" in page, name
    for code in ExitCode:
        assert f"| {int(code)} |" in page, code


def test_a_shell_gets_completions() -> None:
    answer = subprocess.run(
        [sys.executable, "-c", "from command_line.main import main; main()"],
        cwd=ROOT,
        env={
            "_ARMWRIGHT_COMPLETE": "complete_bash",
            "COMP_WORDS": "armwright ro",
            "COMP_CWORD": "1",
            "PYTHONPATH": f"{ROOT}:{ROOT / 'client'}",
        },
        capture_output=True,
        text=True,
        check=False,
    )
    assert answer.stdout.split() == ["robots"], answer.stderr


ENDLESS = ["plan", "panda", "--start=home", "--goal=1.2,-0.3,0,-2,0,1.8,0.785"]
ENDLESS += ["--planner", "rrt_star", "--timeout", "60"]


def interruptible(words: list[str]) -> subprocess.Popen[str]:
    """A command that has come to where it handles Ctrl-C; before, it is Python's own start."""
    process = subprocess.Popen(
        [sys.executable, "-m", "armwright", *words], text=True, cwd=ROOT,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),  # noqa: PLW1509
    )  # fmt: skip

    def handles() -> bool:
        status = Path(f"/proc/{process.pid}/status").read_text()
        return bool(int(status.partition("SigCgt:")[2].split()[0], 16) & 1 << signal.SIGINT - 1)

    assert wait_until(handles, 30.0)
    return process


@pytest.mark.parametrize(
    ("words", "longest"),
    [
        (ENDLESS, 2.0),
        (["ik", "panda", "--pose=0.4,0.1,0.5,3.1,0,0", "--all"], 1.2),
        (["equations", "planar_rr"], 0.8),
    ],
    ids=["plan", "ik", "equations"],
)
def test_ctrl_c_ends_a_command_in_silence(words: list[str], longest: float) -> None:
    """While it loads, computes and prints; a planner that looks for the best has no other end."""
    delays = np.sort(np.random.default_rng(len(words)).uniform(0.0, longest, 3))
    for delay in delays:
        process = interruptible(words)
        time.sleep(delay)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
        assert err == "", (delay, err)
        assert process.returncode == 130 or (process.returncode == 0 and words is not ENDLESS)
        assert out == "" or words is not ENDLESS
