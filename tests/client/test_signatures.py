"""Signatures: what comes back, names that shadow nothing, planners that type checkers know."""

import importlib
from collections.abc import AsyncIterator, Awaitable, Iterator
from inspect import signature
from typing import Any, get_args

import pytest

import armwright_client
from armwright_client import AsyncClient, AsyncPending, BatchAnswer, Client, JobEvent, Pending, Plan
from armwright_wire.plans.plan import PLANNERS as ALL
from armwright_wire.plans.plan import OmplPlanner
from planning.pipeline.planners import PLANNERS
from tests.client.scripted import Scripted, problem

#: Modules whose names people import one by one.
USUAL = ("builtins", "pathlib", "typing", "dataclasses", "collections", "asyncio", "enum", "json")


def answer_of(method: Any) -> Any:
    return signature(method).return_annotation


def test_signatures_show_the_answer_and_not_the_call() -> None:
    with Client() as client:
        assert answer_of(client.plan) is Plan
        assert answer_of(client.later.plan) == Pending[Plan]
        assert answer_of(client.plan_batch) == Pending[BatchAnswer]
        assert answer_of(client.jobs.events) == Iterator[JobEvent]
        assert list(signature(client.plan).parameters)[:3] == ["robot", "start", "goal"]
    many = AsyncClient()
    assert answer_of(many.plan) == Awaitable[Plan]
    assert answer_of(many.later.plan) == Awaitable[AsyncPending[Plan]]
    assert answer_of(many.jobs.events) == AsyncIterator[JobEvent]


def test_methods_can_be_looked_at_and_called_on_the_class() -> None:
    assert answer_of(Client.plan) is Plan
    assert next(iter(signature(Client.plan).parameters)) == "self"
    assert Client.plan.__doc__ == Client().plan.__doc__
    with Client() as client, pytest.raises(armwright_client.InvalidArgument):
        Client.plan(client, "panda", "nonsense", [0.0])


def test_names_shadow_nothing_usual() -> None:
    exported = {name for name in vars(armwright_client) if name[0].isupper()}
    for name in USUAL:
        module = importlib.import_module(name)
        public = getattr(module, "__all__", [one for one in dir(module) if one[0] != "_"])
        assert not set(public) & exported, name


def test_type_checkers_know_all_planners() -> None:
    assert set(ALL) == set(PLANNERS)
    ompl = set(get_args(OmplPlanner))
    assert {"RRTConnect", "PRM"} <= ompl
    assert all(name[0].isupper() for name in ompl)


def test_a_misspelt_planner_is_found_before_it_runs() -> None:
    # Checking the types holds this: an ignored fault that is none is a fault itself.
    transport = Scripted([problem(422, "INVALID_REQUEST")])
    with Client("http://robots", transport=transport) as client:
        with pytest.raises(armwright_client.InvalidRequest):
            client.plan("panda", [0.0], [1.0], planner="rrt_conect")  # type: ignore[arg-type]
        with pytest.raises(armwright_client.InvalidArgument, match="planer"):
            client.plan("panda", [0.0], [1.0], planer="rrt")  # type: ignore[call-arg]
    assert len(transport.requests) == 1
