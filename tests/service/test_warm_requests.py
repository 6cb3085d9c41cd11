"""Requests of our own before those of others: what they leave for workers."""

from pathlib import Path

import pytest

from kinematics.robots import builtin_names
from obstacles import kept_files
from obstacles.collision.checker import Checker
from obstacles.collision.model import brackets, collision_model, pair_grid
from obstacles.collision.model.collision_model import _robot_part
from obstacles.convex import sphere_set
from obstacles.scenes.scene import Scene
from service.storage.caches import worker_cache
from service.storage.caches.cache_key import builtin_reference
from service.warm_up import warm_requests


def test_workers_find_the_spheres_of_each_built_in_robot() -> None:
    steps = [step for step in warm_requests._requests() if "_keep_apart" in repr(step)]
    assert len(steps) == len(builtin_names())
    geometry = worker_cache.robot(builtin_reference("planar_rr")).geometry
    for step in steps:
        if "planar_rr" in repr(step):
            step()
    made = _robot_part.cache_info().misses
    assert Checker.of(geometry, Scene()).clearance(geometry.chain.limits.lower)[0] > 0.0
    assert _robot_part.cache_info().misses == made


def test_the_next_server_finds_them_on_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_memory = (
        collision_model._robot_part, brackets.brackets, sphere_set._spheres, pair_grid._values,
    )  # fmt: skip
    monkeypatch.setattr(kept_files, "_directory", None)  # as it was, afterwards
    monkeypatch.setattr(warm_requests, "_kept_solids", lambda: tmp_path)
    for cache in in_memory:
        cache.cache_clear()
    warm_requests._keep_apart("scara")
    files = {path.name for path in tmp_path.iterdir()}
    assert files

    def refuse(*_arguments: object) -> None:
        pytest.fail("they are computed once more")

    for cache in in_memory:
        cache.cache_clear()
    monkeypatch.setattr(sphere_set, "_sphere_rows", refuse)
    monkeypatch.setattr(pair_grid, "_values", refuse)
    warm_requests._keep_apart("scara")
    assert {path.name for path in tmp_path.iterdir()} == files
