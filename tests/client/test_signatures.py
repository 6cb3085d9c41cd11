"""Signatures: answers, options that are fields, names that shadow nothing, planners."""

import importlib
from collections.abc import AsyncIterator, Awaitable, Iterator
from inspect import signature
from typing import Any, get_args, get_origin, get_type_hints

import pytest

import armwright_client
from armwright_client import (
    AsyncClient,
    AsyncPending,
    BatchAnswer,
    Client,
    JobEvent,
    Pending,
    Plan,
)
from armwright_client.robots import robot as uploads
from armwright_wire.base import Body, Wire
from armwright_wire.plans.plan import PLANNERS as ALL
from armwright_wire.plans.plan import OmplPlanner
from planning.pipeline.path_search import PLANNERS
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
    assert (Client().robots.fk.__doc__ or "").startswith("Poses of the links")
    with Client() as client, pytest.raises(armwright_client.InvalidArgument):
        Client.plan(client, "panda", "nonsense", [0.0])


def test_names_shadow_nothing_usual() -> None:
    exported = {name for name in vars(armwright_client)["__all__"] if name[0].isupper()}
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


#: Fields of requests that methods take under another name, or choose by the method.
CHOSEN = {
    "GuardRequest": {"state", "scene_hash", "exact"},
    "ExportRequest": {"plan", "format"},
    "SimulateRequest": {"reference"},
    "ReachRequest": {"format"},
    "RetimeRequest": {"path"},
    "RobotFields": {"name"},
    "ArchiveFields": {"name"},
}
#: Options whose request has another name than theirs.
OTHERS = {"PotentialSettings": "PotentialRequest"} | {
    f"{name}Options": f"{name}Fields" for name in ("Robot", "Archive")
}


def requests(kind: type[Body] = Body) -> dict[str, type[Body]]:
    """Requests and their parts by name."""
    found = {kind.__name__: kind}
    for one in kind.__subclasses__():
        found |= requests(one)
    return found


def options() -> dict[type, set[str]]:
    """Options of requests, with the other parameters of the methods that take them."""
    client = Client("http://robots")
    found: dict[type, set[str]] = {}
    for group in (client, client.robots):
        for name in dir(group):
            method = getattr(group, name)
            if name.startswith("_") or not callable(method):
                continue
            others = signature(method).parameters
            for parameter in others.values():
                if parameter.kind == parameter.VAR_KEYWORD:
                    (one,) = get_args(parameter.annotation)
                    found.setdefault(get_origin(one) or one, set()).update(others)
    return found | {one: set() for one in (uploads.RobotOptions, uploads.ArchiveOptions)}


def test_options_are_the_fields_of_a_request() -> None:
    known = requests()
    compared: set[str] = set()
    for one, parameters in options().items():
        name = OTHERS.get(one.__name__, one.__name__.replace("Options", "Request"))
        if name not in known:
            continue  # options of several requests, or of a part of one
        fields, taken = set(known[name].model_fields), set(get_type_hints(one))
        assert taken <= fields, name
        assert fields - taken <= parameters | CHOSEN.get(name, set()), name
        compared.add(name)
    assert len(compared) == 25


def test_names_in_python_are_those_that_type_checkers_see() -> None:
    """An `alias` is the parameter's name to them, and `from` can't be one."""
    kinds: list[type[Wire]] = [Wire]
    for kind in kinds:
        kinds += kind.__subclasses__()
        assert not [name for name, field in kind.model_fields.items() if field.alias], kind
    stretch = armwright_client.LimitsAt(begin=0.0, end=1.5, tool_speed=0.1)
    assert stretch.to_json() == '{"from":0.0,"to":1.5,"tool_speed":0.1}'
    assert armwright_client.LimitsAt.model_validate_json(stretch.to_json()) == stretch
