"""Triangle meshes as convex pieces that cover them, each with the triangles it stands for.

A body whose hull is the body is its hull. What is not convex is cut by planes where that saves the
hulls of the parts most volume. A part's hull covers it, cut faces included: what a plane cuts out
of a solid is bounded by where it cuts the surface, and those points belong to both parts. So a
distance to all hulls is a distance to the solid; where it does not do, the triangles decide
(``obstacles.distance.triangles.distance``), and nothing is filled that the mesh leaves open.
"""

import hashlib
from dataclasses import fields
from typing import IO, Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from kinematics.arrays import Array, frozen
from kinematics.caches.bounded_cache import bounded_cache
from kinematics.caches.preparation_limit import check_preparation_time
from obstacles.convex.closest_point import mesh_distances
from obstacles.convex.hull import Hull, convex_hull, corners_and_volume
from obstacles.kept_files import is_written, keep_file, read_file, write_file
from obstacles.meshes.bodies import mesh_bodies
from obstacles.meshes.convex_cover import COARSE, ConvexPart, Fineness, cut_bodies, hull_part
from obstacles.meshes.mesh import Faces
from obstacles.meshes.plane_cut import triangle_areas

#: A hull that is nowhere farther from the mesh than this stands for it [m]: half of what verdicts
#: are held to.
_SAME = 5e-7
#: Part of a hull's area that may be missing from a mesh that has the same area but for rounding.
_SAME_AREA = 1e-6
#: Points on a hull at which its distance to the mesh is measured.
_SAMPLES = 2000
#: So many bodies, the largest, may be pieces of their own; others are cut together.
_MOST_HULLS = 64
#: Corners that a piece may have that is the mesh itself: its farthest one is looked up, so that
#: many cost little, and a convex piece is a hundredth as dear as triangles under a cover.
_EXACT_CORNERS = 4096
#: So few corners that any hull of them is looked at closely.
_FEW_CORNERS = 192
#: Part of the corners of a mesh that are its hull's where it has more and may be convex.
_OWN_CORNERS = 0.9
#: Triangles that are held against all planes of a hull at once.
_TRIANGLES_AT_ONCE = 256


def convex_pieces(
    vertices: Array, faces: Faces, fineness: Fineness = COARSE
) -> tuple[ConvexPart, ...]:
    """Convex pieces whose union covers a mesh and what it encloses.

    Args:
        vertices: Shape (k, 3) [m].
        faces: Shape (f, 3).
        fineness: How finely to cut.

    Returns:
        The pieces, filled ones first; the same mesh gives the same ones.
    """
    used, numbers = np.unique(faces, return_inverse=True)
    mesh = vertices[used].tobytes(), numbers.astype(np.int64).tobytes()
    parts = _stored_pieces(*mesh, fineness)
    if is_written():  # what is in memory as well
        keep_file(_file_name(*mesh, fineness), lambda stream: _write(stream, parts))
    return parts


@bounded_cache(maxsize=256)
def _stored_pieces(vertices: bytes, faces: bytes, fineness: Fineness) -> tuple[ConvexPart, ...]:
    name = _file_name(vertices, faces, fineness)
    if (stored := _read(name)) is not None:
        return stored
    points = np.frombuffer(vertices).reshape(-1, 3)
    parts = _decompose(points, np.frombuffer(faces, dtype=np.int64).reshape(-1, 3), fineness)
    write_file(name, lambda stream: _write(stream, parts))
    return parts


def _file_name(vertices: bytes, faces: bytes, fineness: Fineness) -> str:
    how = b"7" if fineness == COARSE else repr(("7", *fineness)).encode()
    digest = hashlib.sha256(how + len(vertices).to_bytes(8) + vertices + faces).hexdigest()
    return f"{digest}.npz"


def _read(name: str) -> tuple[ConvexPart, ...] | None:
    file = read_file(name)
    if file is None:
        return None
    try:
        with np.load(file, allow_pickle=False) as stored:
            columns = [_split_by_counts(stored, item.name) for item in fields(ConvexPart)]
    except (OSError, ValueError, KeyError, BadZipFile):
        return None
    return tuple(
        ConvexPart(frozen(v), float(r[0]), frozen(t), frozen(a), bool(f[0]))
        for v, r, t, a, f in zip(*columns, strict=True)
    )


def _split_by_counts(stored: "np.lib.npyio.NpzFile", name: str) -> list[Array]:
    return np.split(stored[name], np.cumsum(stored[f"{name}_counts"])[:-1])


def _write(stream: IO[bytes], parts: tuple[ConvexPart, ...]) -> None:
    columns: dict[str, Any] = {}
    for item in fields(ConvexPart):
        own = [np.atleast_1d(getattr(part, item.name)) for part in parts]
        columns[item.name] = np.concatenate(own)
        columns[f"{item.name}_counts"] = np.array([len(array) for array in own])
    np.savez(stream, **columns)


