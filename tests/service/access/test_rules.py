"""Scopes that requests need, of every route that there is."""

import pytest

from service.access.caller import needed_scope
from service.app import create_app
from service.settings import Settings


def scope(method: str, path: str, *, health: bool = True, metrics: bool = False) -> str | None:
    return needed_scope(method, path, public_health=health, public_metrics=metrics)


@pytest.mark.parametrize(
    ("method", "path", "needed"),
    [
        ("GET", "/", None), ("GET", "/docs", None), ("GET", "/docs/start.js", None),
        ("GET", "/openapi.json", None), ("GET", "/v1/problems", None), ("GET", "/healthz", None),
        ("GET", "/v1/problems/CRASH", None), ("GET", "/readyz", None),
        ("OPTIONS", "/v1/plan", None), ("GET", "/metrics", "admin"),
        ("GET", "/v1/robots", "read"), ("GET", "/v1/robots/a", "read"),
        ("GET", "/v1/robots/a/urdf", "read"), ("HEAD", "/v1/scenes", "read"),
        ("GET", "/v1/jobs", "read"), ("GET", "/v1/jobs/0/events", "read"),
        ("GET", "/nowhere", "read"), ("GET", "/docsx", "read"), ("GET", "/v1/problemsx", "read"),
        ("POST", "/v1/plan", "plan"), ("POST", "/v1/robots/a/fk", "plan"),
        ("POST", "/v1/scenes/a/project", "plan"), ("DELETE", "/v1/jobs/0", "plan"),
        ("POST", "/v1/robots", "admin"), ("DELETE", "/v1/robots/a", "admin"),
        ("PUT", "/v1/scenes/a", "admin"), ("POST", "/v1/scenes", "admin"),
        ("PATCH", "/v1/robots/a", "admin"), ("DELETE", "/v1/scenes/a", "admin"),
        ("POST", "/", None), ("POST", "/nowhere", "plan"),
    ],
)  # fmt: skip
def test_a_request_needs_a_scope(method: str, path: str, needed: str | None) -> None:
    assert scope(method, path) == needed


def test_health_and_metrics_have_switches_of_their_own() -> None:
    assert scope("GET", "/healthz", health=False) == "read"
    assert scope("GET", "/readyz", health=False) == "read"
    assert scope("GET", "/metrics", metrics=True) is None
    assert scope("GET", "/metrics", health=False, metrics=False) == "admin"


def test_every_route_under_v1_but_the_problems_needs_a_key() -> None:
    paths = create_app(Settings()).openapi()["paths"]
    asked = {(method.upper(), path) for path, methods in paths.items() for method in methods}
    assert len(asked) > 30
    for method, path in asked:
        needed = scope(method, path.replace("{name}", "a").replace("{id}", "a"))
        if path.startswith("/v1/") and not path.startswith("/v1/problems"):
            assert needed is not None, (method, path)
        if method != "GET":
            assert needed in ("plan", "admin"), (method, path)
