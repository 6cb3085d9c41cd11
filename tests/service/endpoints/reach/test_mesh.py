"""Meshes of reach, read by trimesh: volume, place and colours."""

import io

import numpy as np
import pytest
import trimesh

from kinematics.pose import transform
from planning.reach.evaluation import PoseGrid, Reach, Status
from service.endpoints.reach import task


def found(grid: PoseGrid, random: np.random.Generator) -> Reach:
    """Random answers for a grid."""
    count = int(np.prod(grid.shape))
    status = random.choice([s.value for s in Status], count).astype(np.int64)
    reached = status == Status.REACHED.value
    n = np.zeros(count)
    figure = np.where(reached, random.uniform(0.0, 0.2, count), np.nan)
    return Reach(
        status=status,
        branches=reached.astype(np.int64),
        samples=reached.astype(np.int64),
        joints=np.full((count, 6), np.nan),
        manipulability=figure,
        clearance=n,
        limit_distance=n,
        completed=count,
    )


@pytest.mark.parametrize("size", [(0.4, 0.3, 0.2), (0.4, 0.3, 0.0), (0.5, 0.0, 0.0)])
def test_the_surface_holds_the_volume_of_what_is_reached(size: tuple[float, ...]) -> None:
    random = np.random.default_rng(3)
    T = transform(trimesh.transformations.rotation_matrix(0.7, (1, 2, 3))[:3, :3], (1.0, 2.0, 3.0))
    grid = PoseGrid(np.array(size), 0.1, T, np.eye(3)[None])
    reach = found(grid, random)
    loaded = trimesh.load(
        io.BytesIO(task.draw(grid, reach)), file_type="glb", force="mesh", process=False
    )
    count = int(reach.is_reached.sum())
    assert loaded.volume == pytest.approx(count * 1e-3, rel=1e-4)
    centre = grid.points()[reach.is_reached].mean(axis=0)
    x, y, z = loaded.center_mass
    assert np.allclose((x, -z, y), centre, atol=1e-4)  # glTF has y up


def test_the_best_point_is_yellow_and_the_worst_is_blue() -> None:
    grid = PoseGrid(np.array([0.2, 0.0, 0.0]), 0.1, np.eye(4), np.eye(3)[None])
    reach = found(grid, np.random.default_rng(0))
    reach.status[:] = Status.REACHED.value
    reach.manipulability[:] = (0.0, 0.05, 0.1)
    loaded = trimesh.load(
        io.BytesIO(task.draw(grid, reach)), file_type="glb", force="mesh", process=False
    )
    colours = {tuple(row) for row in loaded.visual.vertex_colors.tolist()}
    assert colours == {(45, 20, 110, 255), (147, 122, 75, 255), (250, 225, 40, 255)}
    # Three cubes in a row: the faces between them are left out.
    assert len(loaded.faces) == 2 * (3 * 6 - 4)
