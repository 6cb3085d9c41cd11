"""Untrusted YAML, read strictly: the one door to the YAML parsers.

Equal keys, depth, length, and how much aliases repeat are refused before anything is built of the
text.
"""

import math
from collections import Counter
from collections.abc import Hashable, Mapping
from typing import Any, NamedTuple, TypeAlias

import yaml

from kinematics.readers.quick_yaml import UnsureYaml, read_quickly

Node: TypeAlias = Any

#: A planning scene of ten thousand boxes is 3 MB of text.
MAX_BYTES = 16 * 2**20
#: A planning scene nests nine deep.
_MAX_DEPTH = 32
_MAX_NODES = 2_000_000
#: Characters of a number.
_LONGEST_NUMBER = 64
#: Values that aliases repeat: of a small text a worker is to make no large one.
_MAX_REPEATED = 200_000
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


def _short_number(loader: _Loader, node: yaml.ScalarNode) -> int | float:
    """A number; one of many parts to the base of 60 takes the square of its length in time."""
    if len(node.value) > _LONGEST_NUMBER:
        raise yaml.MarkedYAMLError(problem="a number too long", problem_mark=node.start_mark)
    is_whole = node.tag.endswith("int")
    make = loader.construct_yaml_int if is_whole else loader.construct_yaml_float
    value: int | float = make(node)
    return value


for _kind in ("int", "float"):
    _Loader.add_constructor(f"tag:yaml.org,2002:{_kind}", _short_number)


class _Anchor(NamedTuple):
    """A value that aliases repeat.

    Attributes:
        value: Value that is repeated.
        nodes: How many it consists of.
        depth: How deep it nests.
    """

    value: Node
    nodes: int
    depth: int


class _Open(NamedTuple):
    """A list or mapping that has begun.

    Attributes:
        value: Content so far.
        anchor: Name for aliases.
        first: How many nodes there were before it.
    """

    value: dict[str, Node] | list[Node]
    anchor: str | None
    first: int


class _Values:
    """The values of a text, built of its events, of which the parser is quick.

    To have it make nodes and then values of them takes three times as long. What is rare is left to
    that: tags, merge keys, keys that are no text or occur twice, values that can't be made.

    Args:
        loader: Loader that knows the scalars.

    Attributes:
        complete: whether `documents` are the values of the text.
        documents: that the text has.
    """

    def __init__(self, loader: _Loader) -> None:
        self.complete = True
        self.documents: list[Node] = []
        self._loader = loader
        self._scalars: dict[str, Node] = {}
        self._open: list[_Open] = []
        self._keys: list[str | None] = []
        self._anchors: dict[str, _Anchor] = {}
        #: Of each open list or mapping how deep it nests.
        self._depths: list[int] = [0]
        self._nodes = self._repeated = 0

    def scalar(self, event: yaml.ScalarEvent) -> None:
        """Add a scalar."""
        self._count(event, 1)
        if event.tag is not None:
            self.complete = False
        text = event.value
        value = self._scalar(text) if event.implicit[0] else text
        if event.anchor is not None:
            self._anchors[event.anchor] = _Anchor(value, 1, 0)
        self._add(value)

    def take(self, event: yaml.Event) -> None:
        """Add what begins or ends, or what an alias repeats.

        Raises:
            YAMLError: It nests too deep, or aliases repeat too much.
        """
        if isinstance(event, yaml.AliasEvent):
            self._repeat(event)
        elif isinstance(event, yaml.CollectionStartEvent):
            if event.tag is not None:
                self.complete = False
            value: dict[str, Node] | list[Node]
            value = {} if isinstance(event, yaml.MappingStartEvent) else []
            self._open.append(_Open(value, event.anchor, self._nodes))
            self._keys.append(None)
            self._depths.append(0)
            self._count(event, 1)
            self._deepen(event, 0)
        elif isinstance(event, yaml.CollectionEndEvent):
            self._keys.pop()
            value, anchor, first = self._open.pop()
            depth = self._depths.pop() + 1
            self._deepen(event, depth)
            if anchor is not None:
                self._anchors[anchor] = _Anchor(value, self._nodes - first, depth)
            self._add(value)
        elif isinstance(event, yaml.DocumentStartEvent):
            self._anchors.clear()

    def _repeat(self, event: yaml.AliasEvent) -> None:
        anchor = self._anchors.get(event.anchor or "")
        if anchor is None:
            raise _refusal(event, f"*{event.anchor} stands for nothing that is complete before it")
        self._repeated += anchor.nodes
        if self._repeated > _MAX_REPEATED:
            raise _refusal(event, f"aliases repeat more than {_MAX_REPEATED} values")
        self._count(event, anchor.nodes)
        self._deepen(event, anchor.depth)
        self._add(anchor.value)

    def _count(self, event: yaml.Event, nodes: int) -> None:
        self._nodes += nodes
        if self._nodes > _MAX_NODES:
            raise _refusal(event, f"more than {_MAX_NODES} values")

    def _deepen(self, event: yaml.Event, depth: int) -> None:
        """Note how deep what is added nests, and refuse more than anybody needs."""
        self._depths[-1] = max(self._depths[-1], depth)
        if len(self._open) + depth > _MAX_DEPTH:
            raise _refusal(event, "nested too deep")

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
            self.documents.append(value)
            return
        inside = self._open[-1].value
        if isinstance(inside, list):
            inside.append(value)
        elif (key := self._keys[-1]) is not None:
            inside[key], self._keys[-1] = value, None
        elif isinstance(value, str) and value not in inside:
            self._keys[-1] = value
        else:
            # What follows goes nowhere that matters.
            self.complete, self._keys[-1] = False, ""


def read_yaml(text: str | bytes) -> Node:
    """The values of a YAML document.

    Args:
        text: The document.

    Raises:
        UnreadableYaml: It is too long, nested too deep, holds several documents, its aliases repeat
            too much, or it is no YAML.
    """
    if len(text) > MAX_BYTES:
        raise UnreadableYaml(f"{len(text)} bytes, at most {MAX_BYTES} are taken")
    try:
        return read_quickly(text, _MAX_DEPTH)
    except UnsureYaml:
        return _parsed(text)


def _parsed(text: str | bytes) -> Node:
    try:
        documents = _read_events(text)
        if documents is None:
            documents = list(yaml.load_all(text, Loader=_Loader))  # nosec B506
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        line = "" if mark is None else f"line {mark.line + 1}: "
        raise UnreadableYaml(f"no readable YAML: {line}{error.problem}") from None
    except (yaml.YAMLError, ValueError, TypeError, RecursionError) as error:
        raise UnreadableYaml(f"no readable YAML: {error}") from None
    # ROS's tools end each message by the mark that begins the next one.
    full = [document for document in documents if document is not None]
    if len(full) > 1:
        raise UnreadableYaml(f"it holds {len(full)} documents (parted by ---): keep the one meant")
    return full[0] if full else None


def _read_events(text: str | bytes) -> list[Node] | None:
    """The documents, read from the flat stream of events; None where that is not all of it.

    Nothing recurses, or grows beyond the text and what aliases may repeat.

    Raises:
        YAMLError: Aliases repeat too much, it is nested too deep or no YAML.
    """
    loader = _Loader(text)
    values = _Values(loader)
    try:
        while (event := loader.get_event()) is not None:
            if isinstance(event, yaml.ScalarEvent):
                values.scalar(event)
            else:
                values.take(event)
        return values.documents if values.complete else None
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
