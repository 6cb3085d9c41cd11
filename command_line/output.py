"""Answers for people, as tables, and for programs, as JSON."""

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from service.viewer.words import against

#: Digits after the point of lengths [m] and angles [rad].
_DIGITS = 4
#: Whether a command has printed its answer as JSON, so that nothing for people follows.
_is_answered = ContextVar("is_answered", default=False)


def console() -> Console:
    """The console that people read; made anew since tests replace standard output."""
    return Console(highlight=False, soft_wrap=True, quiet=_is_answered.get())


def print_json(answer: bytes | Any) -> None:
    """Print an answer as JSON.

    Args:
        answer: The answer of the API, or a value.
    """
    text = answer.decode() if isinstance(answer, bytes) else json.dumps(answer)
    sys.stdout.write(text.rstrip("\n") + "\n")


def print_answer(answer: bytes | Any, as_json: bool) -> None:
    """Print an answer as JSON where that is asked for; tables and lines after it are left out.

    Args:
        answer: The answer of the API, or a value.
        as_json: Whether JSON is asked for.
    """
    if as_json:
        print_json(answer)
        _is_answered.set(True)


def print_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """Print a table.

    Args:
        title: Title above the table.
        columns: Names of the columns.
        rows: Values of each row; numbers are rounded.
    """
    table = Table(title=title, title_justify="left")
    for column in columns:
        table.add_column(Text(column), overflow="fold")
    for row in rows:
        table.add_row(*(Text(word(value)) for value in row))
    # As wide as the table needs where no terminal limits it: pipes get whole words.
    width = None if sys.stdout.isatty() else 240
    Console(highlight=False, width=width, quiet=_is_answered.get()).print(table)


def print_line(text: str, style: str = "") -> None:
    """Print a line that is not broken.

    Args:
        text: The line.
        style: Color and weight, as rich names them.
    """
    console().print(Text(text, style=style))


def print_notes(notes: Iterable[str]) -> None:
    """Print the notes of an answer."""
    for note in notes:
        print_line(f"note: {note}", "yellow")


def print_premises(what: str, certificates: Iterable[Mapping[str, Any]]) -> None:
    """Print what each of several motions is proved against, those together that share it.

    Args:
        what: Name of one motion: "stage", "leg".
        certificates: Certificates of the motions, in order.
    """
    numbers: dict[str, list[int]] = {}
    for number, certificate in enumerate(certificates):
        numbers.setdefault(against(certificate), []).append(number)
    for text, those in numbers.items():
        print_line(f"{what} {', '.join(map(str, those))}: {text}")


def word(value: Any) -> str:
    """A value in a table: numbers rounded, lists with commas, "-" for nothing."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.{_DIGITS}f}"
    if isinstance(value, list | tuple):
        return ", ".join(word(item) for item in value)
    return str(value)


def save(path: Path, answer: bytes) -> None:
    """Write an answer to a file.

    Args:
        path: Path of the file.
        answer: The answer of the API.
    """
    path.write_bytes(answer)
    Console(stderr=True, highlight=False).print(Text(f"written to {path}"))
