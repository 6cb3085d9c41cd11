"""COLLADA files: the triangles of their scene. The only place that knows pycollada."""

import warnings
from collections.abc import Mapping
from io import BytesIO
from typing import Any, NamedTuple

import collada
import numpy as np

from kinematics.arrays import Array
from kinematics.xml_reader import Element, number, read_document, tostring

#: What a surface is made of. All else (paint, lights, cameras, animations) is taken out first:
#: files often refer to paint that is not there.
_PARTS = ("asset", "library_geometries", "library_nodes", "library_visual_scenes", "scene")
_LOOKS = ("bind_material", "instance_camera", "instance_light")


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
        ArmwrightError: Not well-formed, with a DTD or entities.
        ValueError: There is no surface in it; what pycollada raises for malformed files besides.
    """
    return np.concatenate([part.corners for part in paint_parts(data)])


def paint_parts(data: bytes) -> list[Painted]:
    """The triangles of the scene by the diffuse colour of their material.

    Args:
        data: The file's content.

    Raises:
        ArmwrightError: Not well-formed, with a DTD or entities.
        ValueError: There is no surface in it; what pycollada raises for malformed files besides.
    """
    root = read_document(data, "COLLADA file")
    scale, colors = _unit(root), _diffuse_colors(root)
    for child in list(root):
        if _tag(child) in _PARTS:
            _strip_looks(child)
        else:
            root.remove(child)
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
    return _without_none({s: effects.get(effect_of.get(t, "")) for s, t in target_of.items()})


def _without_none(
    colors: Mapping[str, tuple[float, float, float, float] | None],
) -> dict[str, tuple[float, float, float, float]]:
    return {name: color for name, color in colors.items() if color is not None}


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
    if not isinstance(cut, collada.triangleset.BoundTriangleSet):
        return None
    return np.array(cut.vertex[cut.vertex_index], dtype=np.float64)
