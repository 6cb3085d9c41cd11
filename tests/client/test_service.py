"""The client against a real service: what is typed here is what is answered there."""

import asyncio
import base64
import json
from pathlib import Path

import httpx
import numpy as np
import pytest
import trimesh
from pydantic import ValidationError

import armwright_client as ours
from armwright_client import AsyncClient, Client, Pose
from service.app import create_app
from service.http.errors import KINDS
from service.settings import Settings
from tests.client.world import AWAY, POST, READY, TABLE

pytestmark = pytest.mark.timeout(300)


def test_health(client: Client) -> None:
    health = client.healthz()
    assert (health.status, health.version) == ("ok", ours.__version__)
    assert client.readyz().workers == 1


def test_every_kind_of_problem_has_a_class(url: str) -> None:
    listed = httpx.get(f"{url}/v1/problems").json()["problems"]
    assert {kind["code"] for kind in listed} == set(KINDS) <= ours.BY_CODE.keys()


def test_an_application_can_stand_in_for_the_network(tmp_path: Path) -> None:
    """The seam of httpx: no socket, no workers, the application itself."""
    app = create_app(Settings(data_dir=tmp_path, workers=1))

    async def ask() -> tuple[ours.Health, str]:
        transport = httpx.ASGITransport(app)
        async with AsyncClient("http://app", transport=transport) as client:
            with pytest.raises(ours.ValidationFailed) as caught:
                await client.jobs.list(status="nonsense")
            return await client.healthz(), caught.value.problem.instance

    health, instance = asyncio.run(ask())
    assert (health.status, instance) == ("ok", "/v1/jobs")


def test_velocities_and_every_kind_of_inverse_kinematics(client: Client) -> None:
    told = client.robots.velocity("panda", READY, joint_velocities=[0.1] * 7)
    back = client.robots.velocity("panda", READY, twist=told.twist, nullspace=[0.1] * 7)
    assert back.joint_velocities == pytest.approx([0.1] * 7, abs=1e-9)
    assert back.damped == []
    pose = client.robots.fk("panda", READY).pose
    near = client.robots.ik("panda", pose, seed_joints=READY, method="analytic")
    assert near.solutions[0].joints == pytest.approx(READY, abs=1e-6)
    assert "q7=" in (near.solutions[0].branch or "")
    seed = [x + 0.1 for x in READY]
    way = ours.Gradient(rule="transpose", trace=True)
    traced = client.robots.ik("panda", pose, seed_joints=seed, method="gradient", gradient=way)
    assert traced.trace is not None
    assert traced.trace.joints[0] == pytest.approx(seed)
    every = client.robots.ik(
        "ur5e",
        client.robots.fk("ur5e", [0.3, -1.0, 1.4, -0.7, -1.3, 0.2]).pose,
        all_solutions=True,
        all_turns=True,
        choice="limits",
    )
    assert len(every.solutions) == 256
    free = client.robots.ik("panda", pose, axes=["x", "y", "z"], choice="manipulability")
    error = free.solutions[0].position_error
    assert error is not None
    assert error <= 1e-6


def test_the_potential_at_one_configuration_and_at_many(client: Client) -> None:
    scene = ours.Scene(obstacles=[TABLE])
    options = ours.PotentialOptions(influence_distance=0.5)
    one = client.robots.potential("panda", READY, AWAY, scene, options=options)
    many = client.robots.potential_batch("panda", [READY, AWAY], AWAY, scene, options=options)
    assert many.potential[0] == one.potential > many.potential[1]
    assert one.gradient == [-force for force in one.joint_force]
    assert many.control_points[0] == one.control_points
    assert one.control_points[-1].obstacle == TABLE.id


def test_paths_are_timed_and_told_in_other_shapes(client: Client, url: str) -> None:
    timing = ours.RetimeTiming(method="jerk_limited", tool_speed=0.5, payload=ours.Payload(mass=1))
    found = client.retime([READY, AWAY], robot="panda", timing=timing)
    assert found.certificate.verified
    assert found.certificate.limits is not None
    for use in (found.certificate.limits.jerk, found.certificate.limits.tool_speed):
        assert use is not None
        assert use.worst_ratio is not None
        assert use.worst_ratio <= 1.0 + 1e-9
    package = client.retime([READY, AWAY], robot="panda", timing=ours.RetimeTiming(solver="toppra"))
    assert package.certificate.verified
    assert any("toppra's answer" in note for note in package.notes)
    body = {"trajectory": json.loads(found.trajectory.model_dump_json()), "sample_period": 0.05}
    body["trajectory"].pop("interpolation", None)
    with httpx.Client(base_url=url) as plain:
        message = plain.post("/v1/convert", json=body).json()
        table = plain.post("/v1/convert", json=body | {"format": "csv"}).text
    assert found.trajectory.joint_trajectory(0.05) == message
    assert found.trajectory.csv(0.05) == table


