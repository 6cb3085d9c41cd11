"""Formulas over HTTP of an arm that takes long: deadlines, and no jobs of a GET."""

from typing import Any

import httpx
import numpy as np

from tests.service.robots import answer, problem

#: Four skew axes with offsets everywhere: half a second of algebra and more.
ROWS: list[dict[str, Any]] = [
    {"type": "revolute", "a": 0.3 + 0.01 * i, "alpha": (np.pi / 2.0, 0.0)[i % 2],
     "d": 0.1 + 0.02 * i, "theta": 0.1 * i, "mass": 1.0 + i, "center_of_mass": [0.1, 0.02, 0.03],
     "inertia": [[0.11, 0.01, 0.01], [0.01, 0.21, 0.01], [0.01, 0.01, 0.31]]}
    for i in range(4)
]  # fmt: skip
URL = "/v1/robots/slow_arm/equations"


def test_the_formulas_of_a_slow_arm_are_there_within_the_deadline_or_not_at_all(
    client: httpx.Client,
) -> None:
    body = {"name": "slow_arm", "dh": {"convention": "standard", "rows": ROWS}}
    answer(client.post("/v1/robots", json=body), 201)
    document = problem(client.get(URL, params={"timeout": 0.1}), 504, "TIMED_OUT")
    assert document["hint"]
    formulas = answer(client.get(URL, headers={"Prefer": "respond-async"}))
    assert len(formulas["dynamics"]["mass_matrix"]) == 4
    assert answer(client.get(URL, params={"timeout": 60.0})) == formulas


def test_deadlines_out_of_range_are_refused(client: httpx.Client) -> None:
    where = "/v1/robots/planar_rr/equations"
    for timeout in ("0", "nan", "1e6", "soon"):
        document = problem(client.get(where, params={"timeout": timeout}), 422, "VALIDATION_ERROR")
        assert "timeout" in document["detail"]
    document = problem(client.get(where, params={"timeout": 400.0}), 422, "VALIDATION_ERROR")
    assert "longer than the 300 s allowed here" in document["detail"]


def test_the_determinant_of_named_rows_is_that_of_the_jacobian(client: httpx.Client) -> None:
    where = "/v1/robots/planar_rr/equations"
    found = answer(client.get(where, params={"format": "text", "axes": "x,z"}))
    assert found["determinant"] == "l_1 * l_2 * s_2"
    assert "det_J = l_1 * l_2 * s_2" in found["document"]
    assert answer(client.get(where))["determinant"] is None
    wrong = problem(client.get(where, params={"axes": "x,y,z"}), 422, "VALIDATION_ERROR")
    assert "as many rows of the Jacobian as there are joints, 2" in wrong["detail"]
    problem(client.get(where, params={"axes": "x,up"}), 422, "VALIDATION_ERROR")


def test_query_parameters_that_a_get_does_not_take_are_refused(client: httpx.Client) -> None:
    for where in ("/v1/robots/planar_rr/equations", "/v1/robots/planar_rr", "/v1/jobs"):
        document = problem(client.get(where, params={"axis": "x,y"}), 422, "VALIDATION_ERROR")
        assert "axis: unknown query parameter" in document["detail"]
    assert client.get("/healthz", params={"verbose": "1"}).status_code == 200
