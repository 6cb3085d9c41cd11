"""The example that follows a seam on a pipe."""

import importlib.util
from pathlib import Path

import httpx

from armwright_client import Client

SOURCE = Path(__file__).parents[2] / "examples/seam.py"


def test_the_example_follows_its_seam(client: httpx.Client) -> None:
    spec = importlib.util.spec_from_file_location("seam_example", SOURCE)
    assert spec is not None
    assert spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    with Client(str(client.base_url)) as connected:
        plan = example.follow(connected)
    assert plan.certificate.verified
    assert plan.certificate.tool_speed.share > 0.9
    assert plan.tool_motions[0].part == "approach"
