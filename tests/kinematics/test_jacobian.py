"""Jacobians against pinocchio on real robots, and against differences of the pose."""

import numpy as np
import pytest

from kinematics.arrays import Array
from kinematics.errors import InvalidOption
from kinematics.forward import forward
from kinematics.jacobian import analytic_zyz, geometric, manipulability
from kinematics.model.chain import Chain
from kinematics.pose import from_zyz, rotation_error, to_zyz
from tests.kinematics.samples import Sample, configurations, random_chain, reference, samples

#: Central differences are off by step^2 (6e-10) and by rounding / step (1e-11).
STEP = 1e-5
DIFFERENCE_TOLERANCE = 1e-8


@pytest.mark.parametrize("sample", samples(), ids=lambda sample: sample.name)
def test_equals_pinocchios(sample: Sample) -> None:
    arm = reference(sample)
    chain = arm.chain
    for q in configurations(chain, 3):
        for link in chain.links:
            J = geometric(chain, q, link.name)
            np.testing.assert_allclose(J, arm.jacobian(q, link.name), atol=1e-12, rtol=0)


def differences(chain: Chain, q: Array, link: str, point: Array) -> Array:
    J = np.zeros((6, chain.n))
    for j in range(chain.n):
        step = np.zeros(chain.n)
        step[j] = STEP
        ahead, behind = forward(chain, q + step, link), forward(chain, q - step, link)
        J[:3, j] = (ahead - behind)[:3, :3] @ point + (ahead - behind)[:3, 3]
        J[3:, j] = rotation_error(behind[:3, :3], ahead[:3, :3])
    return J / (2.0 * STEP)


def test_equals_differences_at_any_point_of_any_link() -> None:
    rng = np.random.default_rng(11)
    for _ in range(40):
        chain = random_chain(rng)
        q, point = rng.uniform(-3, 3, chain.n), rng.uniform(-0.5, 0.5, 3)
        link = chain.links[int(rng.integers(len(chain.links)))].name
        J = geometric(chain, q, link, point)
        expected = differences(chain, q, link, point)
        np.testing.assert_allclose(J, expected, atol=DIFFERENCE_TOLERANCE)


def test_columns_beyond_the_link_are_zero() -> None:
    chain = random_chain(np.random.default_rng(12), 5)
    q = np.linspace(-1, 1, 5)
    for i, link in enumerate(chain.links):
        assert not geometric(chain, q, link.name)[:, i:].any()


@pytest.mark.parametrize("point", [[0, 0], [0, 0, np.nan], [[0, 0, 0]], 1.0])
def test_points_refused(point: object) -> None:
    chain = random_chain(np.random.default_rng(14), 2)
    with pytest.raises(InvalidOption, match="point"):
        geometric(chain, [0, 0], point=point)  # type: ignore[arg-type]


def test_analytic_gives_the_zyz_rates() -> None:
    rng = np.random.default_rng(15)
    for _ in range(40):
        chain = random_chain(rng)
        q, rate = rng.uniform(-3, 3, (2, chain.n))
        T = forward(chain, q)
        if np.hypot(T[0, 2], T[1, 2]) < 1e-2:
            continue
        J = analytic_zyz(geometric(chain, q), T[:3, :3])
        ahead, behind = forward(chain, q + STEP * rate), forward(chain, q - STEP * rate)
        turned = to_zyz(ahead[:3, :3]) - to_zyz(behind[:3, :3])
        turned = (turned + np.pi) % (2 * np.pi) - np.pi
        # The rates grow with 1 / sin(theta), their differences' error with its cube.
        assert (J @ rate)[3:] == pytest.approx(turned / (2 * STEP), rel=1e-4, abs=1e-6)
        np.testing.assert_array_equal(J[:3], geometric(chain, q)[:3])


@pytest.mark.parametrize("theta", [0.0, 1e-9, np.pi, np.pi - 1e-9])
def test_analytic_is_refused_where_zyz_is_singular(theta: float) -> None:
    with pytest.raises(InvalidOption, match="theta"):
        analytic_zyz(np.zeros((6, 3)), from_zyz([0.3, theta, 0.5]))


def test_manipulability() -> None:
    rng = np.random.default_rng(16)
    for _ in range(20):
        J = rng.normal(size=(6, int(rng.integers(6, 9))))
        singular = np.array(np.linalg.svd(J, compute_uv=False), dtype=np.float64)
        assert manipulability(singular) == pytest.approx(np.sqrt(np.linalg.det(J @ J.T)))
