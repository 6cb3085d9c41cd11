"""Work on a turntable beside the arm: poses in its frame, obstacles that stand, against coal."""

import math
from collections.abc import Iterator
from typing import Any

import coal
import httpx
import numpy as np
import pinocchio
import pytest

from tests.service.robots import answer, problem, solid


def collision(shape: str, xyz: str = "0 0 0", rpy: str = "0 0 0") -> str:
    return (
        f'<collision><origin xyz="{xyz}" rpy="{rpy}"/><geometry><{shape}/></geometry></collision>'
    )


def joint(name: str, parent: str, child: str, xyz: str, axis: str, reach: float) -> str:
    return f"""<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="{xyz}"/><axis xyz="{axis}"/>
<limit lower="-{reach}" upper="{reach}" velocity="3" effort="500"/></joint>"""


def fixed(parent: str, child: str, xyz: str = "0 0 0", rpy: str = "0 0 0") -> str:
    return f"""<joint name="{child}_at" type="fixed"><parent link="{parent}"/>
<child link="{child}"/><origin xyz="{xyz}" rpy="{rpy}"/></joint>"""


ALONG_X = "0 1.5707963267948966 0"
#: An arm of six axes with a torch, and a turntable on a stand beside it.
CELL = f"""<robot name="cell"><link name="hall"/>
<link name="pedestal">{collision('cylinder radius="0.1" length="0.3"', "0 0 0.15")}</link>
<link name="column">{collision('cylinder radius="0.09" length="0.2"')}</link>
<link name="upper">{collision('box size="0.12 0.12 0.4"', "0 0 0.2")}</link>
<link name="fore">{collision('cylinder radius="0.05" length="0.34"', "0.2 0 0", ALONG_X)}</link>
<link name="wrist">{collision('box size="0.1 0.08 0.08"')}</link><link name="hand"/>
<link name="flange">{collision('cylinder radius="0.03" length="0.04"', "0.08 0 0", ALONG_X)}</link>
<link name="torch">{collision('cylinder radius="0.012" length="0.16"', "0 0 -0.09")}</link>
<link name="stand">{collision('box size="0.3 0.3 0.3"', "0 0 0.15")}</link>
<link name="plate">{collision('cylinder radius="0.25" length="0.02"', "0 0 -0.01")}</link>
{fixed("hall", "pedestal")}{joint("a1", "pedestal", "column", "0 0 0.4", "0 0 1", 2.9)}
{joint("a2", "column", "upper", "0 0 0.1", "0 1 0", 2.0)}
{joint("a3", "upper", "fore", "0 0 0.4", "0 1 0", 2.6)}
{joint("a4", "fore", "wrist", "0.4 0 0", "1 0 0", 3.0)}
{joint("a5", "wrist", "hand", "0 0 0", "0 1 0", 2.2)}
{joint("a6", "hand", "flange", "0 0 0", "1 0 0", 6.0)}
{fixed("flange", "torch", "0.28 0 0", ALONG_X)}{fixed("hall", "stand", "0.75 0 0")}
{joint("table", "stand", "plate", "0 0 0.34", "0 0 1", 6.2)}</robot>"""
#: The same with a post that is a link of its own.
POST_AT = [0.5, 0.2, 0.5]
WITH_POST = CELL.replace(
    "</robot>",
    f"""<link name="post">{collision('cylinder radius="0.03" length="0.8"')}</link>
{fixed("hall", "post", "0.5 0.2 0.5")}</robot>""",
)
#: Pairs that touch where they are joined.
NEIGHBOURS = {
    frozenset(pair)
    for pair in (("pedestal", "column"), ("column", "upper"), ("upper", "fore"),
                 ("fore", "wrist"), ("wrist", "flange"), ("stand", "plate"))
}  # fmt: skip


def standing(name: str, kind: str, position: list[float], **measures: Any) -> dict[str, Any]:
    return solid(name, kind, position, **measures) | {"link": "hall"}


POST = standing("post", "cylinder", POST_AT, radius=0.03, height=0.8)
WALL = standing("wall", "box", [1.15, 0.0, 0.75], size=[0.1, 2.0, 1.5])
GROUND = standing("ground", "box", [0.0, 0.0, -0.05], size=[4.0, 4.0, 0.1])
ROOF = standing("roof", "box", [0.75, 0.0, 0.62], size=[0.7, 0.7, 0.1])
#: On the work, which turns.
HUB = solid("hub", "cylinder", [0.0, 0.0, 0.1], radius=0.06, height=0.2)
START = [0.0, 0.0, 0.0, 0.6, 0.0, 0.9, 0.0]
SEAM = [[0.2 * math.cos(a), 0.2 * math.sin(a), 0.02] for a in np.linspace(0.0, 4.0, 100)]
ASKED: dict[str, Any] = {
    "start": {"joints": START},
    "scene": {"obstacles": [HUB]},
    "planner": "cartesian",
    "planner_options": {
        "waypoints": [{"point": p, "normal": [0, 0, 1]} for p in SEAM],
        "tolerance": {"tilt": 0.2},
        "tool_speed": 0.2,
    },
    "timing": {"sample_period": 0.01},
    "timeout": 50.0,
}