def test_scenes_are_stored_listed_replaced_and_forgotten(client: Client) -> None:
    scene = ours.Scene(name="life", obstacles=[TABLE], allowed_collisions=[("table_top", "x")])
    created = client.scenes.create(scene)
    assert (created.name, created.version) == ("life", 1)
    assert client.scenes.get("life") == scene
    with pytest.raises(ours.Conflict):
        client.scenes.create(scene)
    replaced = client.scenes.replace("life", ours.Scene(name="other", obstacles=[POST]))
    assert (replaced.name, replaced.version) == ("life", 2)
    assert "life" in {summary.name for summary in client.scenes.list().scenes}
    assert client.scenes.list(after="life~").scenes == []
    client.scenes.delete("life")
    with pytest.raises(ours.NotFound):
        client.scenes.get("life")


def test_pages_lead_to_each_other(client: Client) -> None:
    names = ["page-a", "page-b", "page-c"]
    for name in names:
        client.scenes.create(ours.Scene(name=name, obstacles=[]))
    found, after = [], "page"
    for _ in names:
        page = client.scenes.list(after=after, limit=1)
        found += [summary.name for summary in page.scenes]
        after = page.next or ""
    assert found == names
    for name in names:
        client.scenes.delete(name)


def test_a_key_makes_creation_repeatable(client: Client) -> None:
    scene = ours.Scene(name="once", obstacles=[])
    first = client.scenes.create(scene, idempotency_key="only-once")
    assert client.scenes.create(scene, idempotency_key="only-once") == first
    with pytest.raises(ours.IdempotencyKeyReused):
        client.scenes.create(ours.Scene(name="twice", obstacles=[]), idempotency_key="only-once")
    client.scenes.delete("once")


def test_what_the_service_refuses_names_the_field(client: Client) -> None:
    with pytest.raises(ValidationError, match=r"obstacle 'table_top' is given twice"):
        ours.Scene(name="twins", obstacles=[TABLE, TABLE])
    unchecked = ours.Scene(name="twins", obstacles=[]).model_copy(
        update={"obstacles": [TABLE, TABLE]}
    )
    with pytest.raises(
        ours.ValidationFailed, match=r"obstacle 'table_top' is given twice"
    ) as caught:
        client.scenes.create(unchecked)
    assert caught.value.details["errors"][0]["path"] == "obstacles"


def test_every_shape_is_stored(client: Client) -> None:
    cube = trimesh.creation.box((0.1, 0.1, 0.1))
    stl = base64.b64encode(cube.export(file_type="stl")).decode()
    shapes: list[ours.Shape] = [
        ours.Box(size=(0.1, 0.1, 0.1)),
        ours.Sphere(radius=0.1),
        ours.Cylinder(radius=0.1, height=0.2),
        ours.Capsule(radius=0.1, height=0.2),
        ours.Cone(radius=0.1, height=0.2),
        ours.Halfspace(normal=(0, 0, 1), offset=-1),
        ours.Convex.of(vertices=cube.vertices),
        ours.Mesh.of(vertices=cube.vertices, faces=cube.faces),
        ours.Mesh(stl_base64=stl),
        ours.PointCloud.of(points=cube.vertices, radius=0.01),
    ]
    obstacles = [
        ours.Obstacle(id=f"{i}", shape=shape, pose=Pose.at(i, 0, 0))
        for i, shape in enumerate(shapes)
    ]
    scene = ours.Scene(name="shapes", obstacles=obstacles)
    client.scenes.create(scene)
    assert client.scenes.get("shapes") == scene
    client.scenes.delete("shapes")


def test_points_are_projected(client: Client) -> None:
    ball = ours.Obstacle(id="ball", shape=ours.Sphere(radius=0.2), pose=Pose.at(1, 0, 0))
    client.scenes.replace("ball", ours.Scene(obstacles=[ball]))
    points = np.random.default_rng(3).normal(size=(20, 3)) * 2
    answer = client.scenes.project("ball", points)
    for point, found in zip(points, answer.projections, strict=True):
        away = point - (1, 0, 0)
        length = np.linalg.norm(away)
        assert found[0].obstacle == "ball"
        assert found[0].distance == pytest.approx(length - 0.2, abs=1e-6)
        expected = np.array([1, 0, 0]) + 0.2 * away / length
        np.testing.assert_allclose(found[0].projection, expected, atol=1e-6)
    client.scenes.delete("ball")
