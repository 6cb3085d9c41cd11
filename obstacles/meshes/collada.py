"""COLLADA files: the triangles of their scene. The only place that knows pycollada."""

import warnings
from collections.abc import Mapping
from io import BytesIO
from typing import Any, NamedTuple

import numpy as np

from kinematics.arrays import Array
from kinematics.errors import InvalidScene
from kinematics.readers.xml_reader import Element, number, read_document, tostring

#: What a surface is made of. All else (paint, lights, cameras, animations) is taken out first:
#: files often refer to paint that is not there.
_PARTS = ("asset", "library_geometries", "library_nodes", "library_visual_scenes", "scene")
_SURFACES = ("triangles", "trifans", "tristrips", "polygons", "polylist", "lines", "linestrips")
_LOOKS = ("bind_material", "instance_camera", "instance_light")
#: Corners of a scene with all that it refers to: four times those of all triangles that a mesh may
#: have.
_MOST_CORNERS = 2_400_000
#: A node takes as long to follow as so many corners.
_NODE = 100
#: Characters for a corner, which has three indices of a few digits as a rule.
_CORNER_LENGTH = 12


class Painted(NamedTuple):
    """Triangles of one colour.

    Args:
        corners: Shape (f, 3, 3) [m].
        color: Red, green, blue, opacity, 0 to 1; None where the file gives none.
    """

    corners: Array
    color: tuple[float, float, float, float] | None


def triangles(data: bytes) -> Array:
    """Corners of every triangle of the scene [m], in the file's axes; polygons are cut up.

    As robot tools do, the file's unit is applied and its "up" axis is not: a link's frame is the
    file's frame. Lines and points have no surface and are left out.

    Args:
        data: The file's content.

    Returns:
        Shape (f, 3, 3).

    Raises:
        ArmwrightError: Not well-formed, with a DTD or entities, or larger than any robot.
        ValueError: There is no surface in it; what pycollada raises for malformed files besides.
    """
    return np.concatenate([part.corners for part in paint_parts(data)])


def paint_parts(data: bytes) -> list[Painted]:
    """The triangles of the scene by the diffuse colour of their material.

    Args:
        data: The file's content.

    Raises:
        ArmwrightError: Not well-formed, with a DTD or entities, or larger than any robot.
        ValueError: There is no surface in it; what pycollada raises for malformed files besides.
    """
    root = read_document(data, "COLLADA file")
    scale, colors = _unit(root), _diffuse_colors(root)
    for child in list(root):
        if _tag(child) in _PARTS:
            _strip_looks(child)
        else:
            root.remove(child)
    _check_size(root)
    import collada  # noqa: PLC0415  seldom needed, and long

    with warnings.catch_warnings():
        # pycollada multiplies numpy's matrices, which numpy would rather not have.
        warnings.simplefilter("ignore", PendingDeprecationWarning)
        file = collada.Collada(BytesIO(tostring(root)))
        bodies = file.scene.objects("geometry") if file.scene is not None else ()
        parts = [(_corners(part), _symbol(part)) for body in bodies for part in body.primitives()]
    solid = [Painted(c * scale, colors.get(symbol)) for c, symbol in parts if c is not None]
    if not solid:
        raise ValueError("no surface")
    return solid


def _check_size(root: Element) -> None:
    """Count what the scene has once its references are followed, before anything follows them.

    Raises:
        InvalidScene: More nodes or corners than any robot has, or a node within itself.
    """
    named = {e.get("id", ""): e for e in root.iter() if _tag(e) in ("node", "geometry")}
    # What nothing refers to is read as well.
    named[""] = root
    sizes, waiting = dict[Element, int](), [(root, False)]
    open_ = set[Element]()
    while waiting:
        element, is_done = waiting.pop()
        if is_done:
            open_.discard(element)
            size = (
                _NODE
                + _corner_count(element)
                + sum(sizes[part] for part in _expanded(element, named))
            )
            if size > _MOST_CORNERS:
                raise InvalidScene(
                    "mesh file: its COLLADA scene repeats its nodes or bodies too often",
                    hint=f"At most {_MOST_CORNERS // _NODE} nodes are taken, and "
                    f"{_MOST_CORNERS} corners, with all that they refer to.",
                )
            sizes[element] = size
        elif element in open_:
            raise InvalidScene("mesh file: a node of its COLLADA scene refers to itself")
        elif element not in sizes:
            open_.add(element)
            waiting.append((element, True))
            waiting += [(part, False) for part in _expanded(element, named)]


