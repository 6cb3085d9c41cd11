"""YAML by a fast parser, where its values are sure to be those of the strict one.

``ryaml`` reads YAML 1.2, takes a fifth of PyYAML's time and never more than the text is worth. Both
agree on what programs write: blocks and lists of numbers and words. Texts with anything that they
may read in two ways, and whatever is wrong, are left to `kinematics.readers.yaml_reader`, which
alone says what is wrong.
"""

import re
from string import ascii_letters, digits
from typing import Any, TypeAlias

import ryaml

Node: TypeAlias = Any

#: Longer texts have more values than the reader takes, perhaps [character].
MAX_LENGTH = 1_000_000
#: There are no anchors, aliases, tags, merge and complex keys, directives, comments, block scalars
#: and escapes of these.
_CHARACTERS = b"\n \"'()+,-./:;[]_{}" + (ascii_letters + digits).encode()
_BETWEEN = bytes.maketrans(b",[]{}\n", b"      ")
#: A line that begins farther to the right than all that is read, lists in lists in one line, and
#: brackets within brackets.
_INDENTED, _DASHES, _MAX_BRACKETS = b"\n" + 64 * b" ", b"- - - - ", 8
_NO_BRACKETS = bytes(set(range(256)) - set(b"[]{}"))
#: Numbers that YAML 1.1 and 1.2 both take for them, and for the same ones.
_NUMBER = rb"[-+]?(?:0|[1-9][0-9]{0,16}|[0-9]+\.[0-9]*(?:[eE][-+][0-9]+)?)"
#: Words of which YAML 1.1 makes more than text; of the first ones both make the same.
_SAME, _SPECIAL = rb"(?:true|false|null)", rb"(?i:true|false|null|yes|no|on|off)"
_WORD = rb"[A-Za-z_/][A-Za-z0-9_./+-]*+"
#: Tokens with a space behind each: dashes of items, numbers, and words with their quotes, after
#: which they may be keys. Nothing is tried twice: it takes no longer than the text is.
_TOKENS = re.compile(
    rb"(?:(?:-|" + _NUMBER + rb"|[\"']*+" + _SAME + rb"[\"']*+"
    rb"|(?![\"']*+" + _SPECIAL + rb"[\"']*+:? )[\"']*+(?:" + _WORD + rb")?[\"']*+:?) )*+"
)

_NESTED = (list, dict)


class UnsureYaml(ValueError):
    """A text that is left to the strict parser."""


def read_quickly(text: str | bytes, max_depth: int) -> Node:
    """The values of a document that can be read in one way only.

    Args:
        text: The document.
        max_depth: Largest depth of lists and objects.

    Raises:
        UnsureYaml: It may be read in another way, nests deeper, or is no YAML.
    """
    if len(text) > MAX_LENGTH:
        raise UnsureYaml
    try:
        plain = text.encode("ascii") if isinstance(text, str) else text
    except UnicodeEncodeError:
        raise UnsureYaml from None
    is_sure = not plain.translate(None, _CHARACTERS) and _is_shallow(plain)
    if not is_sure or not _TOKENS.fullmatch(_tokens(plain)):
        raise UnsureYaml
    try:
        root = ryaml.loads(plain.decode("ascii") if isinstance(text, bytes) else text)
    except (ryaml.InvalidYamlError, ValueError, TypeError):
        raise UnsureYaml from None
    _check_depth(root, max_depth)
    return root


def _is_shallow(text: bytes) -> bool:
    """Whether nothing nests so deep that the fast parser would be slow: it takes minutes then."""
    if _INDENTED in text or _DASHES in text:
        return False
    brackets = text.translate(None, _NO_BRACKETS)
    for _ in range(_MAX_BRACKETS):
        brackets = brackets.replace(b"[]", b"").replace(b"{}", b"")
    return not brackets


def _tokens(text: bytes) -> bytes:
    """The tokens between spaces, commas and brackets, each once with a space behind it."""
    return b" ".join([*set(text.translate(_BETWEEN).split()), b""])


def _check_depth(root: Node, depth: int) -> None:
    """Refuse what nests too deep, level by level: there are a hundred nodes to ten objects."""
    level = [root] if type(root) in _NESTED else []
    for _ in range(depth):
        if not level:
            return
        level = [
            inner
            for node in level
            for inner in (node if type(node) is list else node.values())
            if type(inner) in _NESTED
        ]
    if level:
        raise UnsureYaml
