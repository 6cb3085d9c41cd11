"""Surfaces that are thinned out stay near what they stand for."""

import numpy as np
import pytest
import trimesh

from obstacles.convex.triangles import Triangles
from obstacles.robots.visual_geometry import thin_out


@pytest.mark.parametrize("most", [400, 2_000])
def test_a_ball_stays_round(most: int) -> None:
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.5)
    coarse = thin_out(Triangles(np.array(ball.vertices), np.array(ball.faces)), most)
    assert most / 4 < len(coarse.faces) <= most
    side = np.linalg.norm(np.ptp(coarse.vertices[coarse.faces], axis=1), axis=1).max()
    distances = np.abs(np.linalg.norm(coarse.vertices, axis=1) - 0.5)
    assert distances.max() < side
    made = trimesh.Trimesh(coarse.vertices, coarse.faces, process=False)
    assert made.volume == pytest.approx(ball.volume, rel=0.15)
    assert made.is_winding_consistent


def test_what_has_few_triangles_stays_as_it_is() -> None:
    box = trimesh.creation.box()
    surface = Triangles(np.array(box.vertices), np.array(box.faces))
    assert thin_out(surface, 12) is surface


def test_the_coarsest_form_is_answered_where_nothing_fits() -> None:
    ball = trimesh.creation.icosphere(subdivisions=4)
    coarse = thin_out(Triangles(np.array(ball.vertices), np.array(ball.faces)), 1)
    assert 1 < len(coarse.faces) < 1_000
