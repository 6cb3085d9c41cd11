"""The compact form: what is packed is read back to the bit by code that shares no line with it."""

import json
import math
from typing import Any

import numpy as np
import pytest

from planning.witness.compact import packed
from tests.planning.witness.problems import checker, compact


def value(random: np.random.Generator) -> float | int | None:
    """A number of any kind that a witness may have."""
    kind = random.integers(7)
    if kind == 0:
        return int(random.integers(-70, 70))
    if kind == 1:
        return int(random.integers(0, 20_000))
    if kind == 2:
        return float(np.round(random.normal(), random.integers(1, 14)))
    if kind == 3:
        return float(random.normal() * 10.0 ** random.integers(-300, 300))
    if kind == 4:
        return int(random.integers(-(2**60), 2**60))
    return None if kind == 5 else float(random.integers(-(2**50), 2**50)) / 10.0**7


def test_numbers_of_all_kinds_are_read_back() -> None:
    """To the bit, ends of each kind among them."""
    random, module = np.random.default_rng(3), checker()
    ends = [-65, -64, 63, 64, 16383, 16384, 2**47 - 1, 2**47, -(2**47), 1e-15, 5e-324, 0.1, -0.3]
    given = [*ends, *(value(random) for _ in range(4000))]
    read = module.read(compact(given))
    assert len(read) == len(given)
    for old, new in zip(given, read, strict=True):
        assert (new is None) if old is None else float(old) == float(new), old


def test_documents_are_read_back() -> None:
    """Lists, objects, texts and tables of any rank, empty ones too."""
    documents: list[Any] = [
        {"a": [], "b": {}, "c": "", "ü": "ö" * 200, "d": None, "e": [[1, 2], [3]], "f": [["x"]]},
        [[[1.5, None], [3, 4]], [[5, 6], [7, -8]]],
        {"table": np.zeros((0, 6)).tolist(), "rows": [[], []], "one": 0.5},
    ]
    for document in documents:
        assert json.loads(json.dumps(checker().read(compact(document)))) == document


def test_small_numbers_take_a_byte() -> None:
    """As directions, solids and cells are."""
    rows = np.tile([3.0, 40.0, 12.0, -63.0, 5.0, 61.0], (1000, 1))
    assert len(packed(rows)) < 6010
    assert len(packed([round(0.001234567 * k, 9) for k in range(1000)])) < 6100


@pytest.mark.parametrize("cut", [0, 1, 5, 9])
def test_what_ends_early_is_rejected(cut: int) -> None:
    """And what has more behind it."""
    content = compact({"numbers": [math.pi, 2.5], "text": "end"})
    with pytest.raises((checker().Rejected, ValueError)):
        checker().read(content[: len(content) - 1 - cut])
    with pytest.raises(checker().Rejected, match="behind"):
        checker().read(content + b"0")
