"""Quadratic Lyapunov functions over HTTP."""

import httpx
import numpy as np
import pytest
from scipy.linalg import solve_continuous_lyapunov

from tests.service.robots import answer, problem

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


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ({"f": ["x2", "-x1 + y"], "V": "x1**2"}, "f[1]: 'y' is no name of a formula (character 7)"),
        ({"f": ["1 + x1"], "V": "x1**2"}, "f[0] is 1 at x = 0"),
        ({"f": ["-x1"], "V": "x1**2", "x": [1.0, 2.0]}, "x has 2 number(s), f has 1 formulas"),
        ({"f": ["-x1"]}, "give exactly one of P, Q, V, system"),
        ({"f": ["-x1"], "V": "x1**2", "A": [[1.0]]}, "A belongs to P or Q"),
        ({"P": [[1.0]]}, "P belongs to A"),
        ({"system": "pendulum"}, "system belongs to parameters"),
        ({"f": ["-x1"], "V": "x" * 501}, "V"),
    ],
)
def test_wrong_formulas_are_refused(
    client: httpx.Client, body: dict[str, object], fault: str
) -> None:
    document = problem(client.post("/v1/lyapunov", json=body), 422, "VALIDATION_ERROR")
    assert fault in document["detail"]
