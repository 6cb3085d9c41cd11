"""No public function answers, or ends the process, for arguments that are none of its own."""

import json
import subprocess
import sys
from pathlib import Path

PROGRAM = Path(__file__).with_name("wrong_arguments.py")
ROOT = PROGRAM.parents[2]


def test_wrong_arguments_are_told_and_never_answered() -> None:
    ran = subprocess.run(
        [sys.executable, "-W", "ignore", str(PROGRAM)],
        cwd=ROOT,
        capture_output=True,
        check=False,
        text=True,
    )
    # A process that is aborted has a negative code; the last name it told is whose call it was.
    assert ran.returncode == 0, ran.stderr[-500:]
    told = json.loads(ran.stdout)
    assert told["missing"] == []
    assert told["failures"] == []
    assert told["count"] > 1000