@pytest.fixture(autouse=True)
def cells(client: httpx.Client) -> Iterator[None]:
    for name, urdf in (("cell", CELL), ("cell_with_post", WITH_POST)):
        body = {
            "name": name, "urdf": urdf, "base_link": "plate", "tip_link": "torch",
            "joint_limits": {"*": {"acceleration": 8.0, "jerk": 500.0}},
        }  # fmt: skip
        robot = answer(client.post("/v1/robots", json=body), 201)
        assert robot["joint_names"] == ["table", "a1", "a2", "a3", "a4", "a5", "a6"]
        assert robot["frame"] == "plate"
    yield
    for name in ("cell", "cell_with_post"):
        client.delete(f"/v1/robots/{name}")


class Peer:
    """Distances by coal, links by pinocchio, of the cell as its file has it."""

    def __init__(self, *world: dict[str, Any]) -> None:
        self.model = pinocchio.buildModelFromXML(CELL)
        kind = pinocchio.GeometryType.COLLISION
        solids = pinocchio.buildGeomFromUrdfString(self.model, CELL, kind).geometryObjects
        self.data = self.model.createData()
        # Name, the joint that carries it, its place on that joint, and the solid.
        self.bodies = [
            (s.name.removesuffix("_0"), s.parentJoint, s.placement, s.geometry) for s in solids
        ]
        table = self.model.getJointId("table")
        self.bodies.append(
            (
                "hub",
                table,
                pinocchio.SE3(np.eye(3), np.array([0, 0, 0.1])),
                coal.Cylinder(0.06, 0.2),
            )
        )
        for item in world:
            place = pinocchio.SE3(np.eye(3), np.array(item["pose"]["position"]))
            self.bodies.append((item["id"], 0, place, self.shape(item["shape"])))
        self.pairs = [
            (a, b)
            for i, a in enumerate(self.bodies)
            for b in self.bodies[:i]
            if a[1] != b[1] and frozenset((a[0], b[0])) not in NEIGHBOURS
        ]
        names = ["table", "a1", "a2", "a3", "a4", "a5", "a6"]
        self.order = [self.model.joints[self.model.getJointId(name)].idx_q for name in names]

    @staticmethod
    def shape(given: dict[str, Any]) -> Any:
        if given["type"] == "box":
            return coal.Box(*given["size"])
        return coal.Cylinder(given["radius"], given["height"])

    def nearest(self, joints: list[float]) -> dict[frozenset[str], float]:
        """Distances of all pairs [m]; negative where they overlap."""
        q = np.zeros(self.model.nq)
        q[self.order] = joints
        pinocchio.forwardKinematics(self.model, self.data, q)
        found = {}
        for a, b in self.pairs:
            places = [self.data.oMi[body[1]] * body[2] for body in (a, b)]
            at = [coal.Transform3s(T.rotation, T.translation) for T in places]
            result = coal.DistanceResult()
            request = coal.DistanceRequest()
            distance = coal.distance(a[3], at[0], b[3], at[1], request, result)
            found[frozenset((a[0], b[0]))] = distance
        return found

    def off_the_seam(self, samples: dict[str, Any], begins: float) -> float:
        """How far the torch is off the seam on the turning plate at most [m]."""
        torch, plate = (self.model.getFrameId(name) for name in ("torch", "plate"))
        way, worst = np.array(SEAM), 0.0
        for time, joints in zip(samples["time"], samples["position"], strict=True):
            q = np.zeros(self.model.nq)
            q[self.order] = joints
            pinocchio.framesForwardKinematics(self.model, self.data, q)
            T = self.data.oMf[plate].actInv(self.data.oMf[torch])
            off, ways = T.translation - way[:-1], np.diff(way, axis=0)
            s = np.clip((off * ways).sum(axis=1) / (ways**2).sum(axis=1), 0.0, 1.0)
            if time >= begins:
                worst = max(worst, float(np.linalg.norm(off - s[:, None] * ways, axis=1).min()))
                assert -T.rotation[2, 2] >= math.cos(0.2 + 1.1e-3)
        return worst

    def least(self, samples: dict[str, Any]) -> tuple[float, frozenset[str]]:
        """The least distance of a motion [m], and of which pair."""
        return min(
            ((d, pair) for q in samples["position"] for pair, d in self.nearest(q).items()),
            key=lambda found: found[0],
        )


