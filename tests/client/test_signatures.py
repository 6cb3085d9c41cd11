"""Signatures: answers, options that are fields, names that shadow nothing, planners."""

import importlib
from collections.abc import AsyncIterator, Awaitable, Iterator
from inspect import signature
from typing import Any, get_args, get_type_hints

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
    public_names,
)
from armwright_client.options import arm_options, plan_options
from armwright_client.robots import robot as uploads
from armwright_wire.base import Body
from armwright_wire.motions import excitation, export, simulation
from armwright_wire.plans import guard, plan, task, tour
from armwright_wire.plans.plan import PLANNERS as ALL
from armwright_wire.plans.plan import OmplPlanner
from armwright_wire.robots import (
    calibration,
    dynamics,
    identification,
    kinematics,
    lyapunov,
    potential,
    reach,
    robot,
)
from armwright_wire.scenes import check
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
    exported = {name for name in vars(public_names) if name[0].isupper()}
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


#: Options, their request, and fields that methods take by themselves.
OPTIONS: list[tuple[type, type[Body], set[str]]] = [
    (plan_options.CheckOptions, check.CheckRequest, {"robot", "joints"}),
    (plan_options.PlanOptions, plan.PlanRequest, {"robot", "start", "goal"}),
    (plan_options.ValidateOptions, plan.ValidateRequest, {"robot", "trajectory"}),
    (
        plan_options.GuardOptions,
        guard.GuardRequest,
        {"robot", "state", "proposal", "latency", "scene_hash", "exact"},
    ),
    (plan_options.ExportOptions, export.ExportRequest, {"robot", "trajectory", "plan", "format"}),
    (
        plan_options.SimulateOptions,
        simulation.SimulateRequest,
        {"robot", "trajectory", "reference", "controller"},
    ),
    (plan_options.TaskOptions, task.TaskRequest, {"robot", "start", "stages"}),
    (plan_options.LyapunovOptions, lyapunov.LyapunovRequest, {"A", "P", "Q", "x"}),
    (plan_options.TourOptions, tour.TourRequest, {"robot", "goals"}),
    (arm_options.FkOptions, kinematics.FkRequest, {"joints"}),
    (arm_options.JacobianOptions, kinematics.JacobianRequest, {"joints"}),
    (arm_options.IkOptions, kinematics.IkRequest, {"pose", "poses"}),
    (arm_options.VelocityOptions, kinematics.VelocityRequest, {"joints"}),
    (arm_options.DynamicsOptions, dynamics.DynamicsRequest, {"joints"}),
    (arm_options.ForwardDynamicsOptions, dynamics.ForwardDynamicsRequest, {"joints"}),
    (arm_options.WrenchOptions, dynamics.WrenchRequest, {"joints", "wrench", "torques"}),
    (
        arm_options.RegressorOptions,
        dynamics.RegressorRequest,
        {"joints", "velocities", "accelerations"},
    ),
    (
        arm_options.PotentialSettings,
        potential.PotentialRequest,
        {"joints", "goal_joints", "scene"},
    ),
    (arm_options.ReachOptions, reach.ReachRequest, {"poses", "box", "format"}),
    (arm_options.IdentifyOptions, identification.IdentifyRequest, {"logs"}),
    (arm_options.ExcitationOptions, excitation.ExcitationRequest, set()),
    (arm_options.CalibrateOptions, calibration.CalibrateRequest, {"joints"}),
    (uploads.RobotOptions, robot.RobotFields, {"name"}),
    (uploads.ArchiveOptions, robot.ArchiveFields, {"name"}),
]


@pytest.mark.parametrize(("options", "request_", "own"), OPTIONS)
def test_options_are_the_fields_of_a_request(
    options: type, request_: type[Body], own: set[str]
) -> None:
    assert set(get_type_hints(options)) | own == set(request_.model_fields)
