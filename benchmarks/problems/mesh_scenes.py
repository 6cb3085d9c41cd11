"""Scenes of our own for arms of any size: shelves, tables with cans, and things that are hollow."""

from collections.abc import Iterator

import numpy as np
import trimesh

from kinematics.arrays import Array
from kinematics.pose import from_rpy, transform
from obstacles.scenes.scene import Obstacle, Scene
from obstacles.shapes.shape import Box, Mesh, Shape


def own_scenes(count: int, reach: float, seed: int = 0) -> Iterator[Scene]:
    """Shelves, tables, hollow things and nothing at all, by turns.

    Args:
        count: How many.
        reach: Of the arm [m].
        seed: Of the random numbers.
    """
    random = np.random.default_rng(seed)
    for k in range(count):
        made = (_shelf, _table, _hollows)
        yield made[k % 4](random, reach) if k % 4 < len(made) else Scene(())


def _block(name: str, size: list[float], at: list[float], yaw: float, reach: float) -> Obstacle:
    T = transform(from_rpy([0.0, 0.0, yaw]), reach * np.array(at))
    return Obstacle(name, Box(reach * np.array(size)), T)


def _shelf(random: np.random.Generator, reach: float) -> Scene:
    x, yaw = float(random.uniform(0.45, 0.6)), float(random.uniform(-0.2, 0.2))
    boards = [
        _block(f"board{i}", [0.3, 0.8, 0.02], [x, 0.0, float(z)], yaw, reach)
        for i, z in enumerate((0.1, 0.1 + random.uniform(0.25, 0.4), 0.9))
    ]
    sides = [
        _block(f"side{y:+.0f}", [0.3, 0.02, 0.8], [x, 0.4 * y, 0.5], yaw, reach)
        for y in (-1.0, 1.0)
    ]
    return Scene((*boards, *sides))


def _table(random: np.random.Generator, reach: float) -> Scene:
    low = float(random.uniform(-0.1, 0.15))
    top = _block("top", [0.6, 1.0, 0.04], [0.55, 0.0, low], 0.0, reach)
    can = mesh(trimesh.creation.cylinder(0.04 * reach, 0.15 * reach, sections=32))
    cans = []
    for k in range(6):
        place = reach * random.uniform([0.3, -0.45, 0.15], [0.8, 0.45, 0.35])
        cans.append(Obstacle(f"can{k}", can, transform(None, place)))
    return Scene((top, *cans))


def _hollows(random: np.random.Generator, reach: float) -> Scene:
    """Rings, bowls, pipes and open boxes, wide enough for most links, turned anyhow."""
    things = []
    for k, shape in enumerate(hollow_things(reach)):
        angles = random.uniform(-np.pi, np.pi, 2)
        away = reach * random.uniform(0.35, 0.8)
        place = away * np.array([np.cos(angles[0]), np.sin(angles[0]), 0.0])
        place[2] = reach * random.uniform(0.1, 0.7)
        T = transform(from_rpy([angles[1], *random.uniform(-np.pi, np.pi, 2)]), place)
        things.append(Obstacle(f"thing{k}", shape, T))
    return Scene(tuple(things))


def hollow_things(size: float) -> tuple[Shape, ...]:
    """A ring, a bowl (closed, and as a sheet of no thickness), a pipe and an open box."""
    ring = trimesh.creation.torus(0.16 * size, 0.03 * size, major_sections=40, minor_sections=16)
    pipe = trimesh.creation.annulus(0.12 * size, 0.14 * size, 0.3 * size, sections=40)
    return mesh(ring), mesh(bowl(size)), mesh(bowl(size, sheet=True)), mesh(pipe), mesh(crate(size))


def bowl(size: float, sheet: bool = False) -> trimesh.Trimesh:
    """The lower half of a hollow ball, or of its outer surface alone."""
    turns = np.linspace(-np.pi / 2.0, 0.0, 12)
    arc = np.column_stack([np.cos(turns), np.sin(turns)])
    arc[0, 0] = 0.0
    line = 0.18 * size * arc
    if not sheet:
        line = np.vstack([line, 0.15 * size * arc[::-1]])
    return trimesh.creation.revolve(line, sections=32)


def crate(size: float) -> trimesh.Trimesh:
    """A box without lid, of walls that run into each other."""
    a, wall, tall = 0.15 * size, 0.01 * size, 0.2 * size
    parts = [trimesh.creation.box([2 * a, 2 * a, wall])]
    for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        extents = [wall if x else 2 * a, wall if y else 2 * a, tall]
        part = trimesh.creation.box(extents)
        part.apply_translation([a * x, a * y, 0.5 * tall])
        parts.append(part)
    return trimesh.util.concatenate(parts)


def mesh(solid: trimesh.Trimesh) -> Mesh:
    """The same as an obstacle's shape."""
    return Mesh(np.array(solid.vertices), np.array(solid.faces))


def reach_of(tips: Array) -> float:
    """How far the farthest of some positions of the tool (m, 3) is from the base [m]."""
    return float(np.linalg.norm(tips, axis=1).max())
