"""Robots that upload with no hand edit: tips, limits, states, archives, and their files again."""

import base64
import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import httpx
import numpy as np
import pytest

from tests.service.robots import BOX_OBJ, answer, bench, problem, scene, solid, urdf
from tests.service.test_robots import archive

EYE = """<link name="camera"/><joint name="eye" type="fixed">
<parent link="upper"/><child link="camera"/></joint>"""
SIDE = """<link name="flap"/><joint name="hinge" type="revolute">
<parent link="base"/><child link="flap"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>"""
SRDF = """<robot name="bench"><group name="arm"><chain base_link="lower" tip_link="tip"/></group>
<group name="gone"><chain base_link="base" tip_link="nothing"/></group>
<group_state name="home" group="arm"><joint name="elbow" value="0.5"/></group_state></robot>"""
#: A ball of the base that the upper link meets where the arm is stretched.
KNOB = """<link name="knob"><collision><geometry><sphere radius="0.03"/></geometry></collision>
</link><joint name="knob_joint" type="fixed"><parent link="base"/><child link="knob"/>
<origin xyz="0 0 0.45"/></joint>"""
YAML = """joint_limits:
  shoulder: {has_acceleration_limits: true, max_acceleration: 3.5}
  hinge: {has_acceleration_limits: true, max_acceleration: 1.0}
"""


def create(client: httpx.Client, name: str, **changes: Any) -> dict[str, Any]:
    made = answer(client.post("/v1/robots", json=bench(name, **changes)), 201)
    assert answer(client.get(f"/v1/robots/{name}")) == made
    return made


def test_likely_tip_and_limits_for_all(client: httpx.Client) -> None:
    model = create(
        client, "likely", urdf=urdf(extra=EYE), joint_limits={"*": {"acceleration": 4.0}},
        default_limits={"jerk": "10 x acceleration"},
    )  # fmt: skip
    assert (model["tip_link"], model["frame"]) == ("tip", "base")
    assert any("tip_link is 'tip'" in line and "camera" in line for line in model["lint"])
    assert model["limits"]["acceleration"] == [4.0, 4.0]
    assert model["limits"]["jerk"] == [40.0, 40.0]
    assert model["default_limits"] == {"acceleration": None, "jerk": "10 x acceleration"}


def test_limits_as_moveit_has_them_and_joints_held(client: httpx.Client) -> None:
    model = create(
        client, "moveit_limits", urdf=urdf(extra=SIDE), joint_limits=YAML, tip_link="tip",
        held={"hinge": 0.25},
    )  # fmt: skip
    assert model["held"] == {"hinge": 0.25}
    flap = answer(client.post("/v1/robots/moveit_limits/fk", json={"joints": [0.0, 0.0]}))
    turned = flap["links"]["flap"]["quaternion_xyzw"]
    np.testing.assert_allclose(turned, [0.0, 0.0, np.sin(0.125), np.cos(0.125)], atol=1e-12)
    assert model["limits"]["acceleration"] == [3.5, None]
    assert any("hinge" in line and "off the chain" in line for line in model["lint"])


def test_states_and_the_note_on_the_root(client: httpx.Client) -> None:
    model = create(client, "stated", srdf=SRDF, joint_limits=None)
    assert (model["frame"], model["base_link"]) == ("base", "lower")
    assert model["states"] == {"home": [0.5]}
    assert any("'nothing'" in line and "'gone'" in line for line in model["lint"])


def test_ends_that_are_equally_likely_are_told(client: httpx.Client) -> None:
    body = bench("open", urdf=urdf(extra=SIDE + EYE))
    refusal = problem(client.post("/v1/robots", json=body), 422, "INVALID_ROBOT_DESCRIPTION")
    assert refusal["details"]["candidates"] == ["tip", "flap", "camera"]


def test_pairs_that_touch_in_the_zero_pose_are_told_and_allowed_on_request(
    client: httpx.Client,
) -> None:
    lower = urdf().replace('<link name="base"/>', '<link name="base"/>' + KNOB)
    model = create(client, "knobbed", urdf=lower)
    suspect = {"pair": ["knob", "upper"], "reason": "zero pose"}
    assert suspect in model["suspected_collisions"]
    assert any("knob and upper" in line and "allow_suspected" in line for line in model["lint"])
    body = {"joints": [0.0, 0.0]}
    assert not answer(client.post("/v1/check", json={"robot": "knobbed", **body}))["valid"]
    model = create(client, "knobbed_free", urdf=lower, allow_suspected=True)
    where = model["allowed_collisions"].index(["knob", "upper"])
    assert model["allowed_collision_reasons"][where] == "suspected: zero pose"
    assert answer(client.post("/v1/check", json={"robot": "knobbed_free", **body}))["valid"]


