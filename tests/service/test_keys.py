"""A service with API keys: who is answered what, and who sees whose things."""

import contextlib
import io
import subprocess
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import httpx
import pytest
from fastapi import FastAPI
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from armwright_client import Guard
from service.access.authentication import Authenticator
from service.app import create_app
from service.cli import main
from service.keys_command import make_first_key
from service.settings import Settings
from service.storage.store import open_store
from service.validation import ProblemError
from service.workers.state import QueueFull
from service.workers.supervisor import WorkerSupervisor
from tests.service.commands import start_command
from tests.service.processes import wait_until
from tests.service.robots import DETOUR, HOME, answer, bench, problem
from tests.service.server import serving

CHECK = {"robot": "panda", "scene": {"obstacles": []}, "joints": HOME}
FK = {"joints": HOME}
SCENE = {"name": "table", "obstacles": []}
Make = Callable[..., str]


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("keys")


@pytest.fixture(scope="module")
def first(data: Path) -> str:
    """A key that is there before the service starts."""
    return command(data, "create", "--name", "first", "--scope", "admin").strip()


@pytest.fixture(scope="module")
def app(data: Path, first: str) -> FastAPI:
    assert first, "made before the application"
    return create_app(Settings(data_dir=data, workers=1))


@pytest.fixture(scope="module")
def service(app: FastAPI) -> Iterator[httpx.Client]:
    with serving(app) as client:
        yield client


@pytest.fixture
def make(data: Path, service: httpx.Client) -> Make:
    def new_key(*options: str) -> str:
        return command(data, "create", "--name", "test", *options).strip()

    return new_key


def command(data: Path, *arguments: str) -> str:
    """What ``armwright keys`` says."""
    with contextlib.redirect_stdout(io.StringIO()) as said:
        assert main(["keys", *arguments, "--data-dir", str(data)]) == 0
    return said.getvalue()


