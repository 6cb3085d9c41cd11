"""States of the code that are measured in turns: each a process of its own that waits for its turn.

What else the machine does, and how fast its clock is just then, hits all alike.
"""

import json
import os
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any


class State:
    """A state of the code, with its folder in ``PYTHONPATH``, which does what it is asked.

    The script prints ``ready``, then a line of JSON for each line that it reads.

    Args:
        folder: Of the state.
        script: What runs there; the modules that it imports are those of the state.
        arguments: Of the script.
        python: Another interpreter of this version, which takes the packages of this one.

    Raises:
        SystemExit: The script did not start there.
    """

    def __init__(
        self, folder: Path, script: str, *arguments: str, python: str = sys.executable
    ) -> None:
        self.folder = folder.resolve()
        # Packages may have added folders of their own to the path.
        packages = [path for path in sys.path if path.startswith(sysconfig.get_path("purelib"))]
        paths = os.pathsep.join((str(self.folder), str(self.folder / "client"), *packages))
        self._process = subprocess.Popen(
            [python, "-P", str(Path(script).resolve()), *arguments],
            cwd=self.folder, env=os.environ | {"PYTHONPATH": paths},
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        if self._read() != "ready":
            self.end()
            raise SystemExit(f"{folder} did not start")

    def ask(self, line: str) -> Any:
        """Have a turn, and give what it told."""
        assert self._process.stdin is not None
        print(line, file=self._process.stdin, flush=True)
        told = self._read()
        if not told:
            raise SystemExit(f"{self.folder} ended in the midst of its work")
        return json.loads(told)

    def end(self) -> None:
        """Let it end."""
        self._process.communicate()

    def _read(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()
