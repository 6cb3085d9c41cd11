"""Wavefront OBJ text in the form that every reader takes.

The format lets a face count back from where it stands: -1 is the vertex before it. Readers that
take -1 for the last vertex of the file make another body of it and say nothing. Names, groups and
materials are left out: a reader that makes a mesh of each takes the square of their number in time.
Source: "Object Files (.obj)", Advanced Visualizer manual, appendix B1.
"""

import re

from kinematics.errors import InvalidScene

#: A line with a vertex or a face, without the blanks before it.
_SHAPES = re.compile(rb"^ *([vf] [^\n]*)", re.MULTILINE)
#: Of a corner of a face, what it has beside its vertex.
_LOOKS = re.compile(rb"/[^ \r\n]*")
#: An index that counts back or is 0, which is none.
_NOT_PLAIN = re.compile(rb"^f[^\n]* (-|0+[ \r]|0+$)", re.MULTILINE)
#: A line that ends in this goes on in the next one.
_CONTINUED = re.compile(rb"\\ *\r?\n")


def plain_obj(text: bytes, most: int) -> bytes:
    """The vertices and faces of a text, faces with indices that count from the first vertex.

    Args:
        text: The file's content.
        most: Triangles that faces may be cut into.

    Raises:
        ValueError: An index is 0 or no number, or counts back beyond the first vertex.
        InvalidScene: There are more triangles.
    """
    lines = _SHAPES.findall(_CONTINUED.sub(b" ", text.replace(b"\t", b" ")))
    faces = [line for line in lines if line.startswith(b"f")]
    triangles = len(b" ".join(faces).split()) - 3 * len(faces)
    if triangles > most:
        raise InvalidScene(f"mesh faces: {triangles} triangles, at most {most} are taken")
    plain = _LOOKS.sub(b"", b"\n".join([*lines, b""]))
    if not _NOT_PLAIN.search(plain):
        return plain
    seen, counted = 0, list[bytes]()
    for line in plain.splitlines():
        if line.startswith(b"v"):
            seen += 1
            counted.append(line)
        else:
            counted.append(b" ".join([b"f", *(_index(word, seen) for word in line.split()[1:])]))
    return b"\n".join(counted) + b"\n"


def _index(part: bytes, seen: int) -> bytes:
    if not part:
        return part
    index = int(part)
    if index < 0:
        index += seen + 1
    if index < 1:
        raise ValueError(f"the index {part!r} is none")
    return b"%d" % index
