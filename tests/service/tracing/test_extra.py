"""Traces where they are asked for, and only there."""

import sys
from pathlib import Path

import pytest

from service.server import serve
from service.tracing.extra import open_tracing, require_telemetry, traces_url


@pytest.mark.parametrize(
    ("endpoint", "url"),
    [
        ("http://collector:4318", "http://collector:4318/v1/traces"),
        ("http://collector:4318/", "http://collector:4318/v1/traces"),
        ("https://one.example/otlp/v1/traces", "https://one.example/otlp/v1/traces"),
    ],
)
def test_an_endpoint_without_a_path_gets_the_usual_one(endpoint: str, url: str) -> None:
    assert traces_url(endpoint) == url


def test_a_missing_extra_is_told_at_the_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "opentelemetry.sdk.trace", None)
    options = {"data_dir": tmp_path / "data", "traces": "http://localhost:4318"}
    assert serve(options) == 1
    told = capsys.readouterr().err
    assert told.startswith("armwright: traces need the extra `telemetry`: pip install")
    assert not (tmp_path / "data").exists()


def test_without_an_endpoint_nothing_is_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "opentelemetry.sdk.trace", None)
    require_telemetry(None)
    assert open_tracing(None) is None


def test_an_endpoint_that_is_no_url_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert serve({"data_dir": tmp_path, "traces": "collector:4318"}) == 1
    assert capsys.readouterr().err.startswith("armwright: traces: ")