def _expanded(element: Element, named: Mapping[str, Element]) -> list[Element]:
    """Elements below a node once its references are followed, and what a file has."""
    parts = list[Element]()
    if element is named[""]:
        return [e for e in element.iter() if _tag(e) in ("visual_scene", "geometry")]
    for child in element:
        if _tag(child) == "node":
            parts.append(child)
        elif _tag(child) in ("instance_node", "instance_geometry"):
            target = named.get(child.get("url", "").removeprefix("#"))
            parts += [] if target is None else [target]
    return parts


def _corner_count(element: Element) -> int:
    """About how many corners it takes to read a geometry; none of another element."""
    if _tag(element) != "geometry":
        return 0
    count = 0
    for part in element.iter():
        text = part.text or ""
        if _tag(part) in _SURFACES:
            count += _NODE
        elif _tag(part) == "p":
            count += len(text) // _CORNER_LENGTH
        elif _tag(part) == "vcount":
            count += sum(abs(int(word)) for word in text.split())
    return count


def _diffuse_colors(root: Element) -> dict[str, tuple[float, float, float, float]]:
    """Colours of materials by the symbols that triangles name them by."""
    effects = {e.get("id", ""): _diffuse(e) for e in root.iter() if _tag(e) == "effect"}
    effect_of = {
        material.get("id", ""): instance.get("url", "").removeprefix("#")
        for material in root.iter()
        if _tag(material) == "material"
        for instance in material
        if _tag(instance) == "instance_effect"
    }
    target_of = dict(zip(effect_of, effect_of, strict=True))
    for element in root.iter():
        if _tag(element) == "instance_material":
            target = element.get("target", "").removeprefix("#")
            target_of.setdefault(element.get("symbol", ""), target)
    found = {s: effects.get(effect_of.get(t, "")) for s, t in target_of.items()}
    return {name: color for name, color in found.items() if color is not None}


def _diffuse(effect: Element) -> tuple[float, float, float, float] | None:
    """The diffuse colour of an effect; None for a picture, or where it can't be read."""
    for element in effect.iter():
        if _tag(element) != "diffuse":
            continue
        for color in element:
            words = (color.text or "").split()
            if _tag(color) == "color" and len(words) == len("rgba"):
                try:
                    red, green, blue, alpha = (min(max(float(v), 0.0), 1.0) for v in words)
                except ValueError:
                    return None
                return red, green, blue, alpha
    return None


def _symbol(part: Any) -> str:
    """The name of a part's material, which it keeps although the binding was taken out."""
    original = getattr(part, "original", None)
    return str(getattr(original, "material", None) or "")


def _tag(element: Element) -> str:
    return element.tag.rpartition("}")[2]


def _unit(root: Element) -> float:
    """The file's unit [m]."""
    for asset in root:
        for unit in asset if _tag(asset) == "asset" else ():
            if _tag(unit) == "unit":
                metres = number(unit, "meter", "the COLLADA file", default=1.0)
                if metres <= 0.0:
                    raise ValueError(f"a unit of {metres:g} m")
                return metres
    return 1.0


def _strip_looks(element: Element) -> None:
    for child in list(element):
        if _tag(child) in _LOOKS:
            element.remove(child)
        else:
            _strip_looks(child)


def _corners(part: Any) -> Array | None:
    cut = part.triangleset() if hasattr(part, "triangleset") else part
    if type(cut).__name__ != "BoundTriangleSet":
        return None
    return np.array(cut.vertex[cut.vertex_index], dtype=np.float64)
