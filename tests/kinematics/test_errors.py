"""The error tree: what the service and the client may rely on."""

import pickle

import pytest

from kinematics import errors
from kinematics.errors import ArmwrightError, InvalidLinkName, MissingLimit

#: The codes of the HTTP contract, by class.
CODES = {
    "ArmwrightError": "INVALID_REQUEST",
    "InvalidRobotDescription": "INVALID_ROBOT_DESCRIPTION",
    "InvalidScene": "INVALID_SCENE",
    "InvalidPose": "INVALID_GOAL_CONSTRAINTS",
    "InvalidRobotState": "INVALID_ROBOT_STATE",
    "InvalidLinkName": "INVALID_LINK_NAME",
    "InvalidObjectName": "INVALID_OBJECT_NAME",
    "MissingLimit": "MISSING_LIMIT",
    "MissingInertia": "MISSING_INERTIA",
    "InvalidTrajectory": "INVALID_MOTION_PLAN",
    "InvalidGoal": "INVALID_GOAL_CONSTRAINTS",
    "InvalidOption": "VALIDATION_ERROR",
    "InvalidNumbers": "VALIDATION_ERROR",
    "NotAvailable": "VALIDATION_ERROR",
}


def classes() -> dict[str, type[ArmwrightError]]:
    """Every error class of the module by its name."""
    found = (value for value in vars(errors).values() if isinstance(value, type))
    return {item.__name__: item for item in found if issubclass(item, ArmwrightError)}


def test_every_class_has_the_code_of_the_contract() -> None:
    assert {name: item.code for name, item in classes().items()} == CODES


@pytest.mark.parametrize("name", CODES)
def test_one_handler_of_the_base_class_catches_every_error(name: str) -> None:
    with pytest.raises(ArmwrightError) as caught:
        raise classes()[name]("it is wrong", hint="do this", joint="elbow", limit=1.5)
    error = caught.value
    assert (error.message, error.hint) == ("it is wrong", "do this")
    assert str(error) == "it is wrong. do this"
    assert dict(error.details) == {"joint": "elbow", "limit": 1.5}


def test_hint_and_details_may_be_left_out() -> None:
    error = InvalidLinkName("there is none")
    assert error.hint is None
    assert dict(error.details) == {}


def test_details_cannot_be_changed_by_a_handler() -> None:
    error = MissingLimit("no jerk limit", joints=["elbow"])
    with pytest.raises(TypeError):
        error.details["joints"] = []  # type: ignore[index]


def test_errors_of_programming_are_not_faults_of_the_caller() -> None:
    assert not issubclass(ArmwrightError, ValueError | TypeError | KeyError | RuntimeError)
    assert not issubclass(AssertionError, ArmwrightError)


@pytest.mark.parametrize("name", CODES)
def test_errors_come_back_whole_from_another_process(name: str) -> None:
    error = classes()[name]("it is wrong", hint="do this", joint="elbow")
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error)
    assert (str(again), again.message, again.hint) == (str(error), error.message, error.hint)
    assert dict(again.details) == dict(error.details)