def bearer(key: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {key}"}


def is_refused(service: httpx.Client, key: str) -> bool:
    return service.get("/v1/jobs", headers=bearer(key)).status_code == 401


def test_nobody_is_answered_without_a_key(service: httpx.Client, first: str) -> None:
    for method, path in (("GET", "/v1/robots"), ("POST", "/v1/plan"), ("GET", "/metrics")):
        refused = service.request(method, path, json={} if method == "POST" else None)
        problem(refused, 401, "UNAUTHENTICATED")
        assert refused.headers["www-authenticate"] == 'Bearer realm="armwright"'
    wrong = first[:-1] + ("0" if first[-1] != "0" else "1")
    unknown = "aw_000000000000_" + "0" * 64
    for key in ("nonsense", wrong, unknown, first.upper()):
        refused = service.get("/v1/robots", headers=bearer(key))
        problem(refused, 401, "UNAUTHENTICATED")
        assert 'error="invalid_token"' in refused.headers["www-authenticate"]
        assert first not in refused.text
    for headers in (bearer(first), {"X-API-Key": first}, {"Authorization": f"bearer {first}"}):
        answer(service.get("/v1/robots", headers=headers))


def test_pages_and_health_are_for_everybody(service: httpx.Client) -> None:
    for path in ("/", "/docs", "/openapi.json", "/healthz", "/readyz", "/v1/problems"):
        assert service.get(path).status_code == 200, path


def test_a_scope_allows_what_it_says(service: httpx.Client, make: Make) -> None:
    read, plan, admin = (make("--scope", scope) for scope in ("read", "plan", "admin"))
    for key in (read, plan, admin):
        answer(service.get("/v1/robots/panda", headers=bearer(key)))
    refused = service.post("/v1/robots/panda/fk", json=FK, headers=bearer(read))
    assert problem(refused, 403, "FORBIDDEN")["details"] == {"needed": "plan", "scope": "read"}
    assert 'error="insufficient_scope", scope="plan"' in refused.headers["www-authenticate"]
    for key in (plan, admin):
        answer(service.post("/v1/robots/panda/fk", json=FK, headers=bearer(key)))
    scene = {"name": "of-admin", "obstacles": []}
    problem(service.post("/v1/scenes", json=scene, headers=bearer(plan)), 403, "FORBIDDEN")
    answer(service.post("/v1/scenes", json=scene, headers=bearer(admin)), 201)
    problem(service.delete("/v1/scenes/of-admin", headers=bearer(plan)), 403, "FORBIDDEN")
    problem(service.get("/metrics", headers=bearer(plan)), 403, "FORBIDDEN")
    assert service.get("/metrics", headers=bearer(admin)).status_code == 200
    assert service.delete("/v1/scenes/of-admin", headers=bearer(admin)).status_code == 204


def test_metrics_of_a_tenant_are_its_own_jobs(service: httpx.Client, make: Make) -> None:
    whole = service.get("/metrics", headers=bearer(make("--scope", "admin"))).text
    own = bearer(make("--scope", "admin", "--tenant", "elsewhere"))
    told = service.get("/metrics", headers=own).text
    assert "armwright_requests_total" in whole
    assert {line.split("{")[0] for line in told.splitlines() if not line.startswith("#")} == {
        "armwright_jobs"
    }
    assert 'armwright_jobs{status="succeeded"} 0.0' in told


def test_tenants_do_not_see_each_other(service: httpx.Client, make: Make) -> None:
    one, other = (
        bearer(make("--scope", "admin", "--tenant", tenant)) for tenant in ("one", "other")
    )
    answer(service.post("/v1/robots", json=bench("arm"), headers=one), 201)
    answer(service.post("/v1/scenes", json=SCENE, headers=one), 201)
    later = one | {"Prefer": "respond-async", "Idempotency-Key": "same"}
    job = answer(service.post("/v1/check", json=CHECK, headers=later), 202)["id"]
    for path in ("/v1/robots/arm", "/v1/scenes/table", f"/v1/jobs/{job}", f"/v1/jobs/{job}/events"):
        problem(service.get(path, headers=other), 404, "NOT_FOUND")
        assert service.get(path, headers=one).status_code == 200, path
    for path in ("/v1/robots/arm", "/v1/scenes/table", f"/v1/jobs/{job}"):
        problem(service.delete(path, headers=other), 404, "NOT_FOUND")
    named = {"robot": "arm", "scene": "table", "joints": [0.0, 0.0]}
    problem(service.post("/v1/check", json=named, headers=other), 404, "NOT_FOUND")
    answer(service.post("/v1/check", json=named, headers=one))
    assert "arm" not in service.get("/v1/robots", headers=other).text
    assert answer(service.get("/v1/scenes", headers=other))["scenes"] == []
    assert answer(service.get("/v1/jobs", headers=other))["jobs"] == []
    assert [item["id"] for item in answer(service.get("/v1/jobs", headers=one))["jobs"]] == [job]
    # The same names and idempotency keys are free for another tenant.
    answer(service.post("/v1/scenes", json=SCENE, headers=other), 201)
    theirs = other | {"Prefer": "respond-async", "Idempotency-Key": "same"}
    assert answer(service.post("/v1/check", json=CHECK, headers=theirs), 202)["id"] != job
    # A job finds what belongs to its tenant.
    background = one | {"Prefer": "respond-async"}
    job = answer(service.post("/v1/check", json=named, headers=background), 202)["id"]
    url = f"/v1/jobs/{job}"
    assert wait_until(lambda: bool(service.get(url, headers=one).json()["ended"]), 10.0)
    assert service.get(url, headers=one).json()["status"] == "succeeded"


def test_a_wrong_secret_takes_nothing_from_the_rate_of_a_key(
    service: httpx.Client, make: Make
) -> None:
    key = make("--rate", "2")
    wrong = key[:-1] + ("0" if key[-1] != "0" else "1")
    for _ in range(5):
        problem(service.get("/v1/jobs", headers=bearer(wrong)), 401, "UNAUTHENTICATED")
    for _ in range(2):
        answer(service.get("/v1/jobs", headers=bearer(key)))
    problem(service.get("/v1/jobs", headers=bearer(key)), 429, "OVERLOADED")


def test_who_has_no_key_is_told_so_whatever_the_load(
    app: FastAPI, service: httpx.Client, first: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And is no work that others wait behind."""
    body = {"robot": "panda", "joints": HOME}
    answer(service.post("/v1/check", json=body, headers=bearer(first)))
    asked = []

    def refuse(*what: object) -> QueueFull:
        asked.append(what)
        return QueueFull(3, 7, 100.0)

    supervisor: WorkerSupervisor = app.state.supervisor
    monkeypatch.setattr(supervisor, "early_refusal", refuse)
    monkeypatch.setattr(WorkerSupervisor, "is_free", False)
    problem(service.post("/v1/check", json=body), 401, "UNAUTHENTICATED")
    assert asked == []
    refused = service.post("/v1/check", json=body, headers=bearer(first))
    problem(refused, 429, "OVERLOADED")
    assert refused.headers["retry-after"] == "7"
    assert len(asked) == 1


def test_a_key_has_a_rate(service: httpx.Client, make: Make) -> None:
    headers = bearer(make("--rate", "3"))
    for remaining in (2, 1, 0):
        response = service.get("/v1/robots/panda", headers=headers)
        assert response.status_code == 200
        assert response.headers["ratelimit-limit"] == "3"
        assert response.headers["ratelimit-remaining"] == str(remaining)
        assert 0 < int(response.headers["ratelimit-reset"]) <= 60
    refused = service.get("/v1/robots/panda", headers=headers)
    assert "3 requests a minute" in problem(refused, 429, "OVERLOADED")["detail"]
    assert 0 < int(refused.headers["retry-after"]) <= 20
    assert refused.headers["ratelimit-remaining"] == "0"


def test_a_key_bounds_jobs_and_storage(service: httpx.Client, make: Make) -> None:
    key = make("--scope", "admin", "--tenant", "bounded", "--jobs", "1", "--storage", "100")
    headers = bearer(key)
    answer(service.post("/v1/scenes", json=SCENE, headers=headers), 201)
    shape = {"type": "sphere", "radius": 0.1}
    obstacles = [
        {"id": f"ball {n}", "shape": shape, "pose": {"position": [2, 2, 2]}} for n in (1, 2)
    ]
    large = {"name": "large", "obstacles": obstacles}
    problem(service.post("/v1/scenes", json=large, headers=headers), 403, "QUOTA_EXCEEDED")
    problem(service.get("/v1/scenes/large", headers=headers), 404, "NOT_FOUND")
    batch = {"problems": [DETOUR] * 50}
    answer(service.post("/v1/plan/batch", json=batch, headers=headers), 202)
    refused = service.post("/v1/plan/batch", json=batch, headers=headers)
    assert "1 jobs are waiting or running" in problem(refused, 429, "OVERLOADED")["detail"]


def test_a_key_ends(data: Path, service: httpx.Client, make: Make) -> None:
    key, short = make(), make("--days", "0.00001")
    answer(service.get("/v1/jobs", headers=bearer(key)))
    key_id = key.split("_")[1]
    command(data, "revoke", key_id)
    for shown in (key, short):
        assert wait_until(partial(is_refused, service, shown), 3.0), "within two seconds"
    listed = command(data, "list")
    (line,) = [line for line in listed.splitlines() if line.startswith(key_id)]
    assert line.split("\t")[4] == "revoked"
    assert key.split("_")[2] not in listed, "a secret is shown once"
    arguments = ["keys", "revoke", key_id, "--data-dir", str(data)]
    with start_command(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as again:
        said, errors = again.communicate()
    assert (again.returncode, said) == (1, "")
    assert "not revoked" in errors


def test_the_secret_is_nowhere_in_the_data_folder(data: Path, first: str) -> None:
    key_id, secret = first.split("_")[1:]
    # Not by this process: to close a file of SQLite's ends the locks that the service has on it.
    for text, status in ((key_id, 0), (secret, 1)):
        assert subprocess.run(["grep", "-rqa", text, str(data)], check=False).returncode == status


def test_changes_are_in_the_audit_log(data: Path, service: httpx.Client, first: str) -> None:
    scene = {"name": "audited", "obstacles": []}
    answer(service.post("/v1/scenes", json=scene, headers=bearer(first)), 201)
    arguments = ["audit", "--limit", "1", "--data-dir", str(data)]
    with start_command(arguments, stdout=subprocess.PIPE) as shown:
        said, _ = shown.communicate()
    assert shown.returncode == 0
    _, tenant, key, action, target = said.strip().split("\t")
    assert (tenant, key) == ("default", first.split("_")[1])
    assert (action, target) == ("create", "scene audited")


@pytest.mark.parametrize("given", [True, False])
def test_a_service_that_others_reach_makes_its_first_key(tmp_path: Path, given: bool) -> None:
    chosen = f"aw_{12 * 'a'}_{64 * 'b'}"
    settings = Settings(data_dir=tmp_path, first_key=chosen if given else None)
    store = open_store(settings.storage_url)
    assert make_first_key(store, Settings(data_dir=tmp_path), is_needed=False) is None
    said = make_first_key(store, settings, is_needed=not given)
    assert said is not None
    assert said.startswith("There was no API key")
    assert make_first_key(store, settings, is_needed=True) is None  # there is one
    key = chosen
    if not given:
        file = tmp_path / "first_key"
        assert file.stat().st_mode & 0o777 == 0o600
        key = file.read_text().strip()
    assert key not in said
    (row,) = command(tmp_path, "list").splitlines()
    assert row.split("\t")[:5] == [key.split("_")[1], "first", "default", "admin", "valid"]
    caller, _ = Authenticator(store.keys).authenticate({"x-api-key": key})
    assert caller.scope == "admin"
    with pytest.raises(ProblemError):
        Authenticator(store.keys).authenticate({})
    store.close()


def test_servers_that_start_together_make_one_first_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both have seen that there is none, and both have the key of one secret."""
    settings = Settings(data_dir=tmp_path, first_key=f"aw_{12 * 'a'}_{64 * 'b'}")
    store = open_store(settings.storage_url)
    monkeypatch.setattr(type(store.keys), "are_there_any", lambda _: False)
    assert make_first_key(store, settings, is_needed=True) is not None
    assert make_first_key(store, settings, is_needed=True) is None
    assert [key.name for key in store.keys.list()] == ["first"]
    store.close()


@pytest.mark.parametrize("with_key", [True, False])
def test_with_a_key_or_when_told_it_listens_beyond_this_machine(
    tmp_path: Path, with_key: bool
) -> None:
    if with_key:
        command(tmp_path, "create", "--name", "x")
    options = [] if with_key else ["--insecure"]
    arguments = ["serve", "--host", "0.0.0.0", "--port", "0", "--data-dir", str(tmp_path)]
    process = start_command(
        [*arguments, *options], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    )
    assert process.stdout is not None
    assert "serves on http://0.0.0.0:" in process.stdout.readline()
    process.kill()
    process.communicate()


def test_a_session_of_the_gate_needs_a_key_that_may_plan(service: httpx.Client, make: Make) -> None:
    url = f"{str(service.base_url).rstrip('/').replace('http', 'ws')}/v1/guard"
    for key, status in ((None, 401), ("aw_none", 401), (make("--scope", "read"), 403)):
        headers = {} if key is None else {"Authorization": f"Bearer {key}"}
        with pytest.raises(InvalidStatus) as refused:
            connect(url, additional_headers=headers)
        assert refused.value.response.status_code == status
    with Guard("panda", str(service.base_url), token=make("--scope", "plan")) as guard:
        assert guard.ready.stop == "none"
