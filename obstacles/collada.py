"""COLLADA files: the triangles of their scene. The only place that knows pycollada."""

import warnings
from io import BytesIO
from typing import Any

import collada
import numpy as np

from kinematics.arrays import Array
from kinematics.xml_reader import Element, number, read_document, tostring

#: What a surface is made of. All else (paint, lights, cameras, animations) is taken out first:
#: files often refer to paint that is not there.
_PARTS = ("asset", "library_geometries", "library_nodes", "library_visual_scenes", "scene")
_LOOKS = ("bind_material", "instance_camera", "instance_light")


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
    root = read_document(data, "COLLADA file")
    scale = _unit(root)
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
        parts = [_corners(part) for body in bodies for part in body.primitives()]
    solid = [corners for corners in parts if corners is not None]
    if not solid:
        raise ValueError("no surface")
    return np.concatenate(solid) * scale


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
