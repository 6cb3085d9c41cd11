"""Look for packages with known faults, and say so where that can't be found out.

``python -m scripts.audit <pip-audit> [constraints.txt]``: 0 if no package has a known fault, 1 if
one has, 2 if one could not be looked up. pip-audit alone ends with 0 then: an index without
advisories, such as many mirrors, would pass for a clean one.
"""

import json
import subprocess
import sys
from typing import Any

#: Names that a message tells at most.
_SHOWN = 5
_FAULTS, _UNKNOWN = 1, 2


def verdict(found: dict[str, Any]) -> tuple[int, str]:
    """The exit code and what to say of an answer of pip-audit in JSON.

    Args:
        found: With "dependencies", each with "vulns" or a "skip_reason".
    """
    packages = found["dependencies"]
    faults = [
        f"{one['name']} {one['version']}: {fault['id']}, mended in "
        f"{', '.join(fault['fix_versions']) or 'no version'}"
        for one in packages
        for fault in one.get("vulns", ())
    ]
    if faults:
        return _FAULTS, "\n".join(["packages with known faults:", *faults])
    missed = [one["name"] for one in packages if "skip_reason" in one]
    if missed:
        shown = ", ".join(missed[:_SHOWN]) + (", ..." if len(missed) > _SHOWN else "")
        return _UNKNOWN, (
            f"{len(missed)} of {len(packages)} packages could not be audited ({shown}): the index "
            "has no advisories. Run it where https://pypi.org or https://api.osv.dev is reached."
        )
    if not packages:
        return _UNKNOWN, "there was nothing to audit"
    return 0, f"{len(packages)} packages without known faults"


def main() -> int:
    """Run pip-audit and judge its answer."""
    program, *rest = sys.argv[1:]
    constraints = rest[0] if rest else "constraints.txt"
    command = [program, "-r", constraints, "--no-deps", "--disable-pip", "--format", "json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    try:
        found = json.loads(done.stdout)
    except ValueError:
        print(done.stderr.strip() or "pip-audit said nothing", file=sys.stderr)
        print("no package could be audited", file=sys.stderr)
        return _UNKNOWN
    code, text = verdict(found)
    print(text, file=sys.stderr if code else sys.stdout)
    return code


if __name__ == "__main__":
    sys.exit(main())
