"""Progress as a person reads it."""

import io

import pytest

from service.cli import Terminal, progress_text


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
