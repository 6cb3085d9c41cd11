"""Quadratic Lyapunov functions over HTTP."""

import httpx
import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from tests.service.robots import answer

SPRING = [[0.0, 1.0], [-1.0, -1.0]]


def test_a_form_is_examined(client: httpx.Client) -> None:
    body = {"A": SPRING, "P": [[1.0, 0.5], [0.5, 1.0]], "x": [[0.5, 0.0], [0.0, 1.0]]}
    found = answer(client.post("/v1/lyapunov", json=body))
    assert (found["V"], found["V_dot"]) == ("x1² + x1 x2 + x2²", "-x1² - x1 x2 - x2²")
    assert found["P"]["minors"] == pytest.approx([1.0, 0.75])
    assert found["Q"]["definiteness"] == "positive definite"
    assert found["verdict"] == "asymptotically_stable"
    assert found["values"] == pytest.approx([0.25, 1.0])
    assert found["rates"] == pytest.approx([-0.25, -1.0])
    assert found["notes"] == []
    assert found["poles"][0] == pytest.approx({"real": -0.5, "imaginary": -np.sqrt(0.75)})


def test_the_equation_is_solved(client: httpx.Client) -> None:
    found = answer(client.post("/v1/lyapunov", json={"A": SPRING, "Q": [[1, 0], [0, 1]]}))
    expected = solve_continuous_lyapunov(np.array(SPRING).T, -np.eye(2))
    np.testing.assert_allclose(found["P"]["matrix"], expected, atol=1e-14)
    assert found["verdict"] == "asymptotically_stable"
    assert (found["values"], found["rates"]) == (None, None)


def test_a_form_that_is_not_symmetric_is_told(client: httpx.Client) -> None:
    body = {"A": SPRING, "P": [[1.0, 1.0], [0.0, 1.0]], "x": [1.0, 1.0]}
    found = answer(client.post("/v1/lyapunov", json=body))
    assert found["P"]["matrix"] == [[1.0, 0.5], [0.5, 1.0]]
    assert found["values"] == pytest.approx(3.0)
    assert "not symmetric" in found["notes"][0]


def test_a_formula_is_examined(client: httpx.Client) -> None:
    body = {"f": ["x2", "-0.8*x2 - 4.9*sin(x1)"], "V": "x2**2/2 + 4.9*(1 - cos(x1))"}
    found = answer(client.post("/v1/lyapunov", json=body | {"x": [0.6, -0.4]}))
    assert (found["V_dot"], found["verdict"]) == ("-0.8*x2**2", "asymptotically_stable")
    assert "LaSalle" in found["reason"]
    assert found["lasalle"] == {"set": ["x2"], "invariant": ["sin(x1)"]}
    assert found["values"] == pytest.approx(0.08 + 4.9 * (1.0 - np.cos(0.6)))
    assert found["rates"] == pytest.approx(-0.128)
    many = answer(client.post("/v1/lyapunov", json=body | {"x": [[0.6, -0.4], [0.0, 0.0]]}))
    assert many["values"] == [found["values"], 0.0]


def test_a_pendulum_is_known_by_name(client: httpx.Client) -> None:
    body = {"system": "pendulum", "parameters": {"mass": 2.0, "length": 0.5, "damping": 0.4}}
    found = answer(client.post("/v1/lyapunov", json=body | {"x": [0.6, -0.4]}))
    assert found["f"] == ["x2", "-0.8*x2 - 19.62*sin(x1)"]
    energy = 2.0 * (0.5 * 0.4) ** 2 / 2.0 + 2.0 * 9.81 * 0.5 * (1.0 - np.cos(0.6))
    assert found["values"] == pytest.approx(energy)
    assert found["rates"] == pytest.approx(-0.4 * 0.4**2)
    assert "LaSalle" in found["reason"]
