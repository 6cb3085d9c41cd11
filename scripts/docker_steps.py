"""Run the steps of the Dockerfile without Docker, then start, probe and stop what they built.

Each absolute path that the image writes to is moved under one temporary folder; a new stage sees
only what it copies. The one kind of step left out creates users and hands folders to them. A clean
virtual environment is installed on the way, so this takes minutes.
"""

import json
import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

REPOSITORY = Path(__file__).parents[1]
# Folders that the image makes for itself; all other absolute paths are the base image's.
IMAGE_FOLDERS = ("/opt/venv", "/src", "/data", "/var/cache/armwright")
NOT_COPIED = shutil.ignore_patterns("__pycache__", "*.nbi", "*.nbc")
READY_WITHIN = 300.0  # [s], kernels are warm already, so seconds do on any machine
STOP_WITHIN = 30.0  # [s], the grace period of compose.yaml


@dataclass
class Stage:
    """What the steps so far have set; files of the stage lie under `root`."""

    root: Path
    environment: dict[str, str]
    folder: str = "/"
    shell: list[str] = field(default_factory=lambda: ["/bin/sh", "-c"])
    command: list[str] = field(default_factory=list)
    probe: list[str] = field(default_factory=list)
    stop_signal: signal.Signals = signal.SIGTERM

    def relocate(self, text: str) -> str:
        """The text with every path of the image's own folders moved under the root."""
        for folder in IMAGE_FOLDERS:
            text = re.sub(rf"(?<![\w/.]){re.escape(folder)}(?![\w-])", f"{self.root}{folder}", text)
        return text

    def path(self, text: str) -> Path:
        """Where a path of the image, relative to its working folder, lies here."""
        absolute = text if text.startswith("/") else f"{self.folder}/{text}"
        return Path(self.relocate(os.path.normpath(absolute)))

    def run(self, command: list[str]) -> None:
        """Run a command as the image would; a failure ends the script."""
        subprocess.run(command, cwd=self.path("."), env=self.environment, check=True)


def steps(text: str) -> Iterator[tuple[str, str]]:
    """The instructions of a Dockerfile with their arguments, continued lines joined."""
    lines = [line for line in text.splitlines() if not line.lstrip().startswith("#")]
    for line in "\n".join(lines).replace("\\\n", " ").splitlines():
        if line.strip():
            instruction, _, arguments = line.strip().partition(" ")
            yield instruction.upper(), " ".join(arguments.split())


def base_environment(folder: Path) -> dict[str, str]:
    """An environment without our own settings, whose `python` is the base interpreter."""
    interpreter = folder / "python"
    interpreter.symlink_to(Path(sys.base_prefix) / "bin" / "python3")
    kept = {name: value for name, value in os.environ.items() if not name.startswith("ARMWRIGHT_")}
    for name in ("VIRTUAL_ENV", "PYTHONPATH", "PYTHONHOME"):
        kept.pop(name, None)
    return {**kept, "PATH": f"{folder}:/usr/local/bin:/usr/bin:/bin"}


def exec_form(arguments: str) -> list[str]:
    """The words of an instruction in its exec form, the only one used for CMD and HEALTHCHECK."""
    words: list[str] = json.loads(arguments[arguments.index("[") :])
    return words


def set_variables(stage: Stage, arguments: str) -> None:
    """ENV: names and values, `$NAME` taken from what is set already."""
    for word in shlex.split(arguments):
        name, _, value = word.partition("=")
        value = re.sub(r"\$\{?(\w+)\}?", lambda match: stage.environment[match[1]], value)
        stage.environment[name] = stage.relocate(value)


def copy(stage: Stage, arguments: str, finished: dict[str, Path]) -> None:
    """COPY from the repository or, with --from, from a finished stage."""
    words = shlex.split(arguments)
    options = [word for word in words if word.startswith("--")]
    *sources, target = [word for word in words if not word.startswith("--")]
    origin = next((word.removeprefix("--from=") for word in options if "--from=" in word), None)
    for source in sources:
        here = finished[origin] / source.lstrip("/") if origin else REPOSITORY / source
        there = stage.path(target)
        there.parent.mkdir(parents=True, exist_ok=True)
        if here.is_dir():
            ignore = None if origin else NOT_COPIED
            shutil.copytree(here, there, symlinks=True, dirs_exist_ok=True, ignore=ignore)
        else:
            there.mkdir(parents=True, exist_ok=True)
            shutil.copy2(here, there)


