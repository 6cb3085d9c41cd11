"""Untrusted XML, read strictly: the one door to the XML parser.

What an attack needs (entities, document types, references to other files) is refused before it
is expanded, and size, depth and number of elements are bounded while the text is read.
"""

import math
import re
from collections.abc import Iterator
from typing import Any
from xml.etree.ElementTree import Element, ParseError, TreeBuilder, tostring

from defusedxml.common import DefusedXmlException
from defusedxml.ElementTree import DefusedXMLParser

from kinematics.errors import InvalidRobotDescription

__all__ = [
    "Element",
    "attribute",
    "children",
    "number",
    "numbers",
    "read_document",
    "read_robot",
    "single",
    "tostring",
]

#: The largest real descriptions (humanoids with hands) are below 1 MiB, 20 deep, 20,000 elements.
MAX_BYTES = 16 * 1024 * 1024
MAX_DEPTH = 64
MAX_ELEMENTS = 200_000
MAX_NAME = 256
#: How much of a text the parser is given at once [characters].
_FED_AT_ONCE = 65_536

#: Elements of xacro that only define what others may use.
_XACRO_DEFINITIONS = ("property", "arg")
#: What begins a use of them; a finished URDF may have kept the second in file names.
_USES = ("${", "$(")

#: XML's decimal numbers; Python's float() would also take "nan", "1_0" and other digits.
_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)


class _BoundedBuilder(TreeBuilder):
    """Builds the tree and stops as soon as it grows beyond what a robot needs."""

    def __init__(self) -> None:
        super().__init__()
        self._depth = 0
        self._elements = 0

    def start(self, tag: Any, attributes: Any, /) -> Element:
        self._depth += 1
        self._elements += 1
        if self._depth > MAX_DEPTH:
            raise InvalidRobotDescription(f"elements are nested more than {MAX_DEPTH} deep")
        if self._elements > MAX_ELEMENTS:
            raise InvalidRobotDescription(f"there are more than {MAX_ELEMENTS} elements")
        return super().start(tag, attributes)

    def end(self, tag: Any, /) -> Element:
        self._depth -= 1
        return super().end(tag)


def read_robot(text: str | bytes, what: str, foreign: list[str] | None = None) -> Element:
    """Parse ``text`` and answer its root, which must be <robot>.

    Elements of the root's own namespace lose it; those of other namespaces are taken out. So are
    definitions of xacro that nothing uses: many a finished URDF has kept them.

    Args:
        text: The XML text; white space before its declaration is no fault.
        what: Kind of document ("URDF", "SRDF"), for the messages.
        foreign: List that gets the tags of elements that are taken out, if any.

    Raises:
        InvalidRobotDescription: Too large, not well-formed, with a DTD, or with another root.
    """
    if len(text) > MAX_BYTES:
        raise InvalidRobotDescription(
            f"the {what} has more than {MAX_BYTES // 2**20} MiB",
            hint="Meshes belong beside the description, not inside it.",
        )
    root = read_document(text.lstrip(), what)
    namespace = root.tag[: root.tag.rindex("}") + 1] if root.tag.startswith("{") else ""
    out = [] if foreign is None else foreign
    _check_uses(root, what, _USES if _strip(root, namespace, what, out) else _USES[:1])
    if root.tag != "robot":
        raise InvalidRobotDescription(
            f"the root element of the {what} is <{root.tag}>, it must be <robot>",
            hint="SDF and MJCF are other formats: convert them to URDF first. The command line, "
            "the client and the studio do that of MJCF, on your machine.",
        )
    return root


def read_document(text: str | bytes, what: str) -> Element:
    """Parse ``text`` of any kind and answer its root as it is.

    Raises:
        InvalidRobotDescription: Not well-formed, with a DTD, too deep or with too many elements.
    """
    parser = DefusedXMLParser(
        target=_BoundedBuilder(), forbid_dtd=True, forbid_entities=True, forbid_external=True
    )
    try:
        # In parts: the parser reads each to its end, also when the builder has refused already.
        for start in range(0, len(text), _FED_AT_ONCE):
            parser.feed(text[start : start + _FED_AT_ONCE])
        root = parser.close()
    except DefusedXmlException as error:
        raise InvalidRobotDescription(
            f"the {what} has a document type or an entity ({type(error).__name__})",
            hint="Take the <!DOCTYPE> out; entities are never expanded here.",
        ) from None
    except (ParseError, ValueError, LookupError) as error:
        if (prefix := re.search(r"<(xacro:\w+)", _readable(text))) is not None:
            raise _unexpanded(what, f"<{prefix[1]}>") from None
        raise InvalidRobotDescription(
            f"the {what} is no well-formed XML: {error}",
            hint="It may have been cut off, or be an unexpanded xacro file.",
        ) from None
    if not isinstance(root, Element):
        raise InvalidRobotDescription(f"the {what} has no root element")
    return root


