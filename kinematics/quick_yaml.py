"""YAML by a fast parser, where its values are sure to be those of the strict one.

``ryaml`` reads YAML 1.2, takes a fifth of PyYAML's time and never more than the text is worth. Both
agree on what programs write: blocks and lists of numbers and words. Texts with anything that they
may read in two ways, and whatever is wrong, are left to `kinematics.yaml_reader`, which alone says
what is wrong.
"""

import re
from collections.abc import Iterable
from string import ascii_letters, digits
from typing import Any, TypeAlias

import ryaml

Node: TypeAlias = Any

#: Longer texts have more values than the reader takes, perhaps [character].
MAX_LENGTH = 1_000_000
#: There are no anchors, aliases, tags, merge and complex keys, directives, comments, block scalars
#: and escapes of these.
_CHARACTERS = frozenset("\n \"'()+,-./:;[]_{}" + ascii_letters + digits)
_BETWEEN = str.maketrans(",[]{}", "     ")
#: A line that begins farther to the right than all that is read, lists in lists in one line, and
#: brackets within brackets.
_INDENTED, _DASHES, _MAX_BRACKETS = "\n" + 64 * " ", "- - - - ", 8
_BRACKET = re.compile(r"[\[\]{}]")
#: Numbers that YAML 1.1 and 1.2 both take for them, and for the same ones.
_NUMBER = r"[-+]?(?:0|[1-9][0-9]{0,16}|[0-9]+\.[0-9]*(?:[eE][-+][0-9]+)?)"
#: A dash of an item, a number, or a word with its quotes, after which it may be a key.
_TOKEN = re.compile(rf"-|{_NUMBER}|[\"']*([A-Za-z_/][A-Za-z0-9_./+-]*)?[\"']*(:?)")
#: Words of which YAML 1.1 makes more than text; of the first ones both make the same.
_SAME = frozenset(("true", "false", "null"))
_SPECIAL = frozenset(("yes", "no", "on", "off", *_SAME))


class UnsureYaml(ValueError):
    """A text that is left to the strict parser."""


def read_quickly(text: str | bytes, max_depth: int) -> Node:
    """The values of a document that can be read in one way only.

    Args:
        text: The document.
        max_depth: Of its lists and objects.

    Raises:
        UnsureYaml: It may be read in another way, nests deeper, or is no YAML.
    """
    if len(text) > MAX_LENGTH:
        raise UnsureYaml
    try:
        plain = text if isinstance(text, str) else text.decode("ascii")
    except UnicodeDecodeError:
        raise UnsureYaml from None
    is_sure = _CHARACTERS.issuperset(plain) and _is_shallow(plain)
    if not is_sure or not all(map(_is_sure, _tokens(plain))):
        raise UnsureYaml
    try:
        root = ryaml.loads(plain)
    except (ryaml.InvalidYamlError, ValueError, TypeError):
        raise UnsureYaml from None
    _check_depth((root,), max_depth)
    return root


def _is_shallow(text: str) -> bool:
    """Whether nothing nests so deep that the fast parser would be slow: it takes minutes then."""
    if _INDENTED in text or _DASHES in text:
        return False
    brackets = "".join(_BRACKET.findall(text))
    for _ in range(_MAX_BRACKETS):
        brackets = brackets.replace("[]", "").replace("{}", "")
    return not brackets


def _tokens(text: str) -> set[str]:
    return set(text.translate(_BETWEEN).split())


def _is_sure(token: str) -> bool:
    """Whether what stands between spaces, commas and brackets is read in one way only."""
    found = _TOKEN.fullmatch(token)
    if found is None:
        return False
    word, is_key = found[1], bool(found[2])
    return word is None or word.lower() not in _SPECIAL or (word in _SAME and not is_key)


def _check_depth(nodes: Iterable[Node], depth: int) -> None:
    """Refuse what nests too deep."""
    if depth < 0:
        raise UnsureYaml
    for node in nodes:
        if type(node) is list:
            _check_depth(node, depth - 1)
        elif type(node) is dict:
            _check_depth(node.values(), depth - 1)
