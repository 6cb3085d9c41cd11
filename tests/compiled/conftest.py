"""Kernels that are compiled anew."""

import pytest


@pytest.fixture
def _nothing_kept(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Kernels of a test are compiled in it, whatever earlier runs left."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path_factory.mktemp("kernels")))
