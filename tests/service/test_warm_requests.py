"""Requests of our own before those of others: what they leave for workers."""

from kinematics.robots import builtin_names
from obstacles.checker import Checker
from obstacles.collision_model import _robot_part
from obstacles.scene import Scene
from service import warm_requests
from service.storage import worker_cache
from service.storage.cache_key import builtin_reference


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
