"""Untrusted YAML, read strictly: the one door to the YAML parsers.

Aliases, equal keys, depth and length are refused before anything is built of the text.
"""

import math
from collections import Counter
from collections.abc import Hashable, Mapping
from typing import Any, TypeAlias

import yaml

from kinematics.quick_yaml import UnsureYaml, read_quickly

Node: TypeAlias = Any

#: A planning scene of ten thousand boxes is 3 MB of text.
MAX_BYTES = 16 * 2**20
#: A planning scene nests nine deep.
_MAX_DEPTH = 32
_MAX_NODES = 2_000_000
#: Of scalars without quotes whose values are built here.
_SCALAR_TAGS = frozenset(
    f"tag:yaml.org,2002:{name}" for name in ("null", "bool", "int", "float", "str")
)


class UnreadableYaml(ValueError):
    """A text that is no YAML, or more than anybody needs."""


class _Loader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """The safe loader, which takes the last of two equal keys, made to refuse them."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        keys = Counter(key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode))
        twice = [key for key, count in keys.items() if count > 1]
        if twice:
            raise yaml.MarkedYAMLError(
                problem=f"key {twice[0]!r} occurs twice", problem_mark=node.start_mark
            )
        mapping: dict[Hashable, Any] = super().construct_mapping(node, deep)
        return mapping


class _Values:
    """The values of a document, built of its events, of which the parser is quick.

    To have it make nodes and then values of them takes three times as long. What is rare is left to
    that: tags, merge keys, keys that are no text or occur twice, values that can't be made, several
    documents.

    Args:
        loader: Which knows the scalars.

    Attributes:
        complete: whether `root` is the value of the document.
        root: of the document.
    """

    def __init__(self, loader: _Loader) -> None:
        self.complete = True
        self.root: Node = None
        self._loader = loader
        self._documents = 0
        self._scalars: dict[str, Node] = {}
        self._open: list[dict[str, Node] | list[Node]] = []
        self._keys: list[str | None] = []

    def scalar(self, event: yaml.ScalarEvent) -> None:
        """Add a scalar."""
        if not self.complete:
            return
        if event.tag is not None:
            self.complete = False
        text = event.value
        self._add(self._scalar(text) if event.implicit[0] else text)

    def take(self, event: yaml.Event) -> None:
        """Add what begins or ends."""
        if not self.complete:
            return
        if isinstance(event, yaml.CollectionStartEvent):
            if event.tag is not None:
                self.complete = False
            self._open.append({} if isinstance(event, yaml.MappingStartEvent) else [])
            self._keys.append(None)
        elif isinstance(event, yaml.CollectionEndEvent):
            self._keys.pop()
            self._add(self._open.pop())
        elif isinstance(event, yaml.DocumentStartEvent):
            self._documents += 1
            self.complete = self._documents == 1

    def _scalar(self, text: str) -> Node:
        """The value of a scalar without quotes; the same ones come again and again."""
        if text not in self._scalars:
            tag = self._loader.resolve(yaml.ScalarNode, text, (True, False))
            if tag not in _SCALAR_TAGS:
                self.complete = False
                return None
            node = yaml.ScalarNode(tag, text)
            try:
                self._scalars[text] = self._loader.yaml_constructors[tag](self._loader, node)
            except (yaml.YAMLError, ValueError):
                self.complete = False
                return None
        return self._scalars[text]

    def _add(self, value: Node) -> None:
        if not self._open:
            self.root = value
            return
        inside = self._open[-1]
        if isinstance(inside, list):
            inside.append(value)
        elif (key := self._keys[-1]) is not None:
            inside[key], self._keys[-1] = value, None
        elif isinstance(value, str) and value not in inside:
            self._keys[-1] = value
        else:
            self.complete = False


def read_yaml(text: str | bytes) -> Node:
    """The values of a YAML document.

    Args:
        text: The document.

    Raises:
        UnreadableYaml: It is too long, nested too deep, has aliases or is no YAML.
    """
    if len(text) > MAX_BYTES:
        raise UnreadableYaml(f"{len(text)} bytes, at most {MAX_BYTES} are taken")
    try:
        return read_quickly(text, _MAX_DEPTH)
    except UnsureYaml:
        return _parsed(text)


def _parsed(text: str | bytes) -> Node:
    try:
        values = _read_events(text)
        return values.root if values.complete else yaml.load(text, Loader=_Loader)  # nosec B506
    except (yaml.YAMLError, ValueError, TypeError, RecursionError) as error:
        raise UnreadableYaml(f"no readable YAML: {error}") from None


def _read_events(text: str | bytes) -> _Values:
    """Values read from the flat stream of events: nothing recurses or grows beyond the text.

    Raises:
        YAMLError: There are aliases, it is nested too deep or no YAML.
    """
    loader, depth = _Loader(text), 0
    values = _Values(loader)
    try:
        for _ in range(_MAX_NODES):
            event = loader.get_event()
            if isinstance(event, yaml.ScalarEvent):
                values.scalar(event)
                continue
            if event is None:
                return values
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if isinstance(event, yaml.AliasEvent):
                raise _refusal(event, "aliases (*name) are not read")
            if depth > _MAX_DEPTH:
                raise _refusal(event, "nested too deep")
            values.take(event)
        raise yaml.YAMLError(f"more than {_MAX_NODES} values")
    finally:
        loader.dispose()


def _refusal(event: yaml.Event, problem: str) -> yaml.YAMLError:
    mark = event.start_mark
    return yaml.YAMLError(f"line {mark.line + 1 if mark else 0}: {problem}")


def finite_number(node: Node) -> float | None:
    """The number of a scalar; None where it is no finite one."""
    # YAML 1.1 takes 1e-05 for text: it wants a dot.
    if isinstance(node, int | float | str) and not isinstance(node, bool):
        try:
            number = float(node)
        except (ValueError, OverflowError):
            return None
        return number if math.isfinite(number) else None
    return None


def fields_of(node: Node) -> Mapping[str, Node] | None:
    """The named fields of a node; None where it has none."""
    return node if isinstance(node, dict) else None
