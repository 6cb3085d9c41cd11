"""Untrusted YAML, read strictly: the one door to the YAML parser.

Aliases, equal keys, depth and length are refused before anything is built of the text.
"""

from collections import Counter
from collections.abc import Hashable, Mapping
from typing import Any, TypeAlias

import numpy as np
import yaml

Node: TypeAlias = Any

#: A planning scene of ten thousand boxes is 3 MB of text.
MAX_BYTES = 16 * 2**20
#: A planning scene nests nine deep.
_MAX_DEPTH = 32
_MAX_NODES = 2_000_000


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
        # First as a flat stream of events: nothing has grown or recursed when they are refused.
        depth = 0
        for count, event in enumerate(yaml.parse(text, Loader=_Loader)):
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            aliased = isinstance(event, yaml.AliasEvent)
            if aliased or depth > _MAX_DEPTH or count > _MAX_NODES:
                problem = (
                    "aliases (*name) are not read" if aliased else "nested too deep or too long"
                )
                mark = event.start_mark
                raise yaml.YAMLError(f"line {mark.line + 1 if mark else 0}: {problem}")
        return yaml.load(text, Loader=_Loader)  # nosec B506
    except (yaml.YAMLError, ValueError, TypeError, RecursionError) as error:
        raise UnreadableYaml(f"no readable YAML: {error}") from None


def finite_number(node: Node) -> float | None:
    """The number of a scalar; None where it is no finite one."""
    # YAML 1.1 takes 1e-05 for text: it wants a dot.
    if isinstance(node, int | float | str) and not isinstance(node, bool):
        try:
            number = float(node)
        except (ValueError, OverflowError):
            return None
        return number if np.isfinite(number) else None
    return None


def fields_of(node: Node) -> Mapping[str, Node] | None:
    """The named fields of a node; None where it has none."""
    return node if isinstance(node, dict) else None
