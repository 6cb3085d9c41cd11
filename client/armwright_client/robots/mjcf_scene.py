"""MJCF, the models of MuJoCo, as scenes: what stands or lies around a robot."""

from pathlib import Path
from typing import Any

from armwright_client.robots.mjcf import (
    Pose,
    bodies_of_robot,
    body_pose,
    collides,
    compiled,
    geoms_of,
    link_names,
    never_meet,
)
from armwright_wire.errors import InvalidArgument
from armwright_wire.scenes.scene import Scene


def scene_from_mjcf(path: Path | str) -> Scene:
    """The scene of an MJCF file: all that no hinge or slide moves, where the model puts it.

    Bodies on free joints are obstacles; those of robots are left out, and may touch what MuJoCo
    never lets them collide with.

    Args:
        path: Path of the file.

    Raises:
        InvalidArgument: mujoco is not installed, the file can't be compiled, or something that
            collides has a shape that scenes have no word for.
    """
    model = compiled(Path(path))
    robot = bodies_of_robot(model)
    links = link_names(model, [body for body in robot if any(solids(model, body))])
    frames = {0: Pose((0.0, 0.0, 0.0))}
    obstacles: list[dict[str, Any]] = []
    allowed: list[list[str]] = []
    taken = {*links.values()}
    for body in sorted({*range(model.nbody)} - {*robot}):
        if body:
            frames[body] = frames[int(model.body_parentid[body])].then(body_pose(model, body))
        for geom in solids(model, body):
            owner = model.body(body).name if body else ""
            name = model.geom(geom).name or owner or f"geom{geom}"
            while name in taken:
                name += "_"
            taken.add(name)
            frame = frames[body].then(Pose(model.geom_pos[geom], model.geom_quat[geom]))
            w, x, y, z = (float(part) for part in frame.quaternion)
            pose = {
                "position": [float(part) for part in frame.position],
                "quaternion_xyzw": [x, y, z, w],
            }
            obstacles.append({"id": name, "shape": shape(model, geom), "pose": pose})
            allowed += [
                [name, link]
                for other, link in links.items()
                if other and never_meet(model, other, body, [geom])
            ]
    return Scene.model_validate({"obstacles": obstacles, "allowed_collisions": allowed})


def solids(model: Any, body: int) -> list[int]:
    """Numbers of the geoms of a body that collide."""
    return [geom for geom in geoms_of(model, body) if collides(model, geom)]


def shape(model: Any, geom: int) -> dict[str, Any]:
    """The shape of a geom, as scenes have it; a mesh is its convex hull, as in MuJoCo."""
    x, y, z = (float(value) for value in model.geom_size[geom])
    match int(model.geom_type[geom]):
        case 0:
            return {"type": "halfspace", "normal": [0.0, 0.0, 1.0], "offset": 0.0}
        case 2:
            return {"type": "sphere", "radius": x}
        case 3:
            return {"type": "capsule", "radius": x, "height": 2.0 * y}
        case 5:
            return {"type": "cylinder", "radius": x, "height": 2.0 * y}
        case 6:
            return {"type": "box", "size": [2.0 * x, 2.0 * y, 2.0 * z]}
        case 7:
            mesh = int(model.geom_dataid[geom])
            first = int(model.mesh_vertadr[mesh])
            corners = model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])]
            return {"type": "convex", "vertices": corners.tolist()}
    raise InvalidArgument(
        f"geom {model.geom(geom).name or geom} is an ellipsoid, a height field or an SDF, which "
        "scenes have no word for",
        hint="Replace it by a capsule, a box or a mesh, or let it not collide.",
    )