def _strip(element: Element, namespace: str, what: str, out: list[str]) -> bool:
    """Take out what is foreign below an element; whether definitions of xacro were among it.

    Raises:
        InvalidRobotDescription: An element of xacro would have made others.
    """
    element.tag = element.tag.removeprefix(namespace)
    kept, defines = [], False
    for child in element:
        foreign, _, tag = child.tag.rpartition("}")
        if "xacro" in foreign.lower():
            if tag not in _XACRO_DEFINITIONS:
                raise _unexpanded(what, f"<xacro:{tag}>")
            defines = True
            continue
        defines |= _strip(child, namespace, what, out)
        if not child.tag.startswith("{"):
            kept.append(child)
        else:
            out.append(tag)
    element[:] = kept
    return defines


def _check_uses(root: Element, what: str, uses: tuple[str, ...]) -> None:
    """Refuse attributes that only xacro works out."""
    for element in root.iter():
        for name, value in element.attrib.items():
            if any(use in value for use in uses):
                raise _unexpanded(what, f"{name}={value[:80]!r} of <{element.tag}>")


def _readable(text: str | bytes) -> str:
    """The text, whatever its encoding, to search for names."""
    return text if isinstance(text, str) else text.decode("utf-8", "replace")


def _unexpanded(what: str, found: str) -> InvalidRobotDescription:
    return InvalidRobotDescription(
        f"the {what} is an unexpanded xacro file: it has {found}",
        hint="Expand it first (`xacro robot.urdf.xacro > robot.urdf`), send the result: a service "
        "never expands one. The command line, the client and the studio do, on your machine.",
    )


def children(element: Element, tag: str) -> Iterator[Element]:
    """The direct children called ``tag``."""
    return (child for child in element if child.tag == tag)


def single(element: Element, tag: str, where: str) -> Element | None:
    """The one direct child called ``tag``, None if there is none.

    Raises:
        InvalidRobotDescription: There are several, so it is open which one holds.
    """
    found = list(children(element, tag))
    if len(found) > 1:
        raise InvalidRobotDescription(f"{where} has {len(found)} <{tag}> elements, it may have one")
    return found[0] if found else None


def attribute(element: Element, name: str, where: str) -> str:
    """A text attribute that must be there and not be empty.

    Raises:
        InvalidRobotDescription: It is missing, empty, very long or has control characters.
    """
    value = element.get(name, "").strip()
    if not value:
        raise InvalidRobotDescription(f"<{element.tag}> of {where} has no {name!r}")
    if len(value) > MAX_NAME or not value.isprintable():
        raise InvalidRobotDescription(
            f"{name!r} of <{element.tag}> of {where} must be at most {MAX_NAME} printable "
            f"characters, got {value[:40]!r}"
        )
    return value


def number(
    element: Element,
    name: str,
    where: str,
    *,
    default: float | None = None,
    bound: float = math.inf,
) -> float:
    """A numeric attribute; ``default`` where it is missing and one is given.

    Raises:
        InvalidRobotDescription: Missing, not one finite number, or larger than ``bound``.
    """
    if element.get(name) is None and default is not None:
        return default
    return numbers(element, name, 1, where, bound=bound)[0]


def numbers(
    element: Element, name: str, count: int, where: str, *, bound: float = math.inf
) -> tuple[float, ...]:
    """``count`` numbers of one attribute, parted by white space.

    Raises:
        InvalidRobotDescription: Missing, another count, not finite, or larger than ``bound``.
    """
    text = element.get(name)
    place = f"{name!r} of <{element.tag}> of {where}"
    if text is None:
        raise InvalidRobotDescription(f"{place} is missing")
    words = text.split()
    if len(words) != count:
        raise InvalidRobotDescription(
            f"{place} must be {count} number(s), got {len(words)}: {text[:80]!r}"
        )
    values = tuple(float(word) if _NUMBER.fullmatch(word) else math.nan for word in words)
    if not all(math.isfinite(value) for value in values):
        raise InvalidRobotDescription(f"{place} must be finite number(s), got {text[:80]!r}")
    if any(abs(value) > bound for value in values):
        raise InvalidRobotDescription(
            f"{place} is {text[:80]!r}: beyond {bound:g}, which no robot has; are the units SI?"
        )
    return values
