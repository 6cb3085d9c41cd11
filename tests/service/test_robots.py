"""Robots over HTTP: built-in ones, uploads, tables, refused ones, surfaces of links."""

import io
import json
import zipfile
from typing import Any

import httpx
import numpy as np
import pytest
import trimesh

from armwright_wire.robots.robot import GeometryAnswer, RobotAnswer
from kinematics.robots import builtin_chain, builtin_names
from tests.service.conftest import Served
from tests.service.robots import (
    ACCELERATIONS,
    BOX_OBJ,
    LOOKS,
    answer,
    bench,
    problem,
    scene,
    solid,
    urdf,
)

RANGE = {"lower": -2, "upper": 2}
TABLE: dict[str, Any] = {
    "convention": "standard",
    "rows": [{"type": "revolute", "a": 0.4, "alpha": 0.3, "d": 0.1, "theta": 0.2, **RANGE}],
}


def archive(files: dict[str, str]) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as made:
        for name, content in files.items():
            made.writestr(name, content)
    return stream.getvalue()


def test_every_built_in_robot_is_listed_and_told(client: httpx.Client) -> None:
    listed = {robot["name"]: robot for robot in answer(client.get("/v1/robots"))["robots"]}
    for name in builtin_names():
        chain = builtin_chain(name)
        assert listed[name] == {"name": name, "built_in": True, "joints": chain.n}
        model = answer(client.get(f"/v1/robots/{name}"))
        RobotAnswer.model_validate(model)
        assert model["built_in"]
        assert model["joint_names"] == list(chain.joint_names)
        assert model["links"] == [link.name for link in chain.links]
        assert (model["base_link"], model["tip_link"]) == (chain.base_link, chain.tip_link)
        for quantity, values in model["limits"].items():
            expected = getattr(chain.limits, quantity)
            known = [value if np.isfinite(value) else None for value in expected]
            assert values == known, (name, quantity)
        pairs = list(map(tuple, model["allowed_collisions"]))
        assert len(set(pairs)) == len(pairs) == len(model["allowed_collision_reasons"])
        assert pairs, name


def test_wrists(client: httpx.Client) -> None:
    wrists = {name: client.get(f"/v1/robots/{name}").json()["wrist"] for name in builtin_names()}
    assert wrists["ur5e"] == "three_parallel"
    assert wrists["puma560"] == wrists["kr6_sixx"] == wrists["stanford"] == "spherical"
    assert wrists["panda"] == wrists["planar_rr"] == "none"


def test_a_urdf_with_a_mesh_from_its_making_to_its_end(served: Served) -> None:
    client = served.client
    made = client.post("/v1/robots", json=bench("made"))
    model = answer(made, 201)
    assert made.headers["location"] == "/v1/robots/made"
    assert model["joint_names"] == ["shoulder", "elbow"]
    assert model["tip_link"] == "tip"
    assert model["limits"]["acceleration"] == [5.0, 5.0]
    assert model["limits"]["jerk"] == [None, None]
    assert ["lower", "upper"] in model["allowed_collisions"]
    assert answer(client.get("/v1/robots/made")) == model
    problem(client.post("/v1/robots", json=bench("made")), 409, "CONFLICT")
    fk = answer(client.post("/v1/robots/made/fk", json={"joints": [0.0, 0.0]}))
    np.testing.assert_allclose(fk["pose"]["position"], [0, 0, 0.6], atol=1e-12)
    prepared = served.data / "prepared"
    kept = len(list(prepared.glob("*.robot")))
    assert client.delete("/v1/robots/made").status_code == 204
    assert len(list(prepared.glob("*.robot"))) == kept - 1
    problem(client.get("/v1/robots/made"), 404, "NOT_FOUND")
    problem(client.delete("/v1/robots/made"), 404, "NOT_FOUND")


