"""Write the reference pages that are made of the code: docs/reference.

    python scripts/reference.py [--check]

Pages: one of the HTTP API for each group of operations, with an example request and its real answer
for each; the objects that requests are made of, with all their fields and values; settings;
problems with their cures; metrics. With --check nothing is written, and the exit code is 1 where a
page is stale.
"""

import argparse
import json
import os
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from pydantic_core import PydanticUndefined

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from service.app import create_app  # noqa: E402
from service.http import metrics  # noqa: E402
from service.http.errors import KINDS  # noqa: E402
from service.http.openapi import BUNDLE, Example, examples  # noqa: E402
from service.settings import Settings  # noqa: E402

FOLDER = ROOT / "docs/reference"
#: Longest line of an example [characters].
_WIDTH = 100
#: Page of the objects that requests are made of.
_OBJECTS = "http_objects.md"
_MADE = "<!-- Made by scripts/reference.py. -->\n\n"
#: Methods in the order in which a page shows them.
_METHODS = ("post", "get", "put", "patch", "delete")


def pages() -> dict[str, str]:
    """All pages by the name of their file."""
    app = create_app()
    document = app.openapi()
    groups = defaultdict(list)
    for path, operations in document["paths"].items():
        for method in sorted(operations, key=_METHODS.index):
            groups[operations[method]["tags"][0]].append((path, method, operations[method]))
    http = {
        f"http_{tag.replace(' ', '_')}.md": _http_page(tag, group, document)
        for tag, group in groups.items()
    }
    return {
        "README.md": _index(sorted(groups)),
        **http,
        _OBJECTS: _objects_page(document),
        "settings.md": _settings(),
        "problems.md": _problems(),
        "metrics.md": _metrics(app),
    }


def _index(tags: list[str]) -> str:
    lines = [f"- [HTTP: {tag}](http_{tag.replace(' ', '_')}.md)" for tag in tags]
    return (
        "# Reference\n\n" + _MADE + "\n".join(lines) + "\n"
        f"- [HTTP: objects of requests]({_OBJECTS}), every option with its values\n"
        "- [Settings](settings.md) of the service\n"
        "- [Problems](problems.md), their codes and cures\n"
        "- [Metrics](metrics.md) for Prometheus\n"
        "- [The library](../library.md), [the client](../../client/README.md), "
        "[the command line](../command_line.md)\n\n"
        "A running service shows the same at `/docs`; `/openapi.json` is for programs.\n"
    )


def _http_page(tag: str, group: list[tuple[str, str, Any]], document: dict[str, Any]) -> str:
    shown = defaultdict(list)
    for example in examples():
        shown[example.operation].append(example)
    parts = [f"# HTTP: {tag}\n\n{_MADE}Long lists in answers are cut.\n"]
    for path, method, operation in group:
        parts.append(f"## {operation['summary']}\n\n`{method.upper()} {path}`\n")
        parts.append(operation["description"].strip() + "\n")
        parts.append(_fields(operation, document))
        parts += [_example(method, one) for one in shown[operation["operationId"]]]
    return "\n".join(part for part in parts if part)


def _fields(operation: dict[str, Any], document: dict[str, Any]) -> str:
    """Fields of the request with their values and descriptions, required ones first."""
    content = operation.get("requestBody", {}).get("content", {})
    reference = content.get("application/json", {}).get("schema", {}).get("$ref", "")
    return _table(document["components"]["schemas"].get(_name(reference), {}), full=False)


def _table(schema: dict[str, Any], *, full: bool) -> str:
    """Fields of an object as a table.

    Args:
        schema: Schema of the object.
        full: Whether descriptions are whole, not their first lines.
    """
    required = set(schema.get("required", ()))
    rows = []
    for name, field in sorted(
        schema.get("properties", {}).items(), key=lambda item: item[0] not in required
    ):
        text = _cell(field.get("description", "")) if full else _meaning(field)
        default = field.get("default")
        if default is not None:
            text += f"; `{json.dumps(default, ensure_ascii=False)}` if left out"
        label = f"`{name}`{' (required)' if name in required else ''}"
        rows.append(f"| {label} | {_values(field)} | {text.removeprefix('; ')} |")
    return (
        "\n".join(["| field | values | meaning |", "|---|---|---|", *rows]) + "\n" if rows else ""
    )


