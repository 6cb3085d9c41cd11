"""The plain part of YAML, read line by line: several times as fast as a parser of all of it.

Programs write planning scenes: nested blocks of ``key: value`` and ``- value``, short lists
``[1.0, 2.0]`` and objects ``{x: 1.0}``, numbers and words. All else, and whatever is wrong, is left
to `kinematics.yaml_reader` and its parser, which alone says what is wrong with it.
"""

import re
from typing import Any, NamedTuple, TypeAlias

Node: TypeAlias = Any

#: Longer texts have more values than the reader takes, perhaps [character].
MAX_LENGTH = 1_000_000
#: Nested deeper is left to the parser; it takes a little more.
_MAX_DEPTH = 24
_WORD = r"[A-Za-z_/][A-Za-z0-9_./+-]*"
_SCALAR = rf"(?:{_WORD}|[-+]?[0-9][0-9.eE+-]*|\"[ !#-\[\]-~]*\"|'[ -&(-~]*')"
_KEY = r"[A-Za-z_][A-Za-z0-9_]*"
#: Its items are looked at one by one.
_LIST = r"\[[A-Za-z0-9_./+, -]*\]"
_OBJECT = rf"\{{ *(?:{_KEY}: +{_SCALAR} *(?:, *{_KEY}: +{_SCALAR} *)*)?\}}"
#: Spaces in front, the dash of an item with its spaces, a key, a value.
_LINE = re.compile(
    rf"( *)(- +)?(?:({_KEY}):(?: +({_SCALAR}|{_LIST}|{_OBJECT}))?|({_SCALAR}|{_LIST}|{_OBJECT})) *"
)
_PAIRS = re.compile(rf"({_KEY}): +({_SCALAR})")
#: Numbers as YAML 1.1 has them: a float has a dot, and its exponent a sign.
_NUMBER = re.compile(r"[-+]?(?:(0|[1-9][0-9]*)|[0-9]+\.[0-9]*(?:[eE][-+][0-9]+)?)")
_NAME = re.compile(_WORD)
#: More digits make no number of Python by default.
_MAX_DIGITS = 300
_WORDS = {"true": True, "True": True, "false": False, "False": False, "null": None}
#: Words with other meanings, which are left to the parser.
_SPECIAL = frozenset(("true", "false", "yes", "no", "on", "off", "null"))


class NotPlain(Exception):
    """A text that is left to the parser of all of YAML."""


class _Block(NamedTuple):
    """A list or an object that is open.

    Attributes:
        column: where its lines begin.
        node: its value.
        is_list: whether it is a list.
    """

    column: int
    node: Any
    is_list: bool


def read_plain(text: str | bytes) -> Node:
    """The values of a plain document.

    Args:
        text: The document.

    Raises:
        NotPlain: It is more than that, or no YAML at all.
    """
    if len(text) > MAX_LENGTH or not text.isascii():
        raise NotPlain
    lines = (text if isinstance(text, str) else text.decode("ascii")).split("\n")
    reader = _Reader()
    for line in lines:
        found = _LINE.fullmatch(line)
        if found is not None:
            reader.take(*found.groups())
        elif line.strip(" "):
            raise NotPlain
    return reader.root


class _Reader:
    """Builds values of lines.

    Attributes:
        root: the value of the document.
    """

    def __init__(self) -> None:
        self.root: Node = None
        self._open: list[_Block] = []
        #: The key of the innermost object whose value is still to come.
        self._key: str | None = None

    def take(
        self, spaces: str, dash: str | None, key: str | None, named: str | None, value: str | None
    ) -> None:
        """Take the parts of a line.

        Raises:
            NotPlain: It does not fit those before it.
        """
        column, blocks = len(spaces), self._open
        is_next = (
            blocks and blocks[-1].column == column and blocks[-1].is_list is (dash is not None)
        )
        if is_next:
            self._key = None
        else:
            self._enter(column, is_item=dash is not None)
        block = blocks[-1]
        if dash is not None:
            if value is not None:
                block.node.append(_value(value))
                return
            item: dict[str, Node] = {}
            block.node.append(item)
            block = _Block(column + len(dash), item, is_list=False)
            self._push(block)
        if key is None or key in block.node or key.lower() in _SPECIAL:
            raise NotPlain
        block.node[key] = None
        if named is None:
            self._key = key
        else:
            block.node[key] = _value(named)

    def _enter(self, column: int, *, is_item: bool) -> None:
        """Have the block innermost that a line belongs to.

        Raises:
            NotPlain: There is none.
        """
        blocks, key = self._open, self._key
        self._key = None
        if not blocks:
            self.root = [] if is_item else {}
            self._push(_Block(column, self.root, is_item))
            return
        inner = blocks[-1]
        if column > inner.column or (column == inner.column and is_item and not inner.is_list):
            if key is None:  # more of a value that has ended
                raise NotPlain
            node: Node = [] if is_item else {}
            inner.node[key] = node
            self._push(_Block(column, node, is_item))
            return
        while blocks and blocks[-1].column > column:
            blocks.pop()
        # The items of a list may stand where the key of the list does.
        if blocks and blocks[-1].is_list and not is_item:
            blocks.pop()
        if not blocks or blocks[-1].column != column or blocks[-1].is_list != is_item:
            raise NotPlain

    def _push(self, block: _Block) -> None:
        if len(self._open) >= _MAX_DEPTH:
            raise NotPlain
        self._open.append(block)


def _value(text: str) -> Node:
    first = text[0]
    if first == "[":
        inside = text[1:-1]
        return [_item(item) for item in inside.split(",")] if inside.strip(" ") else []
    if first == "{":
        pairs = _PAIRS.findall(text)
        fields = {key: _scalar(item) for key, item in pairs}
        if len(fields) != len(pairs) or any(key.lower() in _SPECIAL for key in fields):
            raise NotPlain
        return fields
    return _scalar(text)


def _item(text: str) -> Node:
    text = text.strip(" ")
    number = _NUMBER.fullmatch(text)
    if number is not None:
        return _number(text, number)
    if _NAME.fullmatch(text):
        return _scalar(text)
    raise NotPlain


def _number(text: str, found: re.Match[str]) -> float | int:
    if len(text) > _MAX_DIGITS:
        raise NotPlain
    return float(text) if found[1] is None else int(text)


def _scalar(text: str) -> Node:
    first = text[0]
    if first in "\"'":
        return text[1:-1]
    if first in "0123456789+-":
        number = _NUMBER.fullmatch(text)
        if number is None:
            raise NotPlain
        return _number(text, number)
    if text in _WORDS:
        return _WORDS[text]
    if text.lower() in _SPECIAL:
        raise NotPlain
    return text
