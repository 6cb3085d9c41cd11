"""Triangle meshes: read from bytes, checked and scaled.

Wavefront OBJ is brought into the form that every reader takes. The format lets a face count back
from where it stands: -1 is the vertex before it. Readers that take -1 for the last vertex of the
file make another body of it and say nothing. Names, groups and materials are left out: a reader
that makes a mesh of each takes the square of their number in time.
Source: "Object Files (.obj)", Advanced Visualizer manual, appendix B1.
"""

import io
import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinematics.arrays import Array, frozen
from kinematics.errors import InvalidScene
from obstacles.meshes.collada import paint_parts, triangles

#: What is read, by file extension. No archives (a small one can unpack to gigabytes), nothing
#: that fetches other files.
FILE_TYPES = ("stl", "obj", "ply", "off", "dae")
MAX_BYTES = 64 * 2**20
MAX_VERTICES = 600_000
MAX_FACES = 200_000
#: Header and count of a binary STL [byte].
_STL_HEADER = 84
#: One triangle of a binary STL [byte].
_STL_TRIANGLE = 50
#: What ends the text that a PLY begins with.
_END_OF_HEADER = b"end_header"
#: Squared sine of a triangle's angle below which its corners lie on a line, up to rounding.
_ON_A_LINE = 1e-24
Faces = NDArray[np.int64]
#: A line with a vertex or a face, without the blanks before it.
_SHAPES = re.compile(rb"^ *([vf] [^\n]*)", re.MULTILINE)
#: Of a corner of a face, what it has beside its vertex.
_LOOKS = re.compile(rb"/[^ \r\n]*")
#: An index that counts back or is 0, which is none.
_NOT_PLAIN = re.compile(rb"^f[^\n]* (-|0+[ \r]|0+$)", re.MULTILINE)
#: A line that ends in this goes on in the next one.
_CONTINUED = re.compile(rb"\\ *\r?\n")


def load_mesh(data: bytes, file_type: str) -> tuple[Array, Faces]:
    """Read a mesh from the bytes of a file; several bodies are joined.

    Args:
        data: The file's content.
        file_type: Extension of the file, one of ``FILE_TYPES``.

    Returns:
        Vertices (k, 3), in the file's units ("dae": in metres, as it says its unit); triangles
        (f, 3).

    Raises:
        InvalidScene: Unknown type, too large, unreadable, empty, not finite or indices out of
            range.
    """
    kind = file_type.lower().lstrip(".")
    if kind not in FILE_TYPES:
        raise InvalidScene(
            f"mesh files of type {kind!r} are not read",
            hint=f"Convert it to one of: {', '.join(FILE_TYPES)}.",
            file_types=list(FILE_TYPES),
        )
    if len(data) > MAX_BYTES:
        raise InvalidScene(f"mesh file: {len(data)} bytes, at most {MAX_BYTES} are taken")
    try:
        vertices, faces = _read(data, kind)
    except InvalidScene:
        raise
    except Exception as error:  # noqa: BLE001  a foreign parser on foreign bytes raises anything
        raise InvalidScene(f"mesh file: not a readable {kind} ({type(error).__name__})") from None
    return checked_mesh(vertices, faces)


def is_bare_header(data: bytes, file_type: str) -> bool:
    """Whether a file is the header of a binary STL and no triangle.

    Exporters write such files for frames that have no solid.

    Args:
        data: The file's content.
        file_type: Extension of the file.
    """
    is_short = _STL_HEADER - 4 <= len(data) <= _STL_HEADER
    return file_type.lower() == "stl" and is_short and not any(data[_STL_HEADER - 4 :])


def load_painted(
    data: bytes, file_type: str
) -> list[tuple[tuple[float, float, float, float] | None, Array, Faces]]:
    """Read a mesh for display: its parts by colour, which only COLLADA files have.

    Args:
        data: The file's content.
        file_type: Extension of the file, one of ``FILE_TYPES``.

    Returns:
        Colours (red, green, blue, opacity) with vertices and triangles as of `load_mesh`.

    Raises:
        InvalidScene: As `load_mesh`.
    """
    if file_type.lower() != "dae":
        return [(None, *load_mesh(data, file_type))]
    if len(data) > MAX_BYTES:
        raise InvalidScene(f"mesh file: {len(data)} bytes, at most {MAX_BYTES} are taken")
    try:
        parts = paint_parts(data)
    except InvalidScene:
        raise
    except Exception as error:  # noqa: BLE001  as in load_mesh
        raise InvalidScene(f"mesh file: not a readable dae ({type(error).__name__})") from None
    by_color: dict[tuple[float, float, float, float] | None, list[Array]] = {}
    for part in parts:
        by_color.setdefault(part.color, []).append(part.corners)
    read = []
    for color, corners in by_color.items():
        points = np.concatenate(corners).reshape(-1, 3)
        read.append((color, *checked_mesh(points, np.arange(len(points)).reshape(-1, 3))))
    return read


