"""URDF and SRDF of robots as files: what is stored from them is the same robot."""

from pathlib import Path
from xml.etree import ElementTree

import httpx
import numpy as np

from tests.service.robots import answer, bench, problem, urdf

DOCS = Path(__file__).parents[2] / "docs"
SRDF = """<robot name="bench"><group name="arm"><chain base_link="base" tip_link="tip"/></group>
  <group_state name="up" group="arm"><joint name="shoulder" value="0.25"/>
  <joint name="elbow" value="-1.5"/></group_state>
  <disable_collisions link1="lower" link2="upper" reason="Adjacent"/></robot>"""


def pairs(text: str) -> set[tuple[str, ...]]:
    """Pairs of an SRDF as the standard library reads it."""
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
    answer(client.post("/v1/robots", json=bench("with_srdf", srdf=SRDF)), 201)
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
