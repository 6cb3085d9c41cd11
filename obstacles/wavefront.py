"""Wavefront OBJ text in the form that every reader takes.

The format lets a face count back from where it stands: -1 is the vertex before it. Readers that
take -1 for the last vertex of the file make another body of it and say nothing.
Source: "Object Files (.obj)", Advanced Visualizer manual, appendix B1.
"""

import re

#: A face with an index that counts back or is 0, which is none.
_NOT_PLAIN = re.compile(rb"^[ \t]*f[^\n]*[\s/](-|0+[\s/]|0+$)", re.MULTILINE)
#: A line that ends in this goes on in the next one.
_CONTINUED = re.compile(rb"\\[ \t]*\r?\n")
#: What indices of a corner count, in their order.
_COUNTED = (b"v", b"vt", b"vn")


def plain_obj(text: bytes) -> bytes:
    """The text with blanks for tabs, and with indices that count from the first vertex.

    Raises:
        ValueError: An index is 0 or no number, or counts back beyond the first vertex.
    """
    text = text.replace(b"\t", b" ")
    if not _NOT_PLAIN.search(text):
        return text
    counts = dict.fromkeys(_COUNTED, 0)
    lines = _CONTINUED.sub(b" ", text).splitlines()
    for number, line in enumerate(lines):
        words = line.split()
        if not words:
            continue
        if words[0] in counts:
            counts[words[0]] += 1
        elif words[0] == b"f":
            seen = [counts[name] for name in _COUNTED]
            lines[number] = b" ".join([b"f", *(_corner(word, seen) for word in words[1:])])
    return b"\n".join(lines) + b"\n"


def _corner(word: bytes, seen: list[int]) -> bytes:
    """A corner v, v/vt, v//vn or v/vt/vn of a face before which so many were ``seen``."""
    parts = word.split(b"/")
    return b"/".join(
        _index(part, count) for part, count in zip(parts, seen[: len(parts)], strict=True)
    )


def _index(part: bytes, seen: int) -> bytes:
    if not part:
        return part
    index = int(part)
    if index < 0:
        index += seen + 1
    if index < 1:
        raise ValueError(f"the index {part!r} is none")
    return b"%d" % index
