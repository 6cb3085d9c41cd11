import signal
import socket
import time
from pathlib import Path

import httpx
import pytest

from service.cli import main
from service.settings import Settings
from service.storage.store import open_store
from service.version import VERSION
from tests.service.commands import serve
from tests.service.processes import alive, descendants, wait_until


def store_scene(client: httpx.Client, name: str) -> int:
    return client.post("/v1/scenes", json={"name": name, "obstacles": []}).status_code


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
        assert store_scene(client, "kept") == 201
        below = descendants(process.pid)
        assert len(below) >= 3, "the fork server and two workers"
        process.kill()
        process.wait()
        assert wait_until(lambda: not any(alive(pid) for pid in below), 20.0)
    store = open_store(Settings(data_dir=tmp_path).storage_url)
    assert store.documents.get("scene", "kept").content
    store.close()
    with serve(tmp_path) as (process, client):
        assert client.get("/v1/scenes/kept").status_code == 200
        assert store_scene(client, "kept") == 409
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
