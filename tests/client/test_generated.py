"""A client that openapi-python-client generates: no warnings; it plans, and reads problems."""

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

PACKAGE = "armwright_api_client"
START = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
GOAL = [1.2, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785]


@pytest.fixture(scope="module")
def generated(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The folder of the generated package, which can be imported meanwhile."""
    # Here, since every process collects all tests, and one generates.
    from scripts import generated_clients

    assert generated_clients.PACKAGE == PACKAGE
    folder = tmp_path_factory.mktemp("generated")
    document = generated_clients.write_document(folder)
    assert generated_clients.generate_python(document, folder) == []
    sys.path.insert(0, str(folder))
    yield folder / PACKAGE
    sys.path.remove(str(folder))


def part(name: str) -> Any:
    return importlib.import_module(f"{PACKAGE}.{name}")


@pytest.fixture
def client(generated: Path, url: str) -> Iterator[Any]:
    with part("client").Client(base_url=url) as opened:
        yield opened


def test_it_has_a_function_for_each_operation_and_a_name_of_its_own(generated: Path) -> None:
    functions = {path.stem for path in (generated / "api").rglob("*.py")} - {"__init__"}
    assert {"plan", "ik", "create_robot", "job_events", "get_urdf"} <= functions
    assert generated.name != "armwright_client"


def test_models_keep_all_fields_beside_a_rule(generated: Path) -> None:
    models = part("models")
    assert {"joints", "state", "pose", "any_of"} <= set(models.Goal.__annotations__)
    assert {"obstacles", "moveit", "frame"} <= set(models.Scene.__annotations__)


def test_it_plans(client: Any) -> None:
    models = part("models")
    body = models.PlanRequest(
        robot="panda",
        start=models.Start(joints=START),
        goal=models.Goal(joints=GOAL),
        scene=models.Scene(
            obstacles=[
                models.Obstacle(
                    id="ball",
                    shape=models.Sphere(type_="sphere", radius=0.1),
                    pose=models.FramedPose(position=[0.0, 0.0, 1.5]),
                )
            ]
        ),
    )
    answer = part("api.planning.plan").sync(client=client, body=body)
    assert isinstance(answer, models.PlanAnswer)
    assert answer.certificate.verified
    assert answer.trajectory.segments[0].coefficients[0][0] == START[0]
    assert answer.certificate.min_clearance > 0.0


def test_problems_are_models_too(client: Any) -> None:
    models = part("models")
    body = models.FkRequest(joints=[0.0, 0.0])
    answer = part("api.kinematics.fk").sync(client=client, name="panda", body=body)
    assert isinstance(answer, models.Problem)
    assert answer.code == "INVALID_ROBOT_STATE"


def test_texts_are_answered_as_they_are(client: Any) -> None:
    assert (
        "<robot"
        in part("api.robots.get_urdf")
        .sync_detailed(client=client, name="planar_rr")
        .content.decode()
    )
