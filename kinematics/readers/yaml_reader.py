"""Untrusted YAML, read strictly: the one door to the YAML parsers.

Equal keys, depth, length, and how much aliases repeat are refused before anything is built of the
text.
"""

import math
from collections import Counter
from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import yaml

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


class UnreadableYaml(ValueError):
    """A text that is no YAML, or beyond the limits of this reader."""


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


@dataclass(slots=True)
class _Level:
    """A list or mapping that has begun, or the document itself.

    Attributes:
        anchor: Name by which aliases repeat it.
        first: Number of nodes before it.
        depth: Levels of lists and mappings within it so far.
    """

    anchor: str | None
    first: int
    depth: int = 0


def read_yaml(text: str | bytes) -> Node:
    """The values of a YAML document.

    Args:
        text: The document.

    Raises:
        UnreadableYaml: The text is too long, nested too deep or no YAML, holds several documents,
            or its aliases repeat too much.
    """
    if len(text) > MAX_BYTES:
        raise UnreadableYaml(f"{len(text)} bytes, at most {MAX_BYTES} are taken")
    try:
        _check_events(text)
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


def _check_events(text: str | bytes) -> None:
    """Check depth, length and aliases in the flat stream of events, in which nothing recurses.

    Raises:
        YAMLError: The text nests too deep, aliases repeat too much, or it is no YAML.
    """
    #: Number of nodes and depth of each anchor's value.
    anchors: dict[str | None, tuple[int, int]] = {}
    levels = [_Level(None, 0)]
    nodes = repeated = 0
    for event in yaml.parse(text, Loader=_Loader):
        depth = 0
        if isinstance(event, yaml.ScalarEvent):
            nodes += 1
            anchors[event.anchor] = 1, 0
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor not in anchors:
                name = f"*{event.anchor}"
                raise _refusal(event, f"{name} stands for nothing that is complete before it")
            count, depth = anchors[event.anchor]
            repeated += count
            nodes += count
        elif isinstance(event, yaml.CollectionStartEvent):
            levels.append(_Level(event.anchor, nodes))
            nodes += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            closed = levels.pop()
            depth = closed.depth + 1
            anchors[closed.anchor] = nodes - closed.first, depth
        elif isinstance(event, yaml.DocumentStartEvent):
            anchors.clear()
        levels[-1].depth = max(levels[-1].depth, depth)
        if repeated > _MAX_REPEATED:
            raise _refusal(event, f"aliases repeat more than {_MAX_REPEATED} values")
        if nodes > _MAX_NODES:
            raise _refusal(event, f"more than {_MAX_NODES} values")
        if len(levels) - 1 + depth > _MAX_DEPTH:
            raise _refusal(event, "nested too deep")


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
