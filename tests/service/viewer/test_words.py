"""Certificates and problems in words: every verdict is said, none is turned around."""

from typing import Any

from service.viewer.words import certificate_sentences, problem_sentences

CERTIFICATE: dict[str, Any] = {
    "verified": True,
    "proved": {"limits": True, "collisions": True, "reasons": []},
    "min_clearance": 0.0123,
    "clearance_pair": ["hand", "post"],
    "limits": {"velocity": {"worst_ratio": 0.5, "joint": "j1", "time": 0.25}},
    "violation": None,
}


def test_a_proof_is_said() -> None:
    words = " ".join(certificate_sentences(CERTIFICATE))
    assert "Everything that the request names is proved" in words
    assert "Nothing collides at any instant" in words
    assert "at least 12.3 mm, between hand and post" in words
    assert "At most 50.0 % of velocity limits is used, at 0.250 s by j1" in words


def test_what_is_not_proved_is_said() -> None:
    changes = {
        "verified": False,
        "proved": {"limits": False, "collisions": False, "reasons": ["no geometry"]},
        "limits": {"velocity": {"worst_ratio": 1.25, "joint": "j1", "time": 0.25}},
        "violation": {"kind": "collision", "time": 0.5, "message": "hand hits post"},
        "allowed_collisions": [
            {"pair": ["a", "b"], "reason": "request", "overlap": 0.0015},
            {"pair": ["c", "d"], "reason": "srdf", "overlap": None},
        ],
    }
    words = " ".join(certificate_sentences(CERTIFICATE | changes))
    assert "Not everything" in words
    assert "Nothing collides" not in words
    assert "Velocity limits are not kept: 125.0 %" in words
    assert "Not proved: no geometry" in words
    assert "at 0.500 s: hand hits post" in words
    assert "a and b were not kept apart (request): they overlap by at most 1.50 mm." in words
    assert "Not kept apart, depth not measured: 1 pair(s)." in words


def test_a_problem_is_said_with_its_cure() -> None:
    problem = {
        "title": "The goal is in collision",
        "code": "GOAL_IN_COLLISION",
        "detail": "at the goal, 'hand' and 'post' overlap",
        "hint": "Move it.",
        "details": {"collisions": [{"pair": ["hand", "post"], "depth": 0.02}]},
    }
    assert problem_sentences(problem) == [
        "The goal is in collision (GOAL_IN_COLLISION).",
        "At the goal, 'hand' and 'post' overlap.",
        "Move it.",
        "hand and post overlap by 20.0 mm.",
    ]


def test_stops_are_said_where_they_were_asked_for() -> None:
    assert "Stops" not in " ".join(certificate_sentences(CERTIFICATE | {"stops": None}))
    stops = {"kind": "both", "proved": True, "longest": 0.5, "slowed": 0.25, "message": None}
    words = " ".join(certificate_sentences(CERTIFICATE | {"stops": stops}))
    assert "Stops of both kinds are proved: at rest within 0.500 s." in words
    assert "takes 0.250 s longer" in words
    stops |= {"kind": "joints", "proved": False, "message": "the hand would hit the post"}
    words = " ".join(certificate_sentences(CERTIFICATE | {"stops": stops}))
    assert "Stops of single joints are not proved: the hand would hit the post." in words
