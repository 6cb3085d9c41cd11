"""Frames and named states on their way to the service."""

import json

import armwright_client as ours

POSE = ours.FramedPose(position=[0.1, 0.2, 0.3], frame="tool")
SENT = {"position": [0.1, 0.2, 0.3], "frame": "tool"}


def test_a_pose_takes_its_frame_along() -> None:
    ball = ours.Obstacle(id="a", shape=ours.Sphere(radius=0.1), pose=POSE)
    bodies = [
        ours.Goal(pose=POSE),
        ball,
        ours.ToolMotion.lin(POSE),
        ours.IkRequest(pose=POSE),
    ]
    for body in bodies:
        assert json.loads(body.model_dump_json(exclude_none=True))["pose"] == SENT
    scene = ours.Scene(frame="base", obstacles=[ball])
    assert ours.Scene.read(scene.model_dump_json().encode()) == scene
    many = json.loads(ours.IkRequest(poses=[POSE]).model_dump_json(exclude_none=True))
    assert many["poses"] == [SENT]


def test_a_pose_without_a_frame_stays_one() -> None:
    plain = ours.Scene(
        obstacles=[ours.Obstacle(id="a", shape=ours.Sphere(radius=0.1), pose=ours.Pose.at(1, 2, 3))]
    )
    assert ours.Scene.read(plain.model_dump_json().encode()) == plain


def test_named_states_are_starts_and_goals() -> None:
    body = ours.PlanRequest(
        robot="r", start=ours.Start(state="home"), goal=ours.Goal.at_state("away")
    )
    sent = json.loads(body.model_dump_json(exclude_none=True))
    assert (sent["start"], sent["goal"]) == ({"state": "home"}, {"state": "away"})
