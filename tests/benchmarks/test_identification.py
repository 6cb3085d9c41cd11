"""Formulas of MATLAB, as the benchmark of identification reads them."""

from pathlib import Path

import numpy as np

from benchmarks.peers.identification import formulas

FILE = """% a comment with = and [brackets]
function M = get_it(q)
q1 = q(1);
q2 = q(2);
g0 = 9.80665;
t2 = cos(q2);
t3 = t2.^2.*2.0e-1-sin(q1./2.0)+g0.*(q1-t2);
M = [t2.*t3-1.5e-1,-t3.*(q1+t2.*3.0),...
 4.0e+0];
"""


def test_the_last_list_of_a_file_is_read_term_by_term(tmp_path: Path) -> None:
    path = tmp_path / "get_it.m"
    path.write_text(FILE)
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (5, 7))
    t2 = np.cos(q[:, 1])
    t3 = 0.2 * t2**2 - np.sin(q[:, 0] / 2.0) + 9.80665 * (q[:, 0] - t2)
    expected = np.column_stack([t2 * t3 - 0.15, -t3 * (q[:, 0] + 3.0 * t2), np.full(5, 4.0)])
    np.testing.assert_allclose(formulas(path, q), expected, rtol=1e-12)