def test_links_that_collide_as_they_look(client: httpx.Client) -> None:
    """Sent as JSON and in an archive, whose meshes for display are else kept if there is room."""
    seen = urdf("meshes/box.obj").replace("collision>", "visual>")
    meshes = {"meshes/box.obj": base64.b64encode(BOX_OBJ.encode()).decode()}
    by_json = bench("visual_solids", urdf=seen, meshes=meshes, visual_solids=True)
    content = archive({"arm.urdf": seen, "meshes/box.obj": BOX_OBJ})
    form = {"name": "archived_visual_solids", "visual_solids": "true"}
    for response in (
        client.post("/v1/robots", json=by_json),
        client.post("/v1/robots", files={"file": ("a.zip", content)}, data=form),
    ):
        lint = answer(response, 201)["lint"]
        assert any("collide as they look" in line and "'lower'" in line for line in lint)
    inside = scene(solid("ball", "sphere", [0.0, 0.0, 0.2], radius=0.01))
    for name in ("visual_solids", "archived_visual_solids"):
        asked = {"robot": name, "joints": [0.0, 0.0], "scene": inside}
        pairs = [hit["pair"] for hit in answer(client.post("/v1/check", json=asked))["collisions"]]
        assert ["lower", "ball"] in pairs


def test_archive_with_several_descriptions(client: httpx.Client) -> None:
    files = {"urdf/a.urdf": urdf("meshes/box.obj"), "urdf/b.urdf": urdf("meshes/box.obj"),
             "meshes/box.obj": BOX_OBJ, "a.srdf": SRDF, "b.srdf": SRDF}  # fmt: skip
    content = archive(files)
    refusal = problem(
        client.post("/v1/robots", files={"file": ("several.zip", content)}),
        422, "INVALID_ROBOT_DESCRIPTION",
    )  # fmt: skip
    assert refusal["details"]["candidates"] == ["urdf/a.urdf", "urdf/b.urdf"]
    assert "urdf_path" in refusal["hint"]
    form = {"urdf_path": "b.urdf", "default_limits": json.dumps({"acceleration": "10 x velocity"})}
    model = answer(
        client.post("/v1/robots", files={"file": ("several.zip", content)}, data=form), 201
    )
    assert model["limits"]["acceleration"] == [20.0]
    assert model["states"] == {"home": [0.5]}
    form = {"urdf_path": "c.urdf", "name": "none"}
    refusal = problem(
        client.post("/v1/robots", files={"file": ("several.zip", content)}, data=form),
        422, "INVALID_ROBOT_DESCRIPTION",
    )  # fmt: skip
    assert "'c.urdf'" in refusal["detail"]


def test_archive_of_a_description_expanded_on_another_machine(client: httpx.Client) -> None:
    """As ``file:///$(find package)`` of xArm's and Doosan's descriptions for ROS 2 comes out."""
    uri = "file:///opt/ros/jazzy/share/bench_description/meshes/collision/box.obj"
    files = {"main/bench_description/urdf/bench.urdf": urdf(uri), "main/readme.md": "x",
             "main/bench_description/meshes/collision/box.obj": BOX_OBJ,
             "main/bench_description/meshes/visual/box.obj": "v 0 0 0"}  # fmt: skip
    upload = {"file": ("expanded.zip", archive(files))}
    answer(client.post("/v1/robots", files=upload, data={"name": "expanded"}), 201)
    files["main/bench_description/urdf/bench.urdf"] = urdf(uri.replace("box.obj", "Box.OBJ"))
    upload = {"file": ("expanded.zip", archive(files))}
    refusal = problem(
        client.post("/v1/robots", files=upload, data={"name": "other_case"}),
        422, "INVALID_ROBOT_DESCRIPTION",
    )  # fmt: skip
    assert "uploaded: 'main/bench_description/meshes/collision/box.obj'" in refusal["detail"]


def test_limits_are_changed_later(client: httpx.Client) -> None:
    create(client, "later", joint_limits={"shoulder": {"acceleration": 5.0, "jerk": 9.0}})
    plan = {"robot": "later", "start": {"joints": [0.0, 0.0]}, "goal": {"joints": [0.4, 0.2]}}
    assert problem(client.post("/v1/plan", json=plan), 422, "MISSING_LIMIT")
    changes: dict[str, Any] = {"joint_limits": {"*": {"acceleration": 2.0}, "elbow": {"jerk": 7.0}}}
    changed = answer(client.patch("/v1/robots/later", json=changes))
    assert changed["limits"]["acceleration"] == [2.0, 2.0]
    assert changed["limits"]["jerk"] == [9.0, 7.0]
    assert answer(client.get("/v1/robots/later")) == changed
    slow = answer(client.post("/v1/plan", json=plan))["trajectory"]["duration"]
    changes = {"joint_limits": YAML.replace("3.5", "100"), "default_limits": {"jerk": "3*velocity"}}
    changed = answer(client.patch("/v1/robots/later", json=changes))
    assert changed["limits"]["acceleration"] == [100.0, 2.0]
    changed = answer(
        client.patch("/v1/robots/later", json={"joint_limits": {"*": {"acceleration": 50.0}}})
    )
    assert changed["limits"]["acceleration"] == [50.0, 50.0]
    assert changed["default_limits"]["jerk"] == "3*velocity"
    assert answer(client.post("/v1/plan", json=plan))["trajectory"]["duration"] < slow