def _read(data: bytes, kind: str) -> tuple[Array, Faces]:
    import trimesh  # noqa: PLC0415  a tenth of a second, for meshes only

    if kind == "dae":
        mesh = trimesh.Trimesh(**trimesh.triangles.to_kwargs(triangles(data)), process=False)
        mesh.merge_vertices()
    else:
        text, rest = _text_and_rest(data, kind)
        text = plain_obj(text, MAX_FACES) if kind == "obj" else text
        mesh = trimesh.load_scene(
            io.BytesIO(_in_utf8(text) + rest), file_type=kind, process=False, allow_remote=False
        ).to_mesh()
    return np.array(mesh.vertices), np.array(mesh.faces)


def _text_and_rest(data: bytes, kind: str) -> tuple[bytes, bytes]:
    """The text that a mesh file begins with, and the rest."""
    if kind == "ply":
        header, mark, rest = data.partition(_END_OF_HEADER)
        return header, mark + rest
    # Binary STL says how long it is, whatever it begins with.
    triangles = int.from_bytes(data[_STL_HEADER - 4 : _STL_HEADER], "little")
    is_binary = kind == "stl" and len(data) == _STL_HEADER + _STL_TRIANGLE * triangles
    return (b"", data) if is_binary else (data, b"")


def _in_utf8(data: bytes) -> bytes:
    """Text in UTF-8: names in other encodings are taken for Latin-1, in which all bytes are."""
    try:
        data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1").encode("utf-8")
    return data


def checked_mesh(vertices: ArrayLike, faces: ArrayLike) -> tuple[Array, Faces]:
    """Check a mesh and answer it as read-only arrays.

    Raises:
        InvalidScene: Empty, not finite, not rows of three, an index out of range, or no triangle
            has an area.
    """
    try:
        points, given = frozen(vertices), np.asarray(faces)
    except (TypeError, ValueError, OverflowError):
        raise InvalidScene("mesh: vertices and faces must be arrays of numbers") from None
    if not points.size or not given.size:
        raise InvalidScene(
            "mesh: it has no triangles",
            hint="Send the whole file, or leave it out.",
        )
    for name, array, most in (("vertices", points, MAX_VERTICES), ("faces", given, MAX_FACES)):
        if array.ndim != 2 or array.shape[1] != 3 or not len(array):
            raise InvalidScene(f"mesh {name}: shape {array.shape}, needed are rows of three")
        if len(array) > most:
            raise InvalidScene(f"mesh {name}: {len(array)} rows, at most {most} are taken")
    if not np.isfinite(points).all():
        raise InvalidScene("mesh vertices: not finite")
    if given.dtype.kind not in "iu":
        raise InvalidScene("mesh faces: not whole numbers")
    if given.min() < 0 or given.max() >= len(points):
        raise InvalidScene(
            f"mesh faces: an index is not among the {len(points)} vertices",
            hint=f"Indices run from 0 to {len(points) - 1}.",
        )
    indices = np.array(given, dtype=np.int64)
    if not _has_area(points[indices]):
        raise InvalidScene(
            "mesh faces: no triangle has an area, the mesh is a point or a line",
            hint="Give a sphere, a capsule or a thin box in its place.",
        )
    indices.setflags(write=False)
    return points, indices


def _has_area(triangles: Array) -> bool:
    """Whether one of the triangles (f, 3, 3) has corners that are not on a line."""
    ab, ac = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    scale = np.abs(np.concatenate([ab, ac])).max()
    if scale == 0.0:
        return False
    ab, ac = ab / scale, ac / scale
    square = (np.cross(ab, ac) ** 2).sum(axis=1)
    sides = (ab**2).sum(axis=1) * (ac**2).sum(axis=1)
    return bool((square > _ON_A_LINE * sides).any())


def scaled(vertices: Array, faces: Faces, scale: Sequence[float]) -> tuple[Array, Faces]:
    """Scale a mesh along x, y, z; a mirroring scale turns its faces round, so they face out.

    Raises:
        InvalidScene: The scale is not finite, or 0 along an axis.
    """
    factors = np.array(scale, dtype=np.float64)
    if factors.shape != (3,) or not np.isfinite(factors).all() or (factors == 0.0).any():
        raise InvalidScene(f"mesh scale {list(scale)}: needed are three numbers other than 0")
    turned = faces[:, ::-1] if np.prod(np.sign(factors)) < 0.0 else faces
    return checked_mesh(vertices * factors, turned)


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
