"""YAML is read as PyYAML's safe loader reads it, but for what is refused."""

import math
import random
import time
from typing import Any

import pytest
import yaml

from kinematics.readers.yaml_reader import UnreadableYaml, read_yaml

#: Scalars of all kinds of YAML 1.1, such as nobody would think of and such as in files of robots.
SCALARS = [
    "", "~", "null", "Null", "nil", "yes", "No", "on", "OFF", "true", "False", "y", "0", "-1", "+7",
    "010", "0o10", "0x1F", "0b101", "1_000", "190:20:30", "1.5", "-0.25", "1e5", "1.0e5", "1e-05",
    "1.e+3", ".5", ".inf", "-.INF", ".nan", "1:2.5", "1.2.3", "box", "panda_link0", "a b", "=",
    "2001-12-14", "2001-12-14t21:59:43.10-05:00", "1__", "0x", "-", "--", "x: y", "#", "a#b", "é",
]  # fmt: skip
#: Documents with something rare in them.
RARE = [
    "", "---\n", "--- 5\n", "a: 1\n...\n", "# nothing\n", "[]", "{}", "- \n- a:\n", "'a'",
    "|\n  text\n",
    "a: !!str 5", "a: !!float 1", "a: !!int '7'", "a: !!set {x, y}", "!!map {a: 1}", "a: ! 5",
    "a: !!binary aGVsbG8=", "a: !!timestamp 2001-12-14", "a: !!omap [b: 1]", "!!seq [1, 2]",
    "a: &anchor 5\nb: 6", "<<: {a: 1, b: 2}\nb: 3", "'<<': 3", "1: a\n2: b", "true: a",
    "? [1, 2]\n: 3",
    "1: a\n01: b", "null: 1", "yes: 1\ntrue: 2", "a: 2001-13-45", "- =\n", "{=: 1}", "a: 5 # five",
    "'1': a\n1: b", "a: 1\n'a': 2", "a: {b: 1, b: 2}", "a: 1\n---\nb: 2", "a: *x", "a: &x 1\nb: *x",
    "a: !unknown 5", "a: !!python/name:os.system x", "a: [1, 2", "\ta: 1", "a: b: c", "\x01",
    "%YAML 9.9",
    "[" * 40 + "]" * 40, "{a: " * 40 + "1" + "}" * 40,
]  # fmt: skip


class _Strict(yaml.SafeLoader):
    """The pure Python loader, which refuses keys of the same text."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> Any:
        keys = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        if len(keys) != len(set(keys)):
            raise yaml.YAMLError("twice")
        return super().construct_mapping(node, deep)


def same(first: Any, second: Any) -> bool:
    """Whether two values are equal, with their types and the order of their keys."""
    if type(first) is not type(second):
        return False
    if isinstance(first, dict):
        return same(list(first.items()), list(second.items()))
    if isinstance(first, list | tuple):
        return len(first) == len(second) and all(map(same, first, second))
    if isinstance(first, float):
        return first == second or (math.isnan(first) and math.isnan(second))
    return bool(first == second)


def value(drawn: random.Random, depth: int) -> Any:
    """A value at random."""
    kind = drawn.random()
    if depth > 5 or kind < 0.4:
        return drawn.choice([*SCALARS, drawn.uniform(-9, 9), drawn.randrange(99), True, None, 1e-9])
    count = drawn.randrange(5)
    if kind < 0.7:
        return [value(drawn, depth + 1) for _ in range(count)]
    return {drawn.choice([*SCALARS, 3, 2.5]): value(drawn, depth + 1) for _ in range(count)}


@pytest.mark.parametrize("seed", range(60))
def test_values_are_those_of_the_safe_loader(seed: int) -> None:
    drawn = random.Random(seed)
    written = value(drawn, 0)
    style, flow = drawn.choice([None, "'", '"', "|"]), drawn.choice([None, True, False])
    text = yaml.safe_dump(written, default_style=style, default_flow_style=flow, sort_keys=False)
    assert same(read_yaml(text), written)
    assert same(read_yaml(text.encode()), written)


@pytest.mark.parametrize("scalar", SCALARS)
@pytest.mark.parametrize("form", ["a: {}", "- {}", "{}: 1", "a: '{}'", "{{a: [{}, 1]}}"])
def test_scalars_are_those_of_the_safe_loader(form: str, scalar: str) -> None:
    check(form.format(scalar))


@pytest.mark.parametrize("text", RARE)
def test_what_is_rare_is_read_or_refused_as_by_the_safe_loader(text: str) -> None:
    check(text)


def check(text: str) -> None:
    """Read a text, and compare with the safe loader; depth is refused, and several documents."""
    try:
        documents = list(yaml.load_all(text, Loader=_Strict))
        full = [document for document in documents if document is not None]
        expected = full[0] if full else None
        refused = len(full) > 1 or "[" * 33 in text or text.count("{") > 32
    except (yaml.YAMLError, ValueError, TypeError):
        refused = True
    if refused:
        with pytest.raises(UnreadableYaml):
            read_yaml(text)
    else:
        assert same(read_yaml(text), expected)


def test_a_key_that_occurs_twice_is_named() -> None:
    with pytest.raises(UnreadableYaml, match="'b' occurs twice"):
        read_yaml("a: {b: 1, b: 2}")


@pytest.mark.parametrize("seed", range(60))
def test_aliases_are_those_of_the_safe_loader(seed: int) -> None:
    drawn = random.Random(seed)
    parts = [value(drawn, 3) for _ in range(3)]
    more = [drawn.choice(parts) for _ in range(8)]
    written = [*parts, *more, {"a": parts, "b": [*parts[:2], "x"]}]
    flow = drawn.choice([None, True, False])
    text = yaml.safe_dump(written, default_flow_style=flow, sort_keys=False)
    assert "*" in text or not any(isinstance(part, list | dict) and part for part in parts)
    assert same(read_yaml(text), written)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: &x [*x]", r"line 1: \*x stands for nothing"),
        ("a: 1\nb: *x", r"line 2: \*x stands for nothing"),
        ("a: &x 1\n---\nb: *x", "stands for nothing"),
        ("a: 1\n---\nb: 2\n---\n", "2 documents"),
        ("a: !!python/tuple [1, 2]", r"line 1: could not determine a constructor.*tuple"),
        ("a: &a " + "[" * 20 + "]" * 20 + "\nb: " + "[" * 14 + "*a" + "]" * 14, "too deep"),
    ],
)
def test_what_is_refused_is_told_with_its_line(text: str, words: str) -> None:
    with pytest.raises(UnreadableYaml, match=words) as raised:
        read_yaml(text)
    assert "\n" not in str(raised.value)


def test_what_aliases_repeat_is_counted_before_it_is_made() -> None:
    lines = [f"a0: &a0 [{', '.join('x' * 9)}]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 25)]
    for text in ("\n".join(lines), "\n".join(lines).replace("a24: &a24 [", "a24: !!seq [")):
        began = time.perf_counter()
        with pytest.raises(UnreadableYaml, match="aliases repeat more than"):
            read_yaml(text)
        assert time.perf_counter() - began < 0.5