def apply(stage: Stage, instruction: str, arguments: str, finished: dict[str, Path]) -> None:
    """Do what one instruction says, or say that it is left out."""
    match instruction:
        case "RUN" if arguments.startswith("useradd"):
            print("   left out: it would change this machine")
        case "RUN":
            stage.run([*stage.shell, stage.relocate(arguments)])
        case "COPY":
            copy(stage, arguments, finished)
        case "ENV":
            set_variables(stage, arguments)
        case "WORKDIR":
            stage.folder = arguments
            stage.path(".").mkdir(parents=True, exist_ok=True)
        case "SHELL":
            stage.shell = exec_form(arguments)
        case "CMD":
            stage.command = exec_form(arguments)
        case "HEALTHCHECK":
            stage.probe = exec_form(arguments)
        case "STOPSIGNAL":
            stage.stop_signal = signal.Signals[arguments]
        case "ARG" | "USER" | "VOLUME" | "EXPOSE":
            pass
        case _:
            raise SystemExit(
                f"Dockerfile: {instruction} is not known here; teach scripts/ about it"
            )


def build(text: str, folder: Path) -> Stage:
    """Run all stages and return the last."""
    root = folder / "image"
    (folder / "bin").mkdir()
    environment = base_environment(folder / "bin")
    finished: dict[str, Path] = {}
    name, stage = "", Stage(root, dict(environment))
    for instruction, arguments in steps(text):
        print(f"-> {instruction} {arguments}", flush=True)
        if instruction != "FROM":
            apply(stage, instruction, arguments, finished)
            continue
        if root.exists():  # aside, so that the new stage has the same paths and nothing else
            finished[name] = root.rename(folder / f"stage-{len(finished)}")
        root.mkdir()
        name, stage = arguments.split()[-1], Stage(root, dict(environment))
    return stage


def answer(url: str) -> int:
    """The status of a GET, 0 while nothing listens."""
    try:
        with urllib.request.urlopen(url, timeout=5) as response:
            return int(response.status)
    except urllib.error.HTTPError as error:
        return error.code
    except OSError:
        return 0


def serve_and_stop(stage: Stage) -> None:
    """Start CMD, wait until it is ready, run HEALTHCHECK, send STOPSIGNAL, expect exit code 0."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    stage.environment |= {"ARMWRIGHT_PORT": str(port), "ARMWRIGHT_HOST": "127.0.0.1"}
    started = time.monotonic()
    server = subprocess.Popen(stage.command, cwd=stage.path("."), env=stage.environment)
    try:
        while answer(f"http://127.0.0.1:{port}/readyz") != 200:
            if server.poll() is not None or time.monotonic() - started > READY_WITHIN:
                raise SystemExit(f"the service was not ready; exit code {server.poll()}")
            time.sleep(0.1)
        print(f"ready after {time.monotonic() - started:.1f} s", flush=True)
        stage.run(stage.probe)
        print("healthy", flush=True)
        server.send_signal(stage.stop_signal)
        code = server.wait(STOP_WITHIN)
        if code != 0:
            raise SystemExit(f"{stage.stop_signal.name} ended the service with exit code {code}")
        print("stopped cleanly")
    finally:
        server.kill()


def main() -> None:
    """Build, serve, probe and stop; the exit code says whether all of it worked."""
    with tempfile.TemporaryDirectory(prefix="armwright-image-") as folder:
        stage = build((REPOSITORY / "Dockerfile").read_text(), Path(folder))
        packages = "opt/venv/lib/python*/site-packages"
        shipped = list(stage.root.glob(f"{packages}/compiled/kernels/*.door*"))
        print(f"machine code of {len(shipped)} kernels that Python calls", flush=True)
        if not shipped:
            raise SystemExit("the image has no machine code: each start would compile it")
        stage.environment["ARMWRIGHT_KERNELS_FROZEN"] = "1"
        serve_and_stop(stage)
        if any(Path(stage.environment["NUMBA_CACHE_DIR"]).rglob("*-*")):
            raise SystemExit("the image's machine code does not do: the service compiled more")


if __name__ == "__main__":
    main()