def plan(client: httpx.Client, robot: str, *world: dict[str, Any]) -> dict[str, Any]:
    body = ASKED | {"robot": robot, "attached": list(world)}
    found = answer(client.post("/v1/plan", json=body))
    assert found["certificate"]["verified"]
    return found


def validate(client: httpx.Client, found: dict[str, Any], *world: dict[str, Any]) -> dict[str, Any]:
    body = {
        "robot": "cell", "scene": ASKED["scene"], "attached": list(world),
        "trajectory": {"segments": found["trajectory"]["segments"]},
    }  # fmt: skip
    return answer(client.post("/v1/validate", json=body))


@pytest.mark.parametrize("way", ["attached", "link"])
def test_a_post_beside_the_arm_is_kept_clear_of(client: httpx.Client, way: str) -> None:
    if way == "attached":
        found = plan(client, "cell", POST, WALL, GROUND)
    else:
        found = plan(client, "cell_with_post", WALL, GROUND)
    samples, peer = found["trajectory"]["samples"], Peer(POST, WALL, GROUND)
    assert peer.off_the_seam(samples, found["tool_motions"][0]["begins"]) <= 1.1e-4
    moved = np.ptp(np.array(samples["position"]), axis=0)
    assert moved[0] > 1.0
    assert moved[1:].max() > 0.3
    proved = found["certificate"]["min_clearance"]
    true, _ = peer.least(samples)
    assert 0.0 < proved <= true + 1e-6
    assert proved >= true - 1e-4
    again = validate(client, found, POST, WALL, GROUND)
    assert again["verified"]
    assert again["min_clearance"] == pytest.approx(proved, abs=1e-3)


def test_a_roof_over_the_work_is_named_as_what_is_in_the_way(client: httpx.Client) -> None:
    away = [0.0, 1.6, -0.3, 0.6, 0.0, 0.9, 0.0]
    body = ASKED | {"robot": "cell", "attached": [ROOF], "start": {"joints": away}}
    document = client.post("/v1/plan", json=body).json()
    assert document["details"]["reason"] == "collision"
    assert "roof" in document["details"]["pair"]


def test_configurations_agree_with_coal_near_contact_too(client: httpx.Client) -> None:
    world = [POST, WALL, GROUND]
    peer, random, near = Peer(*world), np.random.default_rng(7), 0
    lower, upper = np.array([-6, -1.5, -1, -1, -3, -2, -3]), np.array([6, 1.5, 1.5, 2, 3, 2, 3])
    verdicts = set()
    for joints in random.uniform(lower, upper, (60, 7)).tolist():
        body = {"robot": "cell", "scene": ASKED["scene"], "attached": world, "joints": joints}
        checked = answer(client.post("/v1/check", json=body))
        distances = peer.nearest(joints)
        least = min(distances.values())
        near += abs(least) < 0.02
        if abs(least) > 1e-5:
            assert checked["valid"] == (least > 0.0), (joints, checked, least)
            verdicts.add(checked["valid"])
        for item in checked["collisions"]:
            assert distances[frozenset(item["pair"])] < 1e-5
        if least > 1e-5:
            assert checked["clearance"] == pytest.approx(least, abs=1e-5)
    assert verdicts == {True, False}
    assert near


def test_an_obstacle_in_a_frame_that_moves_is_refused_with_the_cure(client: httpx.Client) -> None:
    post = {key: POST[key] for key in ("id", "shape", "pose")}
    for frame, words in (("hall", "attached"), ("world", "Frames are: plate")):
        body = ASKED | {"robot": "cell", "scene": {"obstacles": [post], "frame": frame}}
        document = problem(client.post("/v1/plan", json=body), 422, "INVALID_LINK_NAME")
        assert words in document["hint"]


def test_a_half_space_on_a_link_is_refused_with_the_cure(client: httpx.Client) -> None:
    endless = standing("ground", "halfspace", [0, 0, 0], normal=[0, 0, 1], offset=0)
    body = ASKED | {"robot": "cell", "attached": [endless]}
    document = problem(client.post("/v1/plan", json=body), 422, "INVALID_SCENE")
    assert "'ground' is a half-space" in document["detail"]
    assert "box" in document["hint"]
