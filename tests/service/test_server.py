"""The server started in a folder that holds packages of the same names."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

from tests.service.processes import descendants, wait_until

#: The same as the command that is installed: the script's folder is on the path, not the current.
SCRIPT = "import sys\nfrom service.cli import main\nsys.exit(main())\n"
MARK = "import pathlib, os\npathlib.Path({marker!r}).write_text(__file__)\n"
ROOT = Path(__file__).parents[2]


def start(folder: Path, tmp_path: Path) -> subprocess.Popen[str]:
    script = tmp_path / "bin" / "armwright"
    script.parent.mkdir()
    script.write_text(SCRIPT)
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONSAFEPATH"}
    environment |= {"ARMWRIGHT_WORKERS": "1", "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(
        [sys.executable, str(script), "serve", "--port", "0", "--data-dir", str(tmp_path / "data")],
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
    )


def test_packages_in_the_current_folder_are_not_imported(tmp_path: Path) -> None:
    folder, marker = tmp_path / "project", tmp_path / "marker"
    for package, module in (("service", "warm"), ("planning", "pipeline"), ("signal", "x")):
        (folder / package).mkdir(parents=True)
        for name in ("__init__", module):
            (folder / package / f"{name}.py").write_text(MARK.format(marker=str(marker)))
    process = start(folder, tmp_path)
    try:
        assert process.stdout is not None
        assert re.match(r"Armwright serves on http://", process.stdout.readline())
        # The fork server; what it imports is imported within a second.
        assert wait_until(lambda: len(descendants(process.pid)) >= 1, 20.0)
        assert not wait_until(marker.exists, 3.0), marker.read_text()
    finally:
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=30)