def test_what_workers_kept_is_made_again_when_it_is_lost(served: Served) -> None:
    client = served.client
    answer(client.post("/v1/robots", json=bench("lost")), 201)
    scene = {"name": "lost", "obstacles": []}
    answer(client.post("/v1/scenes", json=scene), 201)
    for file in (served.data / "prepared").glob("*.[rs]*"):
        if file.suffix == ".robot":
            file.write_bytes(b"garbage")
        else:
            file.unlink()
    check = {"robot": "lost", "scene": "lost", "joints": [0.0, 0.0]}
    assert answer(client.post("/v1/check", json=check))["valid"]
    assert answer(client.get("/v1/robots/lost"))["joint_names"] == ["shoulder", "elbow"]


def test_a_zip(client: httpx.Client) -> None:
    content = archive({"arm/arm.urdf": urdf("meshes/box.obj"), "arm/meshes/box.obj": BOX_OBJ})
    upward = {"arm/urdf/arm.urdf": urdf("../meshes/box.obj"), "arm/meshes/box.obj": BOX_OBJ}
    beside = client.post("/v1/robots", files={"file": ("beside.zip", archive(upward))})
    assert answer(beside, 201)["links"]
    form = {"name": "zipped", "tip_link": "upper", "joint_limits": json.dumps(ACCELERATIONS)}
    form |= {"urdf_path": "", "held": ""}  # as pages send what nobody filled in
    made = client.post("/v1/robots", files={"file": ("arm.zip", content)}, data=form)
    model = answer(made, 201)
    assert model["tip_link"] == "upper"
    assert model["limits"]["acceleration"] == [5.0, 5.0]
    unnamed = client.post("/v1/robots", files={"upload": ("by_file_name.zip", content)})
    assert answer(unnamed, 201)["name"] == "by_file_name"
    assert unnamed.headers["location"] == "/v1/robots/by_file_name"


def test_a_form_without_a_file_and_a_file_that_is_no_zip(client: httpx.Client) -> None:
    files: Any = {"name": (None, "x")}
    problem(client.post("/v1/robots", files=files), 422, "VALIDATION_ERROR")
    upload = {"file": ("arm.zip", b"PK\x03\x04 and so on")}
    problem(client.post("/v1/robots", files=upload), 422, "INVALID_ROBOT_DESCRIPTION")
    headers = {"Content-Type": "multipart/form-data"}
    problem(client.post("/v1/robots", content=b"x", headers=headers), 422, "VALIDATION_ERROR")


def test_built_in_robots_stay(client: httpx.Client) -> None:
    problem(client.delete("/v1/robots/panda"), 409, "CONFLICT")
    problem(client.post("/v1/robots", json=bench("panda")), 409, "CONFLICT")


def test_paging_goes_through_built_in_and_stored_robots_alike(client: httpx.Client) -> None:
    for name in ("aa_first", "zz_last"):
        answer(client.post("/v1/robots", json={"name": name, "dh": TABLE}), 201)
    everything = [robot["name"] for robot in client.get("/v1/robots").json()["robots"]]
    assert everything == sorted(everything)
    assert {"aa_first", "panda", "zz_last"} <= set(everything)
    found, after = [], ""
    while True:
        page = answer(client.get("/v1/robots", params={"limit": 3, "after": after}))
        found += [robot["name"] for robot in page["robots"]]
        if page["next"] is None:
            break
        after = page["next"]
    assert found == everything


def test_json_is_required(client: httpx.Client) -> None:
    headers = {"Content-Type": "text/plain"}
    problem(
        client.post("/v1/robots", content=b"{}", headers=headers), 415, "UNSUPPORTED_MEDIA_TYPE"
    )
    problem(client.post("/v1/robots"), 422, "VALIDATION_ERROR")


def test_the_published_document_has_both_forms(client: httpx.Client) -> None:
    document = client.get("/openapi.json").json()
    content = document["paths"]["/v1/robots"]["post"]["requestBody"]["content"]
    assert set(content) == {"application/json", "multipart/form-data"}
    schemas = document["components"]["schemas"]
    assert schemas["RobotBody"]["examples"]
    text = json.dumps(document)
    for reference in {part.split('"')[0] for part in text.split("#/components/schemas/")[1:]}:
        assert reference in schemas


