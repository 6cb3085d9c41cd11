"""What real robots look like, beside what assimp reads; bounds and what can't be drawn."""

import importlib.metadata
import warnings
from pathlib import Path

import coal
import collada
import numpy as np
import pytest

from kinematics.errors import InvalidRobotDescription
from kinematics.urdf.visuals import read_visuals
from obstacles.robots.visual_geometry import visual_geometry


def robots() -> Path:
    files = importlib.metadata.files("example-robot-data") or []
    found = next(f for f in files if f.as_posix().endswith("panda_description/urdf/panda.urdf"))
    return Path(str(found.locate())).parents[2]


def find(uri: str) -> bytes:
    return (robots() / uri.partition("/robots/")[2]).read_bytes()


def test_links_have_the_size_and_colours_of_their_files() -> None:
    text = (robots() / "panda_description/urdf/panda.urdf").read_text()
    link = "panda_link5"
    made = visual_geometry(read_visuals(text), [link], find)
    assert not made.missing
    assert {body.link for body in made.bodies} == {link}
    file = robots() / "panda_description/meshes/visual/link5.dae"
    theirs = np.array(coal.MeshLoader().load(str(file), np.ones(3)).vertices())
    ours = np.vstack([body.surface.vertices for body in made.bodies])
    np.testing.assert_allclose(np.ptp(ours, axis=0), np.ptp(theirs, axis=0), atol=1e-6)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PendingDeprecationWarning)
        paints = {tuple(m.effect.diffuse) for m in collada.Collada(str(file)).materials}
    assert {body.color for body in made.bodies} == paints
    assert len(made.bodies) == len(paints) > 1


def test_a_bound_thins_out_the_finest_first() -> None:
    text = (robots() / "panda_description/urdf/panda.urdf").read_text()
    links = [f"panda_link{i}" for i in (0, 1, 5)]
    whole = visual_geometry(read_visuals(text), links, find, most=10**6)
    made = visual_geometry(read_visuals(text), links, find, most=20_000)
    assert sum(len(body.surface.faces) for body in made.bodies) <= 20_000
    sizes = {i: len(body.surface.faces) for i, body in enumerate(whole.bodies)}
    coarse = [i for i, body in enumerate(made.bodies) if body.simplified]
    assert coarse
    kept = [i for i in sizes if i not in coarse]
    assert max(sizes[i] for i in kept) < min(sizes[i] for i in coarse)
    for before, after in zip(whole.bodies, made.bodies, strict=True):
        if after.simplified:
            low, high = (side(before.surface.vertices, 0) for side in (np.min, np.max))
            assert (after.surface.vertices >= low - 1e-9).all()
            assert (after.surface.vertices <= high + 1e-9).all()


URDF = """<robot name="r"><link name="good"><visual><origin xyz="0 0 1"/>
  <geometry><box size="0.2 0.2 0.2"/></geometry></visual></link>
  <link name="bad"><visual><geometry><mesh filename="{0}"/></geometry></visual></link></robot>"""


@pytest.mark.parametrize(("name", "data", "words"), [
    ("a.stl", b"no mesh", "triangles"),
    ("a.dae", b"<COLLADA/>", "readable"),
    ("a.fbx", b"", "fbx"),
    ("gone.stl", None, "not there"),
])  # fmt: skip
def test_what_can_not_be_drawn_is_named(name: str, data: bytes | None, words: str) -> None:
    def one(_uri: str) -> bytes:
        if data is None:
            raise InvalidRobotDescription("it is not there")
        return data

    made = visual_geometry(read_visuals(URDF.format(name)), ["good", "bad"], one)
    ((link, reason),) = made.missing
    assert link == "bad"
    assert words in reason
    (box,) = made.bodies
    np.testing.assert_allclose(box.surface.vertices[:, 2].mean(), 1.0)
    assert box.color is None
