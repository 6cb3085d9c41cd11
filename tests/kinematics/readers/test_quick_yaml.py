"""What is read quickly is what PyYAML reads: the same values, or none."""

import math
import random
from typing import Any

import pytest
import yaml

from kinematics.readers.quick_yaml import MAX_LENGTH, UnsureYaml, read_quickly
from kinematics.readers.yaml_reader import UnreadableYaml, read_yaml

SCENE = """\
name: cell_1
robot_model_name: panda

world:
  collision_objects:
    - id: table
      header: {frame_id: panda_link0}
      primitives:
      - type: box
        dimensions: [1.0, 1.6, 0.04]
      primitive_poses:
        - position: {x: 0.7, y: -0.1, z: 1.5e-03}
          orientation: [0, 0, 0, 1]
    - id: "post one"
      operation: 0
      subframe: ""
      meshes:
      planes: []
      flags: [true, false]
      sizes:
        - 0.5
        - -2
        - half
"""
_TOKENS = [
    "a", "panda", "true", "TRUE", "yes", "No", "on", "null", "~", "y", "1", "-1", "+5", "0", "-0",
    "00", "010", "0x1", "1_0", "0.5", "-0.0", "1.", ".5", "+.5", "1.5e-05", "1e-05", "1.0e5",
    "1.e+3", "1.2.3", "e5", "1:30", "2020-01-01", "-", "--", "---", "...", "-a", "+", "/w", "a/b.c",
    "a b", "a:b", "a: b", "[]", "{}", "[ 1 ]", "[1, 2.0]", "[1,2]", "[a, ]", "[1e5]", "[-, 1]",
    "{a: 1}", "{a: 1, a: 2}", "{a: 1,b: x}", "{yes: 1}", "{a: [1]}", "''", "'x y'", "'it''s'",
    '"q: [a]"', '"a # b"', '"\\n"', "# c", "x #c", "@", "*a", "&a b", "!!int 3", "=", "<<",
]  # fmt: skip
_KEYS = ["", "", "a:", "b:", "c:", "id: ", "x :", "type:", "yes:", "1:", "a:b:", "<<:"]


def _is_same(a: Any, b: Any) -> bool:
    """Whether two values are equal, with their types, the order of keys and the signs of zeros."""
    if type(a) is not type(b):
        return False
    if isinstance(a, dict):
        return list(a) == list(b) and all(_is_same(a[key], b[key]) for key in a)
    if isinstance(a, list):
        return len(a) == len(b) and all(map(_is_same, a, b))
    if isinstance(a, float):
        return bool(a == b) and math.copysign(1.0, a) == math.copysign(1.0, b)
    return bool(a == b)


def _is_read_alike(text: str) -> bool:
    """Whether a text is read quickly; its values are those of PyYAML then."""
    try:
        found = read_quickly(text, 32)
    except UnsureYaml:
        return False
    # Equal keys, which PyYAML lets pass, are never read quickly.
    expected = yaml.load(text, Loader=yaml.CSafeLoader)
    assert _is_same(found, expected), (text, found, expected)
    return True


def _lines(rng: random.Random) -> str:
    column, lines = 0, []
    for _ in range(rng.randint(1, 9)):
        column = max(0, column + rng.choice([-4, -2, -2, 0, 0, 0, 1, 2, 2, 4]))
        dash = rng.choice(["", "", "- ", "-   ", "- - ", "-"]) if rng.random() < 0.5 else ""
        value = rng.choice(_TOKENS) if rng.random() < 0.6 else ""
        lines.append(" " * column + dash + rng.choice(_KEYS) + " " * rng.randint(0, 2) + value)
    return "\n".join(lines) + rng.choice(["", "\n", "\n\n"])


def test_lines_of_all_kinds_are_read_as_the_parser_reads_them() -> None:
    rng = random.Random(1)
    assert sum(_is_read_alike(_lines(rng)) for _ in range(20_000)) > 400


def test_changed_characters_of_a_scene_are_read_as_the_parser_reads_them() -> None:
    rng, quick = random.Random(2), 0
    for _ in range(5_000):
        text = list(SCENE)
        for _ in range(rng.randint(1, 3)):
            place, new = (
                rng.randrange(len(text)),
                rng.choice(" -:[]{},#'\"\n\tab10.e+~&*!|>%@\\?\r"),
            )
            text[place : place + rng.randint(0, 1)] = rng.choice([[new], []])
        quick += _is_read_alike("".join(text))
    assert quick > 200


@pytest.mark.parametrize("flow", [None, False])
def test_what_programs_write_is_read_quickly(flow: bool | None) -> None:
    rng = random.Random(3)
    for _ in range(300):
        box = {"type": "box", "dimensions": [rng.uniform(0.01, 1.0) for _ in range(3)]}
        pose = {"position": [rng.gauss(0, 1) for _ in range(3)], "orientation": [0, 0, 0, 1]}
        entry = {"id": "a_b", "primitives": [box], "primitive_poses": [pose], "planes": None}
        document = {"world": {"collision_objects": [entry, entry | {"id": "c/d"}]}}
        text = yaml.safe_dump(document, default_flow_style=flow, sort_keys=False, width=1000)
        if "&" not in text:
            assert read_quickly(text, 32) == document


def test_a_scene_is_read_quickly() -> None:
    assert _is_read_alike(SCENE)
    assert read_yaml(SCENE) == read_yaml(SCENE.encode()) == yaml.safe_load(SCENE)


@pytest.mark.parametrize(
    "text",
    [
        "a: 1\na: 2\n", "{a: 1, a: 2}", "a: *b", "a: &b c", "a: [" * 40, "a:\n\tb: 1", "a: b: c",
        "- " * 100_000, "{a: " * 100_000, "[" * 9 + "]" * 9,
        "a: b\n  c: d", "- a\nb: c", "a:\n  - b\n c: d", "\ufeffa: 1", "a: é", "a: 1\r\n",
        "a: 1\n---\nb: 2",
        "a: !!python/object:os.system x", "\n".join("  " * k + "a:" for k in range(60)),
        "a: " + "9" * 400, "a: 1e-05", "a: 010", "a: yes", "a: +.5", "1: a", "a: 2001-12-14",
    ],
)  # fmt: skip
def test_what_is_more_or_wrong_is_left_to_the_parser(text: str) -> None:
    with pytest.raises(UnsureYaml):
        read_quickly(text, 32)


@pytest.mark.parametrize("text", ["'" * 300_000 + "(", "'\"" * 150_000 + "x(", "9" * 400_000 + "("])
def test_what_is_tried_is_never_more_than_the_text(text: str) -> None:
    # With every way of taking quotes apart this would take days.
    with pytest.raises(UnsureYaml):
        read_quickly(text, 32)


def test_long_texts_are_left_to_the_parser() -> None:
    with pytest.raises(UnsureYaml):
        read_quickly("a: 1\n" + " " * MAX_LENGTH, 32)


def test_equal_keys_are_refused_as_before() -> None:
    with pytest.raises(UnreadableYaml, match="twice"):
        read_yaml("world:\n  a: 1\n  a: 2\n")