def test_surfaces_are_those_of_the_description(client: httpx.Client) -> None:
    answer(client.post("/v1/robots", json=bench("drawn")), 201)
    body = answer(client.get("/v1/robots/drawn/geometry"))
    read = GeometryAnswer.model_validate(body)
    assert read.robot == "drawn"
    assert [item.link for item in read.bodies] == ["lower", "upper"]
    lower, upper = (trimesh.Trimesh(s.corners(), s.triangles()) for s in read.bodies)
    np.testing.assert_allclose(lower.bounds, [[-0.05, -0.05, 0.0], [0.05, 0.05, 0.3]], atol=1e-6)
    np.testing.assert_allclose(upper.bounds, [[-0.04, -0.04, 0.05], [0.04, 0.04, 0.25]], atol=1e-6)
    # Counter-clockwise from outside: the volumes are positive.
    np.testing.assert_allclose([lower.volume, upper.volume], [0.003, 0.00128], rtol=1e-5)


def test_frames_are_links_of_forward_kinematics(client: httpx.Client) -> None:
    model = answer(client.get("/v1/robots/panda"))
    body = answer(client.get("/v1/robots/panda/geometry"))
    links = answer(client.post("/v1/robots/panda/fk", json={"joints": [0.0] * 7}))["links"]
    assert body["bodies"]
    assert {item["frame"] for item in body["bodies"]} <= set(links)
    assert {item["link"] for item in body["bodies"]} <= set(model["links"])


def test_what_a_robot_looks_like(served: Served) -> None:
    client, prepared = served.client, served.data / "prepared"
    before = set(prepared.glob("*.visuals"))
    where = "/v1/robots/seen/geometry"
    made = answer(client.post("/v1/robots", json=bench("seen", urdf=urdf(extra=LOOKS))), 201)
    (line,) = (line for line in made["lint"] if "visual" in line)
    assert "lid" in line
    assert "eye" not in line
    body = answer(client.get(where, params={"kind": "visual"}))
    read = GeometryAnswer.model_validate(body)
    assert read.kind == "visual"
    # Links that look like nothing have their collision geometry beside it.
    assert [item.link for item in read.bodies] == ["eye", "eye", "lower", "upper"]
    assert [item.color for item in read.bodies] == [[1, 0.5, 0, 1], [0, 0, 1, 1], None, None]
    box, ball = (trimesh.Trimesh(s.corners(), s.triangles()) for s in read.bodies[:2])
    np.testing.assert_allclose(box.bounds, [[-0.05, -0.05, 0.1], [0.05, 0.05, 0.4]], atol=1e-6)
    np.testing.assert_allclose(ball.bounds[:, 2], [-0.1, 0.1], atol=1e-6)
    plain = answer(client.get(where))
    assert plain["kind"] == "collision"
    assert plain["bodies"] == body["bodies"][2:]
    # Its file is made again where it is lost, and goes with the robot.
    (kept,) = set(prepared.glob("*.visuals")) - before
    kept.unlink()
    assert answer(client.get(where, params={"kind": "visual"})) == body
    assert kept.exists()
    assert client.delete("/v1/robots/seen").status_code == 204
    assert not kept.exists()


def test_a_robot_without_looks_has_no_visual_bodies(client: httpx.Client) -> None:
    body = answer(client.get("/v1/robots/scara/geometry", params={"kind": "visual"}))
    assert body["bodies"] == []
    problem(client.get("/v1/robots/panda/geometry?kind=pretty"), 422, "VALIDATION_ERROR")


