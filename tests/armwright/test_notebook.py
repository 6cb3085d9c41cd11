"""Values as notebooks show them: pages, formulas, short texts."""

import html
import json
import re
from pathlib import Path

import numpy as np
import pytest

import armwright as aw

HOME, AWAY = [0.0, 0.5], [0.6, 0.1]


@pytest.fixture(scope="module")
def plan() -> aw.Plan:
    ball = aw.Obstacle("ball", aw.Sphere(0.1), aw.pose([0.5, 0.0, -0.4]))
    found = aw.plan(aw.load_robot("planar_rr"), aw.Scene([ball]), HOME, AWAY)
    assert isinstance(found, aw.Plan)
    return found


def test_a_plan_is_drawn_in_a_frame_of_its_own(plan: aw.Plan, tmp_path: Path) -> None:
    page = aw.view(plan)
    shown = page._repr_html_()
    frame = re.fullmatch(
        r'<iframe srcdoc="([^"]*)" sandbox="allow-scripts" style=".*"></iframe>', shown
    )
    assert frame is not None
    assert html.unescape(frame[1]) == page.html
    assert page.html.startswith("<!doctype html>")
    assert "against a scene of 1 obstacle" in page.html
    assert '"ball"' in page.html
    assert page.save(tmp_path / "plan.html").read_text() == page.html
    assert len(repr(page)) < 60


def test_a_trajectory_is_proved_for_its_page(plan: aw.Plan) -> None:
    robot = aw.load_robot("planar_rr")
    wall = aw.Scene([aw.Obstacle("wall", aw.Box((3, 3, 3)), np.eye(4))])
    assert "not proved" in aw.view(plan.trajectory, robot, wall).html.lower()
    assert "without obstacles" in aw.view(plan.trajectory, robot).html
    assert '"wall"' in aw.view(plan, scene=wall).html
    with pytest.raises(aw.ArmwrightError, match="does not tell its robot"):
        aw.view(plan.trajectory)


def test_a_tour_is_drawn_whole_with_its_legs() -> None:
    robot, home = aw.load_robot("planar_rr"), np.array([0.0, 0.5])
    goals = tuple(
        aw.TourGoal(name, (aw.JointGoal(np.array([turn, 0.5])),), dwell=0.2)
        for name, turn in (("a", 0.6), ("b", -0.4))
    )
    tour = aw.plan_tour(aw.TourProblem(robot, aw.Scene(), goals, home, "start"))
    assert isinstance(tour, aw.Tour)
    found = re.search(
        r'type="application/json">(.*?)</script>', aw.view(tour, robot).html, re.DOTALL
    )
    assert found is not None
    shown = json.loads(found[1])
    breaks = shown["motion"]["breaks"]
    assert breaks[-1] - breaks[0] == pytest.approx(tour.time, abs=1e-6)
    marks = {mark["label"]: mark["begins"] for mark in shown["stages"]}
    first, second = tour.visits
    assert marks == {
        f"0: to goal {first.index}": 0.0,
        f"1: to goal {second.index}": first.departure,
        "2: to the end": second.departure,
    }
    with pytest.raises(aw.ArmwrightError, match="does not tell its robot"):
        aw.view(tour)


def test_values_have_short_texts(plan: aw.Plan) -> None:
    robot = aw.load_robot("planar_rr")
    values = (plan, plan.trajectory, plan.certificate, robot, aw.equations(robot))
    for value in values:
        assert len(repr(value)) < 120, repr(value)
    assert f"{plan.trajectory.duration:.3f} s" in repr(plan)
    assert "Certificate(proved, clearance " in repr(plan)
    many = aw.Scene([aw.Obstacle(f"o{i}", aw.Sphere(0.1), np.eye(4)) for i in range(9)])
    assert repr(many) == "Scene('o0', 'o1', 'o2', 'o3', 'o4', 'o5', 3 more)"
    assert repr(aw.Scene()) == "Scene()"


def test_formulas_in_latex_are_drawn() -> None:
    robot = aw.load_robot("planar_rr")
    written = aw.equations(robot)._repr_latex_()
    assert written is not None
    lines = written.splitlines()
    assert all(line.startswith(r"\[") and line.endswith(r"\]") for line in lines)
    assert any("D(q)" in line and r"\begin{bmatrix}" in line for line in lines)
    assert aw.equations(robot, "text")._repr_latex_() is None
    assert str(aw.equations(robot, "text")).startswith("c_1 = cos(q_1)")
