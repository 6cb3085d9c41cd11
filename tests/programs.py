"""Programs that tests need beside packages; without one its tests are skipped, or fail in CI."""

import os
from collections import Counter
from collections.abc import Iterable
from typing import NoReturn

import pytest

#: Setting under which no test may be left out: that of .ci/run.
TEST_ALL = "ARMWRIGHT_TEST_ALL"
_BEGIN = "needs "


def missing(program: str, cure: str) -> NoReturn:
    """Skip a test whose program is not installed.

    Args:
        program: Name of the program.
        cure: How to install it.

    Raises:
        Failed: ARMWRIGHT_TEST_ALL is 1.
        Skipped: Otherwise.
    """
    reason = f"{_BEGIN}{program} ({cure})"
    if os.environ.get(TEST_ALL) == "1":
        pytest.fail(reason, pytrace=False)
    pytest.skip(reason)


def not_run(reasons: Iterable[str]) -> str | None:
    """The line that says which tests were not run for want of a program.

    Args:
        reasons: Reasons of all skipped tests.

    Returns:
        The line, or None where no program was missing.
    """
    counts = Counter(
        reason.removeprefix("Skipped: ").removeprefix(_BEGIN)
        for reason in reasons
        if reason.removeprefix("Skipped: ").startswith(_BEGIN)
    )
    if not counts:
        return None
    parts = ", ".join(f"{count} for want of {program}" for program, count in counts.items())
    return f"Not run: {parts}. {TEST_ALL}=1 makes this an error."
