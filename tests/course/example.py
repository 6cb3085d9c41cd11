"""A worked example of the course notes: a request to the service and the numbers it must answer."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import httpx
import numpy as np
import pytest
from numpy.typing import ArrayLike

#: Rounding of a few hundred operations on numbers of the size of one.
ROUNDING = 1e-9


class Example(NamedTuple):
    """A request and its answer by the formulas of the notes, evaluated here.

    Args:
        name: What is computed, with the lecture.
        path: Endpoint below /v1/.
        body: The request.
        pick: Takes the numbers in question from the answer.
        expected: The numbers of the notes.
        tolerance: Largest absolute difference.
    """

    name: str
    path: str
    body: dict[str, Any]
    pick: Callable[[Any], ArrayLike]
    expected: ArrayLike
    tolerance: float = ROUNDING


def ask(service: httpx.Client, path: str, body: dict[str, Any]) -> Any:
    """The answer to a request, which must succeed."""
    response = service.post(f"/v1/{path}", json=body)
    assert response.status_code == 200, response.text
    return response.json()


def check(service: httpx.Client, example: Example) -> None:
    """Ask the service and compare with the notes."""
    answer = ask(service, example.path, example.body)
    picked, expected = np.asarray(example.pick(answer)), np.asarray(example.expected)
    assert picked.shape == expected.shape
    np.testing.assert_allclose(picked, expected, rtol=0.0, atol=example.tolerance)


def each(examples: Sequence[Example]) -> pytest.MarkDecorator:
    """The parametrisation of a test over the examples of a chapter."""
    return pytest.mark.parametrize("example", examples, ids=[one.name for one in examples])


def rotation_matrix(axis: str, angle: float) -> Any:
    """The elementary rotation matrices of lecture 3."""
    c, s = np.cos(angle), np.sin(angle)
    return {
        "x": np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]),
        "y": np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]),
        "z": np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]),
    }[axis]


def dh_matrix(theta: float, d: float, a: float, alpha: float) -> Any:
    """The homogeneous transformation of one row of a Denavit-Hartenberg table, lecture 9."""
    ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array(
        [
            [ct, -st * ca, st * sa, a * ct],
            [st, ct * ca, -ct * sa, a * st],
            [0.0, sa, ca, d],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def pose_matrix(pose: dict[str, Any]) -> Any:
    """The homogeneous transformation of an answered pose with a rotation matrix."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = pose["rotation_matrix"], pose["position"]
    return T


def second_order_error(start: float, rate: float, stiffness: float, damping: float, t: Any) -> Any:
    """e(t) of ë + damping ė + stiffness e = 0 from e(0) = start and ė(0) = rate, by its poles."""
    p = np.roots([1.0, damping, stiffness]).astype(complex)
    c = np.linalg.solve(np.array([[1.0, 1.0], p]), np.array([start, rate], dtype=complex))
    return np.real(c[0] * np.exp(p[0] * t) + c[1] * np.exp(p[1] * t))
