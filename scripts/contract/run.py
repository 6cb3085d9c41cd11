"""Start a server, and hold it against its OpenAPI document with schemathesis.

``python -m scripts.contract.run <schemathesis> [options of schemathesis run]``; the exit code is
that of schemathesis: 0 if nothing was found.
"""

import subprocess
import sys
from pathlib import Path

import httpx

from benchmarks.server.machines import local_server

FOLDER = Path(__file__).parent
#: hooks.py has sharper checks in place of these.
REPLACED = "positive_data_acceptance,not_a_server_error"
#: Beyond the longest deadline of requests that can't name one, which pages of plans have [s].
_LONGEST_ANSWER = "70"


def main() -> int:
    """Run schemathesis with the arguments of this script."""
    program, *options = sys.argv[1:]
    with local_server({"ARMWRIGHT_WORKERS": "2"}) as (_, url):
        httpx.get(f"{url}/openapi.json", timeout=60.0)  # made at the first request
        command = [
            str(Path(program).absolute()), "--config-file", "schemathesis.toml", "run",
            f"{url}/openapi.json", "--checks", "all", "--exclude-checks", REPLACED,
            "--phases", "examples,coverage,fuzzing", "-n", "15", "--continue-on-failure",
            "--suppress-health-check", "all", "--request-timeout", _LONGEST_ANSWER,
            "--max-response-time", _LONGEST_ANSWER, *options,
        ]  # fmt: skip
        return subprocess.run(command, cwd=FOLDER, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