@pytest.mark.parametrize(
    ("name", "changes", "status", "code"),
    [
        ("later", {}, 422, "VALIDATION_ERROR"),
        ("later", {"tip_link": "tip"}, 422, "VALIDATION_ERROR"),
        ("later", {"joint_limits": {"knee": {"jerk": 1.0}}}, 422, "INVALID_ROBOT_DESCRIPTION"),
        ("later", {"default_limits": {"jerk": "1 x jerk"}}, 422, "INVALID_ROBOT_DESCRIPTION"),
        ("panda", {"joint_limits": {"*": {"jerk": 1.0}}}, 409, "CONFLICT"),
        ("nobody", {"joint_limits": {"*": {"jerk": 1.0}}}, 404, "NOT_FOUND"),
    ],
)
def test_changes_that_are_refused(
    client: httpx.Client, name: str, changes: dict[str, Any], status: int, code: str
) -> None:
    problem(client.patch(f"/v1/robots/{name}", json=changes), status, code)


DOCS = Path(__file__).parents[2] / "docs"
STATED = """<robot name="bench"><group name="arm"><chain base_link="base" tip_link="tip"/></group>
  <group_state name="up" group="arm"><joint name="shoulder" value="0.25"/>
  <joint name="elbow" value="-1.5"/></group_state>
  <disable_collisions link1="lower" link2="upper" reason="Adjacent"/></robot>"""


def pairs(text: str) -> set[tuple[str, ...]]:
    """Pairs of an STATED as the standard library reads it."""
    found = ElementTree.fromstring(text).iter("disable_collisions")
    return {tuple(sorted((e.attrib["link1"], e.attrib["link2"]))) for e in found}


def test_pairs_that_were_found_are_in_the_srdf(client: httpx.Client) -> None:
    stored = answer(client.post("/v1/robots", json=bench("found_pairs")), 201)
    response = client.get("/v1/robots/found_pairs/srdf")
    assert response.headers["content-type"] == "application/xml"
    assert pairs(response.text) == {tuple(sorted(p)) for p in stored["allowed_collisions"]}
    assert pairs(response.text)
    again = answer(client.post("/v1/robots", json=bench("again", srdf=response.text)), 201)
    assert again["allowed_collisions"] == stored["allowed_collisions"]
    q = np.random.default_rng(2).uniform(-2.0, 2.0, (20, 2)).tolist()
    verdicts = [
        answer(client.post("/v1/check", json={"robot": name, "joints": q}))["clearance"]
        for name in ("found_pairs", "again")
    ]
    assert verdicts[0] == verdicts[1]


def test_states_and_pairs_of_an_srdf_come_back(client: httpx.Client) -> None:
    answer(client.post("/v1/robots", json=bench("with_srdf", srdf=STATED)), 201)
    text = client.get("/v1/robots/with_srdf/srdf").text
    assert ("lower", "upper") in pairs(text)
    (state,) = ElementTree.fromstring(text).iter("group_state")
    assert state.attrib["name"] == "up"
    values = {joint.attrib["name"]: float(joint.attrib["value"]) for joint in state}
    assert values == {"shoulder": 0.25, "elbow": -1.5}


def test_limits_of_the_upload_are_merged_into_the_urdf(client: httpx.Client) -> None:
    limits = {"shoulder": {"velocity": 0.5, "acceleration": 7.25}, "elbow": {"jerk": 90.0}}
    stored = answer(client.post("/v1/robots", json=bench("limited", joint_limits=limits)), 201)
    where = "/v1/robots/limited/urdf"
    assert client.get(where).text == urdf()
    merged = client.get(where, params={"joint_limits": "merged"}).text
    tree = ElementTree.fromstring(merged)
    joints = {e.attrib["name"]: e for e in tree.iter("joint")}
    for k, name in enumerate(stored["joint_names"]):
        limit = joints[name].find("limit")
        assert limit is not None
        for quantity, values in stored["limits"].items():
            if values[k] is not None:
                assert float(limit.attrib[quantity]) == values[k], (name, quantity)
    body = bench("copy", urdf=merged, joint_limits=None)
    copy = answer(client.post("/v1/robots", json=body), 201)
    assert copy["limits"] == stored["limits"]


def test_bad_requests(client: httpx.Client) -> None:
    problem(client.get("/v1/robots/nobody/srdf"), 404, "NOT_FOUND")
    response = client.get("/v1/robots/panda/urdf", params={"joint_limits": "both"})
    document = problem(response, 422, "VALIDATION_ERROR")
    assert "joint_limits" in document["detail"]


def test_the_page_shows_the_real_srdf(client: httpx.Client) -> None:
    text = client.get("/v1/robots/planar_rr/srdf").text
    assert f"```xml\n{text}```" in (DOCS / "dh_robots.md").read_text("utf-8")