def _name(reference: str) -> str:
    return reference.rpartition("/")[2]


#: Bounds of numbers and lengths, as they are written.
_BOUNDS = {
    "exclusiveMinimum": "> {}", "minimum": ">= {}", "exclusiveMaximum": "< {}", "maximum": "<= {}",
}  # fmt: skip


def _values(schema: dict[str, Any]) -> str:
    """The values that a schema allows, in words, with links to objects."""
    if "$ref" in schema:
        name = _name(schema["$ref"])
        return f"[{name}]({_OBJECTS}#{name.lower()})"
    if "const" in schema or "enum" in schema:
        values = schema.get("enum", [schema.get("const")])
        return ", ".join(f"`{json.dumps(value)}`" for value in values)
    for key in ("anyOf", "oneOf"):
        if key in schema:
            parts = [_values(part) for part in schema[key]]
            return " or ".join(dict.fromkeys(part for part in parts if part != "null"))
    kind = schema.get("type", "")
    if kind == "array":
        low, high = schema.get("minItems"), schema.get("maxItems")
        count = f"{low} " if low is not None and low == high else ""
        return f"list of {count}{_values(schema.get('items', {})) or 'values'}"
    if kind == "object":
        inner = schema.get("additionalProperties")
        return f"object of {_values(inner)} by name" if isinstance(inner, dict) else "object"
    if kind in ("number", "integer"):
        bounds = [text.format(schema[key]) for key, text in _BOUNDS.items() if key in schema]
        return (
            " ".join([kind, ", ".join(bounds)]).strip()
            if abs(schema.get("maximum", 0)) < 1e6
            else kind
        )
    return str(kind)


def _objects_page(document: dict[str, Any]) -> str:
    """The objects that requests are made of, and those that are parts of them."""
    schemas = document["components"]["schemas"]
    waiting = sorted(
        {
            _name(reference)
            for operations in document["paths"].values()
            for operation in operations.values()
            for reference in _references(operation.get("requestBody", {}))
        }
    )
    shown: dict[str, str] = {}
    while waiting:
        name = waiting.pop()
        if name in shown or name not in schemas:
            continue
        schema = schemas[name]
        table = _table(schema, full=True) or f"{_values(schema)}\n"
        shown[name] = f"## {name}\n\n{schema.get('description', '').strip()}\n\n{table}"
        waiting += [_name(reference) for reference in _references(schema)]
    parts = [shown[name] for name in sorted(shown)]
    head = "# HTTP: objects of requests\n\n" + _MADE
    return (
        head
        + "Every field with the values it may have. `joints` and the like are vectors.\n\n"
        + "\n".join(parts)
    )


def _references(part: Any) -> Iterator[str]:
    """All references in a part of the document."""
    if isinstance(part, dict):
        for key, value in part.items():
            if key == "$ref":
                yield value
            elif key == "mapping":
                yield from value.values()
            else:
                yield from _references(value)
    elif isinstance(part, list):
        for item in part:
            yield from _references(item)


def _example(method: str, example: Example) -> str:
    head = f"{example.title}:\n\n```http\n{method.upper()} {example.path}\n"
    request = example.request
    if request == BUNDLE:
        request = {"armwright_bundle": 1, "...": "the bundle that GET answered"}
    body = "" if request is None else f"\n{_json(request)}\n"
    if example.answer is None:
        return f"{head}{body}```\n\nAnswer {example.status}, without content.\n"
    kind = "text" if isinstance(example.answer, str) else "json"
    answer = example.answer if kind == "text" else _json(example.answer)
    return f"{head}{body}```\n\nAnswer {example.status}:\n\n```{kind}\n{answer.rstrip()}\n```\n"


def _json(value: Any, indent: str = "") -> str:
    """JSON with what fits into a line on one line."""
    flat = json.dumps(value, ensure_ascii=False)
    if len(indent) + len(flat) <= _WIDTH or not isinstance(value, dict | list) or not value:
        return flat
    inner = indent + "  "
    if isinstance(value, dict):
        items = [f"{inner}{json.dumps(key)}: {_json(item, inner)}" for key, item in value.items()]
        return "{\n" + ",\n".join(items) + f"\n{indent}}}"
    return "[\n" + ",\n".join(inner + _json(item, inner) for item in value) + f"\n{indent}]"


