"""The command of the service: what it serves, remembers, refuses, and shows of its progress."""

import io
import signal
import socket
import time
from pathlib import Path

import pytest

from service.cli import Terminal, main, progress_text
from service.settings import Settings
from service.storage.store import open_store
from service.version import VERSION
from tests.service.commands import serve
from tests.service.processes import alive, descendants, wait_until
from tests.service.robots import DETOUR, answer, bench


def test_version_and_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"armwright {VERSION}\n"
    assert main([]) == 2
    assert "serve" in capsys.readouterr().out


def test_nothing_outlives_a_server_that_is_killed_and_the_next_remembers_and_ends_promptly(
    tmp_path: Path,
) -> None:
    with serve(tmp_path) as (process, client):
        assert client.get("/readyz").json()["workers"] == 2
        robot = answer(client.post("/v1/robots", json=bench("kept")), 201)
        answer(client.post("/v1/scenes", json={"name": "kept", **DETOUR["scene"]}), 201)
        before = answer(client.post("/v1/plan", json=DETOUR | {"scene": "kept"}))
        below = descendants(process.pid)
        assert len(below) >= 3, "the fork server and two workers"
        process.kill()
        process.wait()
        assert wait_until(lambda: not any(alive(pid) for pid in below), 20.0)
    store = open_store(Settings(data_dir=tmp_path).storage_url)
    assert store.documents.get("scene", "kept").content
    store.close()
    with serve(tmp_path) as (process, client):
        assert answer(client.get("/v1/robots/kept")) == robot
        fk = answer(client.post("/v1/robots/kept/fk", json={"joints": [0.1, 0.2]}))
        assert set(fk["links"]) == {"base", "lower", "upper", "tip"}
        after = answer(client.post("/v1/plan", json=DETOUR | {"scene": "kept"}))
        for part in ("trajectory", "certificate", "reproducibility"):
            assert after[part] == before[part]
        answer(client.post("/v1/scenes", json={"name": "kept", "obstacles": []}), 409)
        below = descendants(process.pid)
        # Connections that stay open, one of them in the middle of a request, must not hold it up.
        address = (client.base_url.host, client.base_url.port or 0)
        with socket.create_connection(address), socket.create_connection(address) as halfway:
            halfway.sendall(
                b"POST /v1/scenes HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"
                b"Content-Length: 100\r\n\r\n{"
            )
            time.sleep(0.2)
            process.send_signal(signal.SIGINT)
            assert process.wait(15.0) == 0
        assert wait_until(lambda: not any(alive(pid) for pid in below), 10.0)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_it_ends_promptly_while_it_warms_up(tmp_path: Path, number: signal.Signals) -> None:
    with serve(tmp_path, warm=False) as (process, client):
        assert client.get("/readyz").status_code == 503
        below = descendants(process.pid)
        process.send_signal(number)
        # Compiling all kernels takes more than a minute; it must not wait for them.
        assert process.wait(20.0) in (0, -signal.SIGKILL)
        assert wait_until(lambda: not any(alive(pid) for pid in below), 10.0)


@pytest.mark.parametrize("arguments", [["--port", "70000"], ["--workers", "0"]])
def test_settings_out_of_range_are_refused(
    arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["serve", "--data-dir", str(tmp_path), *arguments]) == 1
    assert arguments[0].strip("-") in capsys.readouterr().err


def test_a_data_folder_that_is_none_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    assert main(["serve", "--port", "0", "--data-dir", str(tmp_path / "file")]) == 1
    assert "--data-dir" in capsys.readouterr().err


def test_a_port_that_is_taken_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert main(["serve", "--data-dir", str(tmp_path), "--port", str(port)]) == 1
    assert f"port {port}" in capsys.readouterr().err


def test_the_environment_sets_what_the_command_line_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("ARMWRIGHT_DATA_DIR", str(tmp_path))
    monkeypatch.setenv("ARMWRIGHT_WORKERS", "none")
    assert main(["serve", "--port", "0"]) == 1
    assert "workers" in capsys.readouterr().err


class FakeTerminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(
    ("done", "remaining", "text"),
    [
        (0, None, "Compiling kernels: 0 of 8"),
        (3, 41.6, "Compiling kernels: 3 of 8, about 42 s left"),
    ],
)
def test_progress_says_how_many_of_how_many_and_how_long(
    done: int, remaining: float | None, text: str
) -> None:
    assert progress_text(done, 8, remaining) == text


def show(stream: io.StringIO, times: list[float], monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setattr("service.cli.time.monotonic", lambda: 0.0)
    terminal = Terminal(stream)
    for done, now in enumerate(times):
        monkeypatch.setattr("service.cli.time.monotonic", lambda now=now: now)
        terminal.show(done, len(times) - 1, 1.0)
    return stream.getvalue()


def test_a_terminal_shows_one_line_that_is_written_over(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = show(FakeTerminal(), [1.0, 1.1, 1.25, 1.3], monkeypatch)
    assert shown.count("\n") == 1
    assert shown.endswith("\n")
    assert [part.split(",")[0] for part in shown.split("\r\x1b[K")[1:]] == [
        "Compiling kernels: 0 of 3",
        "Compiling kernels: 2 of 3",
        "Compiling kernels: 3 of 3 in 1 s\n",
    ]


def test_a_file_gets_a_line_every_ten_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = show(io.StringIO(), [1.0, 5.0, 10.9, 11.0, 12.0, 13.0], monkeypatch)
    assert [line.split(",")[0] for line in shown.splitlines()] == [
        "Compiling kernels: 0 of 5",
        "Compiling kernels: 3 of 5",
        "Compiling kernels: 5 of 5 in 13 s",
    ]
