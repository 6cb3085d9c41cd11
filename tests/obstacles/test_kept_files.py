"""Arrays kept in files: read back bit by bit, computed anew where a file is missing or spoilt."""

import io
import random
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from armwright.robot import load_robot
from compiled.kept_file import write_kept
from obstacles.collision.model import brackets, collision_model, pair_grid
from obstacles.convex import sphere_set
from obstacles.kept_files import keep_file, keep_files_in, kept_array, written_files
from obstacles.robots.robot_geometry import RobotGeometry


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    # What is kept of built-in robots for this user stays out of these tests.
    monkeypatch.setattr("armwright.robot.keep_robot", lambda _: None)
    keep_files_in(tmp_path / "kept")
    yield tmp_path / "kept"
    keep_files_in(None)


def never(*_: object) -> np.ndarray:
    raise AssertionError("it was kept")


def test_an_array_is_written_only_while_something_is_prepared(folder: Path) -> None:
    made = np.random.default_rng(0).normal(size=(5, 6))
    assert kept_array("one", (-1, 6), lambda: made) is made
    assert not folder.exists(), "kept only where somebody will remove it"
    with written_files() as written:
        kept_array("one", (-1, 6), lambda: made)
    assert written == [folder / "one.npy"]
    np.testing.assert_array_equal(kept_array("one", (-1, 6), never), made)


def test_files_that_are_there_are_noted_by_whoever_needs_them(folder: Path) -> None:
    made = np.ones((2, 6))
    with written_files():
        kept_array("one", (-1, 6), lambda: made)
    with written_files() as written:
        kept_array("one", (-1, 6), never)
        keep_file("one.npy", lambda _: pytest.fail("it was kept"))
        keep_file("two.npy", lambda stream: np.save(stream, made))
    assert written == [folder / "one.npy", folder / "two.npy"]
    np.testing.assert_array_equal(kept_array("two", (-1, 6), never), made)


@pytest.mark.parametrize(
    "content", ["damaged", "other shape", "other type", "object", "other format"]
)
def test_a_spoilt_file_is_not_read_but_written_anew(folder: Path, content: str) -> None:
    made, stream = np.arange(12.0).reshape(2, 6), io.BytesIO()
    others = {"other shape": made.T, "other type": made.astype(np.int64)}
    if content == "other format":
        np.savez(stream, made)
    else:
        np.save(stream, others.get(content, np.array([[{}] * 6])), allow_pickle=True)
    file = folder / "one.npy"
    write_kept(file, stream.getvalue())
    if content == "damaged":
        kept = bytearray(file.read_bytes())
        kept[-3] ^= 1
        file.write_bytes(kept)
    np.testing.assert_array_equal(kept_array("one", (-1, 6), lambda: made + 1.0), made + 1.0)
    np.testing.assert_array_equal(kept_array("one", (-1, 6), never), made + 1.0)


def test_no_flipped_bit_changes_what_is_read(folder: Path) -> None:
    robot, chance = load_robot("planar_rr"), random.Random(2)
    with written_files() as written:
        expected = packed(robot)
    for _ in range(40):
        file = chance.choice(written)
        kept = bytearray(file.read_bytes())
        kept[chance.randrange(len(kept))] ^= 1 << chance.randrange(8)
        file.write_bytes(kept)
        for array, other in zip(packed(robot), expected, strict=True):
            np.testing.assert_array_equal(array, other)


def test_where_nothing_can_be_written_it_is_computed(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    keep_files_in(tmp_path / "file")
    try:
        with written_files() as written:
            assert kept_array("one", (1,), lambda: np.ones(1)) == 1.0
        assert written == []
    finally:
        keep_files_in(None)


def packed(robot: RobotGeometry) -> list[np.ndarray]:
    """Spheres and grids of a robot, nothing of it in memory."""
    for cached in (
        sphere_set._spheres, brackets.brackets, pair_grid._values, collision_model._robot_part,
    ):  # fmt: skip
        cached.cache_clear()
    part = collision_model._robot_part(robot)
    return [part.brackets.spheres, part.brackets.starts, *part.grid]


def test_spheres_and_grids_of_a_robot_are_kept(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = load_robot("ur5e")
    expected = packed(robot)
    with written_files() as written:
        packed(robot)
    assert sorted(written) == sorted(folder.iterdir())
    monkeypatch.setattr(sphere_set, "_sphere_rows", never)
    monkeypatch.setattr(pair_grid, "_fill", never)
    for array, other in zip(packed(robot), expected, strict=True):
        np.testing.assert_array_equal(array, other)
        assert array.dtype == other.dtype
    # Another robot is made of other numbers: of this one only pieces are the same.
    with pytest.raises(AssertionError, match="it was kept"):
        packed(load_robot("panda"))


def test_what_is_in_memory_is_kept_for_another_robot_of_the_same_links(folder: Path) -> None:
    robot = load_robot("kr6_sixx")
    with written_files() as first:
        collision_model.pack(robot)
    contents = {file.name: file.read_bytes() for file in first}
    for file in first:
        file.unlink()
    with written_files() as again:
        collision_model.pack(robot)
    assert {file.name: file.read_bytes() for file in again} == contents
