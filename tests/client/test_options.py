"""Options of methods: fields of the requests that they make."""

from typing import get_type_hints

import pytest

from armwright_client.options import arm_options, plan_options
from armwright_client.robots import robot as uploads
from armwright_wire.base import Body
from armwright_wire.motions import export, simulation
from armwright_wire.plans import plan, task, tour
from armwright_wire.robots import dynamics, kinematics, potential, reach, robot
from armwright_wire.scenes import check

#: Options, their request, and fields that methods take by themselves.
OPTIONS: list[tuple[type, type[Body], set[str]]] = [
    (plan_options.CheckOptions, check.CheckRequest, {"robot", "joints"}),
    (plan_options.PlanOptions, plan.PlanRequest, {"robot", "start", "goal"}),
    (plan_options.ValidateOptions, plan.ValidateRequest, {"robot", "trajectory"}),
    (plan_options.ExportOptions, export.ExportRequest, {"robot", "trajectory", "format"}),
    (
        plan_options.SimulateOptions,
        simulation.SimulateRequest,
        {"robot", "trajectory", "reference", "controller"},
    ),
    (plan_options.TaskOptions, task.TaskRequest, {"robot", "start", "stages"}),
    (plan_options.TourOptions, tour.TourRequest, {"robot", "goals"}),
    (arm_options.FkOptions, kinematics.FkRequest, {"joints"}),
    (arm_options.JacobianOptions, kinematics.JacobianRequest, {"joints"}),
    (arm_options.IkOptions, kinematics.IkRequest, {"pose", "poses"}),
    (arm_options.VelocityOptions, kinematics.VelocityRequest, {"joints"}),
    (arm_options.DynamicsOptions, dynamics.DynamicsRequest, {"joints"}),
    (arm_options.ForwardDynamicsOptions, dynamics.ForwardDynamicsRequest, {"joints"}),
    (arm_options.WrenchOptions, dynamics.WrenchRequest, {"joints", "wrench"}),
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
    (uploads.RobotOptions, robot.RobotFields, {"name"}),
    (uploads.ArchiveOptions, robot.ArchiveFields, {"name"}),
]


@pytest.mark.parametrize(("options", "request_", "own"), OPTIONS)
def test_options_are_the_fields_of_a_request(
    options: type, request_: type[Body], own: set[str]
) -> None:
    assert set(get_type_hints(options)) | own == set(request_.model_fields)