def _meaning(field: dict[str, Any]) -> str:
    """The first line: options of single planners stand in `/docs`."""
    return _cell(field["description"].partition("\n")[0])


def _cell(text: str) -> str:
    return text.replace("\n* ", "; ").replace("\n", " ").replace("|", "\\|")


def _settings() -> str:
    rows = [
        f"| `ARMWRIGHT_{name.upper()}` | {_default(name)} | {_cell(' '.join(text.split()))} |"
        for name, field in Settings.model_fields.items()
        for text in [field.description or ""]
    ]
    return (
        "# Settings\n\n"
        + _MADE
        + "Each is an environment variable; `armwright serve --help` names the "
        "options of the command.\n\n| variable | default | meaning |\n|---|---|---|\n"
        + "\n".join(rows)
        + "\n"
    )


def _default(name: str) -> str:
    made_here = {"data_dir": "the user's data folder", "workers": "the number of processors"}
    if name in made_here:
        return made_here[name]
    default = Settings.model_fields[name].default
    assert default is not PydanticUndefined, name
    return "none" if default in (None, "") else f"`{default}`"


def _problems() -> str:
    rows = [
        f"| `{code}` | {kind.status} | {kind.title} | {kind.hint} |"
        for code, kind in sorted(KINDS.items(), key=lambda item: (item[1].status, item[0]))
    ]
    return (
        "# Problems\n\n"
        + _MADE
        + "Every error is a problem document (RFC 9457). `code` says which "
        "kind it is, `detail` what is wrong this time, `hint` what to do then.\n\n"
        "| code | status | meaning | cure |\n|---|---|---|---|\n" + "\n".join(rows) + "\n"
    )


def _metrics(app: Any) -> str:
    families = [*app.state.metrics.registry.collect(), *_idle_families()]
    rows = [f"| `{name}` | {kind} | {_cell(text)} |" for name, kind, text in _described(families)]
    return (
        "# Metrics\n\n"
        + _MADE
        + "`GET /metrics` answers these in the text format of Prometheus.\n\n"
        "| metric | kind | meaning |\n|---|---|---|\n" + "\n".join(rows) + "\n"
    )


def _idle_families() -> Iterator[Any]:
    """Families that are collected from workers and jobs: of a service without work."""
    zeros: Any = defaultdict(int)
    counters = SimpleNamespace(**dict.fromkeys(metrics._OUTCOMES, 0))
    counts = dict.fromkeys(
        ("waiting", "background_waiting", "count", "alive", "busy", "spare", "started_workers"), 0
    )
    idle = SimpleNamespace(counters=counters, **counts)
    app: Any = SimpleNamespace(state=SimpleNamespace(supervisor=idle))
    for collector in (metrics._State(app), metrics._Jobs(zeros, 0)):
        yield from collector.collect()


def _described(families: list[Any]) -> Iterator[tuple[str, str, str]]:
    for family in sorted(families, key=lambda one: one.name):
        suffix = "_total" if family.type == "counter" else ""
        yield family.name + suffix, family.type, family.documentation


def stale(made: dict[str, str], folder: Path = FOLDER) -> list[str]:
    """Names of pages that are not as the code makes them, or that nothing makes.

    Args:
        made: The pages as the code makes them, by name.
        folder: Where the pages are.
    """
    there = {path.name: path.read_text("utf-8") for path in folder.glob("*.md")}
    return sorted(name for name in made.keys() | there.keys() if made.get(name) != there.get(name))


def main() -> None:
    """Write the pages, or say which are stale."""
    parser = argparse.ArgumentParser(description="Write the reference pages.")
    parser.add_argument("--check", action="store_true", help="only say which are stale")
    for name in [one for one in os.environ if one.startswith("ARMWRIGHT_")]:
        del os.environ[name]
    made = pages()
    names = stale(made)
    if not parser.parse_args().check:
        FOLDER.mkdir(exist_ok=True)
        for path in FOLDER.glob("*.md"):
            if path.name not in made:
                path.unlink()
        for name, text in made.items():
            (FOLDER / name).write_text(text, "utf-8")
        print(f"{len(made)} pages, {len(names)} of them new or changed")
        return
    print("\n".join(names) or "all pages are as the code makes them")
    sys.exit(1 if names else 0)


if __name__ == "__main__":
    main()
