"""API keys as callers show them, scopes that requests need, and rates of requests."""

import hashlib

import pytest

from service.access import authentication
from service.access.authentication import needed_scope
from service.access.rate_limit import WINDOW, RateLimiter
from service.app import create_app
from service.settings import Settings


def test_a_key_has_256_random_bits_and_is_read_back() -> None:
    made = [authentication.new_credentials() for _ in range(100)]
    assert len({credentials.secret for credentials in made}) == 100
    assert len({credentials.id for credentials in made}) == 100
    for credentials in made:
        assert len(bytes.fromhex(credentials.secret)) == 32
        assert authentication.parse(str(credentials)) == credentials
        assert str(credentials) == f"aw_{credentials.id}_{credentials.secret}"


@pytest.mark.parametrize(
    "text",
    ["", "aw__", "aw_0123456789ab_", "aw_0123456789ab_" + "0" * 63, "aw_0123456789ab_" + "0" * 65,
     "AW_0123456789ab_" + "0" * 64, "aw_0123456789AB_" + "0" * 64, "aw_0123456789ab_" + "g" * 64,
     "aw_0123456789ab_" + "0" * 64 + "\n", " aw_0123456789ab_" + "0" * 64],
)  # fmt: skip
def test_another_form_is_no_key(text: str) -> None:
    assert authentication.parse(text) is None


def test_only_the_digest_fits() -> None:
    made = authentication.new_credentials()
    stored = authentication.digest(made.secret)
    assert stored == hashlib.sha256(made.secret.encode("ascii")).hexdigest()
    assert authentication.fits(made.secret, stored)
    assert not authentication.fits(authentication.new_credentials().secret, stored)
    assert made.secret not in stored


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


class Clock:
    """A clock that is set by hand."""

    def __init__(self) -> None:
        self.time = 1000.0

    def __call__(self) -> float:
        return self.time


def test_as_many_come_at_once_as_the_rate_and_then_one_a_share_of_the_window() -> None:
    clock = Clock()
    limiter = RateLimiter(clock)
    taken = [limiter.take("a", 3) for _ in range(4)]
    assert [allowance.granted for allowance in taken] == [True, True, True, False]
    assert [allowance.remaining for allowance in taken] == [2, 1, 0, 0]
    assert [allowance.reset for allowance in taken] == [20, 40, 60, 60]
    assert taken[3].retry_after == 20
    clock.time += 19.9
    assert not limiter.take("a", 3).granted
    clock.time += 0.2
    assert limiter.take("a", 3).granted
    assert not limiter.take("a", 3).granted


def test_keys_have_buckets_of_their_own() -> None:
    limiter = RateLimiter(Clock())
    assert limiter.take("a", 1).granted
    assert not limiter.take("a", 1).granted
    assert limiter.take("b", 1).granted


@pytest.mark.parametrize("rate", [1, 7, 60, 1000])
def test_in_the_long_run_the_rate_is_kept(rate: int) -> None:
    clock = Clock()
    limiter = RateLimiter(clock)
    granted = 0
    step = WINDOW / rate / 7.3
    for _ in range(int(5 * WINDOW / step)):
        granted += limiter.take("a", rate).granted
        clock.time += step
    assert abs(granted - 6 * rate) <= 1, "a full bucket, and five windows"


def test_retry_after_is_true() -> None:
    clock = Clock()
    limiter = RateLimiter(clock)
    while (allowance := limiter.take("a", 7)).granted:
        clock.time += 0.1
    clock.time += allowance.retry_after
    assert limiter.take("a", 7).granted


def test_full_buckets_are_forgotten() -> None:
    clock = Clock()
    limiter = RateLimiter(clock)
    for number in range(50):
        limiter.take(f"{number}", 10)
    clock.time += WINDOW + 1.0
    limiter.take("a", 10)
    assert set(limiter._buckets) == {"a"}
