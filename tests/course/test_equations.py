"""Formulas over HTTP: those of lectures 6 to 9, 14, 25 to 27 and 33."""

import math
from typing import Any

import httpx


def formulas(service: httpx.Client, robot: str, **query: str) -> Any:
    response = service.get(f"/v1/robots/{robot}/equations", params=query)
    assert response.status_code == 200, response.text
    return response.json()


def test_the_planar_arm_of_lecture_27(service: httpx.Client) -> None:
    answer = formulas(service, "notes_planar", format="text")
    assert answer["pose"]["position"] == [
        "l_1 * c_1 + l_2 * c_12", "l_1 * s_1 + l_2 * s_12", "0",
    ]  # fmt: skip
    motion = answer["dynamics"]
    assert motion["equation"] == "D(q)*qdd + C(q, qd)*qd + G(q) = tau"
    assert motion["mass_matrix"][1][1] == "m_2 * l_c2**2 + I_2"
    assert motion["coriolis_matrix"] == [
        ["-m_2 * l_1 * l_c2 * s_2 * qd_2", "-m_2 * l_1 * l_c2 * s_2 * (qd_1 + qd_2)"],
        ["m_2 * l_1 * l_c2 * s_2 * qd_1", "0"],
    ]
    symbols = {(c["i"], c["j"], c["k"]): c["formula"] for c in motion["christoffel_symbols"]}
    assert symbols[1, 1, 2] == "m_2 * l_1 * l_c2 * s_2"


def test_the_pendulum_of_lectures_26_and_33(service: httpx.Client) -> None:
    motion = formulas(service, "cart_pendulum", format="text")["dynamics"]
    assert motion["mass_matrix"] == [
        ["m_1 + m_2", "-m_2 * l_c2 * c_2"],
        ["-m_2 * l_c2 * c_2", "m_2 * l_c2**2 + I_zz2"],
    ]
    assert motion["gravity"] == ["0", "-m_2 * l_c2 * g * s_2"]
    assert motion["potential_energy"] == "m_2 * l_c2 * g * c_2"
    assert motion["regressor"]["parameters"] == ["m_1 + m_2", "m_2 * l_c2", "m_2 * l_c2**2 + I_zz2"]
    assert motion["regressor"]["regressor"] == [
        ["qdd_1", "-c_2 * qdd_2 + s_2 * qd_2**2", "0"],
        ["0", "-(c_2 * qdd_1 + g * s_2)", "qdd_2"],
    ]


def test_the_table_is_the_one_that_was_given(service: httpx.Client) -> None:
    answer = formulas(service, "notes_two_link", format="text")
    assert answer["convention"] == "standard"
    assert answer["transformations"][0] == [
        ["c_1", "-s_1", "0", "l_1 * c_1"], ["s_1", "c_1", "0", "l_1 * s_1"],
        ["0", "0", "1", "0"], ["0", "0", "0", "1"],
    ]  # fmt: skip


def test_latex_is_the_form_by_default(service: httpx.Client) -> None:
    answer = formulas(service, "notes_planar")
    assert answer["format"] == "latex"
    assert answer["joints"][0] == {"joint": "joint_1", "symbol": "q_{1}", "type": "revolute"}
    assert answer["dynamics"]["mass_matrix"][1][1] == "m_{2} l_{c2}^{2} + I_{2}"
    assert r"\begin{bmatrix}" in answer["document"]
    assert formulas(service, "notes_planar") == answer


def test_what_cannot_be_answered_is_told(service: httpx.Client) -> None:
    form = service.get("/v1/robots/planar_rr/equations", params={"format": "pdf"})
    assert form.status_code == 422
    assert form.json()["code"] == "VALIDATION_ERROR"
    assert "latex" in form.text
    missing = service.get("/v1/robots/nobody/equations")
    assert (missing.status_code, missing.json()["code"]) == (404, "NOT_FOUND")
    row = {"type": "revolute", "a": 0.1, "alpha": math.pi / 2, "d": 0.1, "theta": 0.0}
    snake = {"name": "snake", "dh": {"convention": "standard", "rows": [row] * 12}}
    assert service.post("/v1/robots", json=snake).status_code == 201
    long = service.get("/v1/robots/snake/equations")
    assert long.status_code == 422
    assert "12 joints" in long.json()["detail"]
    assert "fk" in long.json()["hint"]