def _decompose(vertices: Array, faces: Faces, fineness: Fineness) -> tuple[ConvexPart, ...]:
    diagonal = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    whole = _small_hull(vertices, faces)
    if (
        whole is not None
        and _is_hull(whole, vertices, faces)
        and _has_no_inside_walls(whole, vertices, faces)
    ):
        return (hull_part(whole),)
    bodies = mesh_bodies(vertices, faces)
    # Where one is a cavity of another one nothing may be filled unasked.
    hollow = any(body.cavity for body in bodies)
    sizes = [np.linalg.norm(np.ptp(vertices[body.faces], axis=(0, 1))) for body in bodies]
    hulls = dict[int, Hull]()
    for k in np.argsort(sizes)[::-1][:_MOST_HULLS].tolist():
        hull = None if hollow and bodies[k].closed else _small_hull(vertices, bodies[k].faces)
        if hull is not None and _is_hull(hull, vertices, bodies[k].faces):
            hulls[k] = hull
    rest = [body for k, body in enumerate(bodies) if k not in hulls]
    solid, open_ = ([b.faces for b in rest if b.closed == kind] for kind in (True, False))
    parts = cut_bodies(vertices, solid, diagonal, True, fineness)
    parts += cut_bodies(vertices, open_, diagonal, False, fineness)
    parts += [hull_part(hulls[k]) for k in sorted(hulls)]
    return tuple(sorted(parts, key=lambda part: not part.filled))


def _small_hull(vertices: Array, faces: Faces) -> Hull | None:
    """The hull of some triangles; None where it has more corners than a piece may have."""
    check_preparation_time()
    used = _used(vertices, faces)
    corners, _ = corners_and_volume(used)
    if len(corners) <= _FEW_CORNERS:
        return convex_hull(corners)
    # Looking closely at a large hull takes long: only where nearly all corners of the mesh are its.
    may_be_convex = len(corners) > _OWN_CORNERS * len(np.unique(used, axis=0))
    return convex_hull(corners) if may_be_convex and len(corners) <= _EXACT_CORNERS else None


def _used(vertices: Array, faces: Faces) -> Array:
    """The corners of some triangles."""
    used = np.zeros(len(vertices), dtype=np.bool_)
    used[faces] = True
    return vertices[used]


def _is_hull(hull: Hull, vertices: Array, faces: Faces) -> bool:
    """Whether every point of a hull's surface is one of the mesh inside it."""
    check_preparation_time()
    corners = hull.vertices[hull.triangles]
    wanted = float(triangle_areas(corners).sum())
    if hull.solid:
        own = vertices[np.unique(np.sort(faces, axis=1), axis=0)]
        if float(triangle_areas(own[_on_hull(own, hull)]).sum()) < (1.0 - _SAME_AREA) * wanted:
            return False
    return overhang(hull, vertices, faces) <= _SAME


def _on_hull(triangles: Array, hull: Hull) -> NDArray[np.bool_]:
    """Whether triangles (t, 3, 3) lie on a face of a hull of their corners, shape (t,)."""
    corners = np.vstack([triangles.reshape(-1, 3), hull.vertices])
    names = np.unique(corners, axis=0, return_inverse=True)[1].reshape(-1)
    count = len(names) - len(hull.vertices)
    both = np.vstack([names[:count].reshape(-1, 3), names[count:][hull.triangles]])
    low, middle, high = np.sort(both, axis=1).T
    keys = (low * len(names) + middle) * len(names) + high
    # Most are faces themselves; those of a flat part may be cut otherwise.
    lies = np.isin(keys[: len(triangles)], keys[len(triangles) :])
    rest = np.flatnonzero(~lies)
    lies[rest] = _on_planes(triangles[rest], hull.planes)
    return lies


def _on_planes(triangles: Array, planes: Array) -> NDArray[np.bool_]:
    """Whether triangles (t, 3, 3) lie on one of some planes (k, 4), shape (t,)."""
    lies = np.zeros(len(triangles), dtype=np.bool_)
    for begin in range(0, len(triangles), _TRIANGLES_AT_ONCE):
        own = triangles[begin : begin + _TRIANGLES_AT_ONCE]
        # Few planes pass the first corner: the others are held against these alone.
        near = np.abs(own[:, 0] @ planes[:, :3].T - planes[:, 3]) <= _SAME
        triangle, plane = np.nonzero(near)
        rest = np.einsum("ncd,nd->nc", own[triangle, 1:], planes[plane, :3]) - planes[plane, 3:]
        lies[begin + triangle[(np.abs(rest) <= _SAME).all(axis=1)]] = True
    return lies


def _has_no_inside_walls(hull: Hull, vertices: Array, faces: Faces) -> bool:
    """Whether no corner of a mesh lies deep in its hull, as those of a cavity would."""
    if not hull.solid:
        return True
    used = _used(vertices, faces)
    return all(
        float((block @ hull.planes[:, :3].T - hull.planes[:, 3]).max(axis=1).min()) >= -_SAME
        for block in np.array_split(used, len(used) // 4096 + 1)
    )


def overhang(hull: Hull, vertices: Array, faces: Faces) -> float:
    """Largest distance from points all over a hull to the mesh inside it [m].

    It is what a robot would see of the hull that the mesh has not. Unlike a ratio of volumes it
    needs no closed mesh, and unlike the depth of the mesh in its hull it does not mind inner walls.
    """
    corners = hull.vertices[hull.triangles]
    areas = triangle_areas(corners)
    if not areas.sum() > 0.0:
        return 0.0
    random = np.random.default_rng(0)
    chosen = random.choice(len(areas), _SAMPLES, p=areas / areas.sum())
    weights = random.dirichlet([1.0, 1.0, 1.0], _SAMPLES)
    points = np.einsum("nk,nkd->nd", weights, corners[chosen])
    # The middle of the largest triangles is where a lid over a hollow is seen best.
    points = np.vstack([points, corners[np.argsort(-areas)[:_SAMPLES]].mean(axis=1)])
    distances = np.empty(len(points))
    mesh_distances(points, vertices, faces, distances)
    return float(distances.max())
