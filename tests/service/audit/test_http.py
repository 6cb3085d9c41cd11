"""Second looks over HTTP: counted, and a dispute is a problem, never a plan."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import httpx
import pytest

from kinematics.errors import InvalidOption
from service.http import audit
from tests.service.conftest import Served
from tests.service.robots import HOME, answer, problem

GOAL = {"joints": [0.5, -0.6, 0.0, -2.2, 0.0, 1.571, 0.785]}
PLAN = {"robot": "panda", "start": {"joints": HOME}, "goal": GOAL, "keep": True}
FAULT = {"kind": "frame", "link": "panda_link5", "time": 0.5, "by": 1e-3}


@contextmanager
def set_in_state(served: Served, name: str, value: Any) -> Iterator[None]:
    """Another value in the state of the application for a while; `monkeypatch` would delete it."""
    before = getattr(served.app.state, name)
    setattr(served.app.state, name, value)
    try:
        yield
    finally:
        setattr(served.app.state, name, before)


@pytest.fixture(scope="module", autouse=True)
def _no_look_was_taken(served: Served) -> Iterator[None]:
    """The service looks as if it had just been started."""
    with set_in_state(served, "audit_account", audit.AuditAccount()):
        yield


def looks(client: httpx.Client, outcome: str) -> float:
    lines = client.get("/metrics").text.splitlines()
    start = f'armwright_audits_total{{outcome="{outcome}"}} '
    return sum(float(line.removeprefix(start)) for line in lines if line.startswith(start))


def test_the_first_kept_plan_is_looked_at(client: httpx.Client) -> None:
    before = looks(client, "agreed")
    answer(client.post("/v1/plan", json={**PLAN, "keep": False}))
    assert looks(client, "agreed") == before
    answer(client.post("/v1/plan", json=PLAN))
    assert looks(client, "agreed") == before + 1.0


def test_a_dispute_is_a_problem_with_a_bundle(
    client: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def disputed(*_: Any) -> Any:
        return [FAULT]

    monkeypatch.setattr(audit, "_look", disputed)
    monkeypatch.setattr(audit.AuditAccount, "earn", lambda *_: True)
    before = looks(client, "disputed")
    refused = client.post("/v1/plan", json=PLAN)
    told = problem(refused, 500, "CERTIFICATE_DISPUTED")
    assert told["details"]["disagreements"] == [FAULT]
    assert "panda_link5" in told["detail"]
    kept = answer(client.get(refused.headers["location"]))
    assert (kept["status"], kept["answer"]) == ("failed", None)
    bundle = answer(client.get(f"/v1/plans/{told['details']['plan_id']}/bundle"))
    assert bundle["status"] == "failed"
    assert looks(client, "disputed") == before + 1.0


def test_an_answer_stands_where_a_look_fails(
    client: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def fails(*_: Any) -> Any:
        raise InvalidOption("a form that is not read")

    monkeypatch.setattr(audit, "_look", fails)
    monkeypatch.setattr(audit.AuditAccount, "earn", lambda *_: True)
    before = looks(client, "left out")
    answer(client.post("/v1/plan", json=PLAN))
    assert looks(client, "left out") == before + 1.0


def test_no_look_is_taken_where_it_is_turned_off(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(audit, "_look", None)  # calling it would be an error
    monkeypatch.setattr(audit.AuditAccount, "earn", lambda *_: True)
    off = served.app.state.settings.model_copy(update={"audit": "off"})
    with set_in_state(served, "settings", off):
        answer(served.client.post("/v1/plan", json=PLAN))


def test_looks_take_a_share_of_the_time() -> None:
    account = audit.AuditAccount()
    spent = count = 0.0
    for _ in range(10_000):
        if account.earn(0.01):
            account.spend(0.03)
            spent, count = spent + 0.03, count + 1
    assert count >= 100
    assert spent <= 0.05 * 10_000 * 0.01 + 0.03
