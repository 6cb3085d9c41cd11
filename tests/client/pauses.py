"""Pauses of a module that are noted and not made."""

from types import ModuleType, SimpleNamespace

import pytest


def noted_pauses(monkeypatch: pytest.MonkeyPatch, module: ModuleType) -> list[float]:
    """The pauses that a module makes from now on: its clock goes on by them, and nobody waits.

    Only this module's: servers of other tests may run in threads of this process, and need theirs.
    """
    made: list[float] = []

    async def note(seconds: float) -> None:
        made.append(seconds)

    clock = SimpleNamespace(sleep=made.append, monotonic=lambda: 1000.0 + sum(made))
    monkeypatch.setattr(module, "time", clock)
    monkeypatch.setattr(module, "asyncio", SimpleNamespace(sleep=note))
    return made