ROW: dict[str, Any] = {
    "type": "revolute", "a": 0.4, "alpha": 0.3, "d": 0.1, "theta": 0.2, "beta": 0.05,
    "lower": -2.0, "upper": 3.0, "velocity": 2.0, "acceleration": 5.0, "jerk": 50.0,
    "effort": 80.0, "mass": 2.5, "center_of_mass": [0.1, 0.02, -0.03],
    "inertia": [[0.02, 0.001, 0.0], [0.001, 0.03, 0.0], [0.0, 0.0, 0.04]],
    "motor_inertia": 0.1, "viscous_friction": 0.2, "coulomb_friction": 0.3,
    "continuous": False, "geometry": None, "motor": None,
}  # fmt: skip
TURN = [np.sin(0.2), 0.0, 0.0, np.cos(0.2)]
DH_TABLES_TABLE: dict[str, Any] = {
    "convention": "modified",
    "rows": [
        ROW,
        ROW | {"type": "prismatic", "lower": 0.0, "upper": 0.5},
        ROW | {"lower": None, "upper": None, "continuous": True},
    ],
    "base": {"position": [0.1, 0.2, 0.3], "quaternion_xyzw": TURN},
    "tool": {"position": [0.0, 0.0, 0.15], "quaternion_xyzw": [0.0, 0.0, 0.0, 1.0]},
    "gravity": [0.0, 1.0, -9.7],
    "geometry": {"capsules": 0.04},
}


def test_every_field_of_a_table_comes_back(client: httpx.Client) -> None:
    dh = store(client, "exchanged", DH_TABLES_TABLE)["dh"]
    for told, given in zip(dh["rows"], DH_TABLES_TABLE["rows"], strict=True):
        assert told == given
    np.testing.assert_allclose(dh["base"]["quaternion_xyzw"], TURN, atol=1e-15)
    assert dh["base"]["position"] == DH_TABLES_TABLE["base"]["position"]
    assert dh["tool"] == DH_TABLES_TABLE["tool"]
    assert {name: dh[name] for name in ("convention", "gravity", "geometry")} == {
        name: DH_TABLES_TABLE[name] for name in ("convention", "gravity", "geometry")
    }


@pytest.mark.parametrize("name", ["panda", "ur5e", "puma560", "stanford", "cart_pendulum"])
def test_a_robot_stored_from_its_table_is_the_same_robot(client: httpx.Client, name: str) -> None:
    model = answer(client.get(f"/v1/robots/{name}"))
    copy = store(client, f"{name}_table", model["dh"])
    assert copy["joint_types"] == model["joint_types"]
    assert copy["limits"] == model["limits"]
    n = len(model["joint_names"])
    rng = np.random.default_rng(3)
    q, qd, qdd = rng.uniform(-1.0, 1.0, (3, 5, n)).tolist()
    state = {"joints": q, "velocities": qd, "accelerations": qdd}
    poses, terms = [], []
    for robot in (name, f"{name}_table"):
        fk = answer(client.post(f"/v1/robots/{robot}/fk", json={
            "joints": q, "orientation": "rotation_matrix"}))  # fmt: skip
        poses.append([[pose["position"], *pose["rotation_matrix"]] for pose in fk["pose"]])
        terms.append(answer(client.post(f"/v1/robots/{robot}/dynamics", json=state)))
    np.testing.assert_allclose(poses[1], poses[0], rtol=0, atol=1e-12)
    for field in ("mass_matrix", "coriolis_matrix", "gravity", "torques"):
        scale = np.abs(terms[0][field]).max()
        np.testing.assert_allclose(terms[1][field], terms[0][field], rtol=0, atol=1e-12 * scale)
    again = store(client, f"{name}_again", copy["dh"])
    assert again["dh"]["rows"] == copy["dh"]["rows"]


