"""Preferred clearance over HTTP: kept where there is room, told where it is not, refused if odd."""

import httpx
import numpy as np
import pytest

from tests.service.planning import plan, world
from tests.service.test_plan import positions


def test_a_post_with_room_beside_it_is_passed_at_the_preferred_distance(
    client: httpx.Client,
) -> None:
    exact = world()
    nearest = {}
    for preferred in (0.0, 0.02):
        found = plan(client, clearance={"preferred": preferred})
        rows = positions(found["trajectory"])
        # The arm's own links may be nearer than the post at all times: then it is far enough.
        nearest[preferred] = min(
            (
                near.distance
                for near in (exact.clearance(q) for q in rows)
                if near.pair is not None and near.pair[1] == "post"
            ),
            default=np.inf,
        )
        told = found["clearance"]
        assert (told["preferred"], told["least"]) == (preferred, 0.0)
        assert found["certificate"]["verified"] is True
    assert nearest[0.0] < 0.01
    # Legs keep 20 mm; the corner is blended with half of it, which is far quicker.
    assert nearest[0.02] > 0.01


def test_the_answer_tells_where_the_motion_is_nearer(client: httpx.Client) -> None:
    found = plan(client, clearance={"preferred": 0.3})
    told, duration = found["clearance"], found["trajectory"]["duration"]
    assert told["own_links"] == 0.005
    assert told["spans"]
    for span in told["spans"]:
        assert 0.0 <= span["begins"] < span["ends"] <= duration
        assert 0.0 <= span["distance"] <= 0.3
    total = sum(span["ends"] - span["begins"] for span in told["spans"])
    assert told["time_below"] == pytest.approx(total)
    least = min(span["distance"] for span in told["spans"])
    assert least >= found["certificate"]["min_clearance"] - 1e-9


def test_least_is_the_margin(client: httpx.Client) -> None:
    by_name = plan(client, margin=0.004, clearance={"preferred": 0.0})
    other = plan(client, clearance={"preferred": 0.0, "least": 0.004})
    assert by_name["trajectory"] == other["trajectory"]
    assert other["clearance"]["least"] == 0.004
    assert other["certificate"]["min_obstacle_clearance"] >= 0.004
