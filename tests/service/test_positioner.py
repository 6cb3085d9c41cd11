"""Work on a turntable beside the arm, over HTTP: poses in the frame that turns."""

import math
from collections.abc import Iterator
from typing import Any

import httpx
import numpy as np
import pinocchio
import pytest

from kinematics.robots import builtin_chain, builtin_urdf
from tests.service.robots import answer, problem

ARM = builtin_chain("ur5e")
URDF = builtin_urdf("ur5e").replace(
    "</robot>",
    f"""<link name="floor"/><link name="work"/>
<joint name="table" type="revolute"><parent link="floor"/><child link="work"/>
<origin xyz="0.6 0 0.2"/><axis xyz="0 0 1"/>
<limit lower="-6.2" upper="6.2" velocity="2" effort="1000"/></joint>
<joint name="stand" type="fixed"><parent link="floor"/><child link="{ARM.base_link}"/></joint>
</robot>""",
)
POINTS = [[0.2 * math.cos(a), 0.2 * math.sin(a), 0.0] for a in np.linspace(0.0, 3.0, 24)]
#: Stands on the floor beside the turntable.
POST = {
    "id": "post",
    "shape": {"type": "cylinder", "radius": 0.03, "height": 0.6},
    "pose": {"position": [0.6, 0.45, 0.3]},
    "link": "floor",
    "touch_links": [],
}
BODY: dict[str, Any] = {
    "robot": "cell",
    "start": {"joints": [0.0, 0.2, -1.2, 1.5, -1.9, -1.57, 0.2]},
    "planner": "cartesian",
    "planner_options": {
        "waypoints": [{"point": p, "normal": [0, 0, 1], "frame": "work"} for p in POINTS],
        "tolerance": {"tilt": 0.2},
        "tool_speed": 0.2,
    },
    "attached": [POST],
    "timeout": 20.0,
}


@pytest.fixture(autouse=True)
def cell(client: httpx.Client) -> Iterator[dict[str, Any]]:
    body = {
        "name": "cell", "urdf": URDF, "base_link": "work",
        "joint_limits": {"*": {"acceleration": 8.0, "jerk": 500.0}},
    }  # fmt: skip
    yield answer(client.post("/v1/robots", json=body), 201)
    client.delete("/v1/robots/cell")


def test_a_seam_on_the_turntable_is_followed(client: httpx.Client, cell: dict[str, Any]) -> None:
    assert cell["joint_names"] == ["table", *ARM.joint_names]
    assert (cell["frame"], cell["base_link"], cell["tip_link"]) == ("work", "work", ARM.tip_link)
    assert any("table moves over the ground" in line for line in cell["lint"])
    found = answer(client.post("/v1/plan", json=BODY | {"timing": {"sample_period": 0.02}}))
    assert found["certificate"]["verified"]
    assert found["frame"] == "work"
    model = pinocchio.buildModelFromXML(URDF)
    data = model.createData()
    order = [model.joints[model.getJointId(name)].idx_q for name in cell["joint_names"]]
    samples = found["trajectory"]["samples"]
    begins, way, turned = found["tool_motions"][0]["begins"], np.array(POINTS), []
    for time, values in zip(samples["time"], samples["position"], strict=True):
        q = np.zeros(model.nq)
        q[order] = values
        pinocchio.framesForwardKinematics(model, data, q)
        tip, work = (data.oMf[model.getFrameId(link)] for link in (ARM.tip_link, "work"))
        post = np.array([0.6, 0.45])
        assert np.hypot(*(tip.translation[:2] - post)) > 0.03
        if time >= begins:
            T = work.actInv(tip)
            off, ways = T.translation - way[:-1], np.diff(way, axis=0)
            s = np.clip((off * ways).sum(axis=1) / (ways**2).sum(axis=1), 0.0, 1.0)
            assert np.linalg.norm(off - s[:, None] * ways, axis=1).min() <= 1.1e-4
            assert -T.rotation[2, 2] >= math.cos(0.2 + 1.1e-3)
            turned.append(values[0])
    assert np.ptp(turned) > 0.5


def test_what_moves_over_the_work_is_no_frame_for_poses(client: httpx.Client) -> None:
    document = problem(
        client.post("/v1/plan", json=BODY | {"frame": "floor"}), 422, "INVALID_LINK_NAME"
    )
    assert "'floor' moves with the arm" in document["detail"]
    assert "base_link 'floor'" in document["hint"]


def test_torques_are_refused_where_the_root_turns(client: httpx.Client) -> None:
    body = BODY | {"timing": {"torque_limits": True}}
    document = problem(client.post("/v1/plan", json=body), 422, "MISSING_LIMIT")
    assert "effort" in document["detail"]
    asked = {"joints": BODY["start"]["joints"]}
    response = client.post("/v1/robots/cell/dynamics", json=asked)
    assert response.status_code == 422
    assert "inertia" in response.json()["detail"]