def test_solids_of_a_table_are_in_its_urdf(client: httpx.Client) -> None:
    rows = [ROW | {"beta": 0.0, "geometry": [
        {"shape": {"type": "cylinder", "radius": 0.05, "height": 0.2}},
        {"shape": {"type": "sphere", "radius": 0.06},
         "pose": {"position": [0.1, 0.0, 0.0], "rpy": [0.1, 0.2, 0.3]}},
        {"shape": {"type": "box", "size": [0.1, 0.1, 0.1]}},
    ]}]  # fmt: skip
    dh = {"convention": "standard", "rows": rows, "geometry": {"capsules": 0.04}}
    store(client, "solid_table", dh)
    text = client.get("/v1/robots/solid_table/urdf").text
    assert "a solid of link_1 is left out" in text
    assert "motor inertias at the joints: 0.1" in text
    assert "gravity in the base frame" in text
    without = {**dh, "rows": [rows[0] | {"geometry": rows[0]["geometry"][:2]}]}
    store(client, "round_table", without)
    copy = client.get("/v1/robots/round_table/urdf").text
    answer(client.post("/v1/robots", json={"name": "round_copy", "urdf": copy}), 201)
    ball = solid("ball", "sphere", [0.7, 0.3, 0.5], radius=0.1)
    checks = [
        answer(client.post("/v1/check", json={
            "robot": robot, "joints": [[0.3], [-1.0]], "scene": {"obstacles": [ball]}}))
        for robot in ("round_table", "round_copy")
    ]  # fmt: skip
    np.testing.assert_allclose(checks[1]["clearance"], checks[0]["clearance"], atol=1e-9)


LINK = {
    "type": "revolute", "a": 0.5, "alpha": 0.0, "d": 0.0, "theta": 0.0,
    "lower": -3.0, "upper": 3.0, "velocity": 2.0, "acceleration": 5.0, "jerk": 50.0,
}  # fmt: skip
BALL = solid("ball", "sphere", [0.9, 0.0, 0.0], radius=0.1)
START, GOAL = [-0.8, 0.0], [0.8, 0.0]


def table(**more: Any) -> dict[str, Any]:
    return {"convention": "standard", "rows": [LINK, LINK]} | more


def store(client: httpx.Client, name: str, dh: dict[str, Any]) -> Any:
    client.delete(f"/v1/robots/{name}")
    model = answer(client.post("/v1/robots", json={"name": name, "dh": dh}), 201)
    RobotAnswer.model_validate(model)
    return model


def test_an_arm_with_capsules_goes_around_what_it_would_drive_through(
    client: httpx.Client,
) -> None:
    store(client, "thick", table(geometry={"capsules": 0.05}))
    body = {"robot": "thick", "scene": scene(BALL), "start": {"joints": START}}
    straight = body | {"goal": {"joints": GOAL}, "planner": "straight_line"}
    problem(client.post("/v1/plan", json=straight), 422, "PLANNING_FAILED")
    planned = answer(client.post("/v1/plan", json=body | {"goal": {"joints": GOAL}}))
    assert planned["certificate"]["verified"]
    assert planned["certificate"]["min_clearance"] > 0.0
    checked = {"robot": "thick", "scene": scene(BALL), "joints": [[0.0, 0.0], [1.2, 0.0]]}
    verdicts = answer(client.post("/v1/check", json=checked))
    assert verdicts["valid"] == [False, True]
    assert verdicts["collisions"][0][0]["pair"] == ["link_2", "ball"]
    # The ball's centre lies on the axis of a capsule: the way out is the sum of both radii.
    assert verdicts["collisions"][0][0]["depth"] == pytest.approx(0.15, abs=1e-6)


def test_a_tool_is_drawn_with_the_robot_that_it_is_mounted_on(client: httpx.Client) -> None:
    where = "/v1/robots/ur5e/geometry"
    for kind in ("collision", "visual"):
        alone = answer(client.get(where, params={"kind": kind}))["bodies"]
        both = answer(client.get(where, params={"kind": kind, "tool": "parallel_jaw"}))["bodies"]
        assert both[: len(alone)] == alone
        more = {item["link"] for item in both[len(alone) :]}
        assert more == {"parallel_jaw", "parallel_jaw/left", "parallel_jaw/right"}
    asked = {"joints": [0.0] * 6, "tool": "parallel_jaw"}
    links = answer(client.post("/v1/robots/ur5e/fk", json=asked))["links"]
    assert {item["frame"] for item in both} <= set(links)
    problem(client.get(where, params={"tool": "gone"}), 404, "NOT_FOUND")
