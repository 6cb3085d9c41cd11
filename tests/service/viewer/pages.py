"""Pages of kept plans: fetched from a service, and shown from disk."""

import json
import re
from pathlib import Path
from typing import Any

import httpx
from playwright.sync_api import Browser, Page

from tests.service.processes import wait_until

#: Largest page [byte].
_MAX_BYTES = 10_000_000


def fetch(client: httpx.Client, path: str, body: dict[str, Any]) -> bytes:
    """The page of an answer that was kept."""
    answer = client.post(path, json=body | {"keep": True}).json()
    plan_id = answer.get("plan_id") or answer["details"]["plan_id"]
    response = client.get(f"/v1/plans/{plan_id}/view")
    assert response.status_code == 200, response.text
    policy = response.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "http" not in policy
    assert len(response.content) < _MAX_BYTES
    return response.content


def wait(page: Page, condition: str) -> None:
    """Wait until a condition holds; the page's policy forbids Playwright's own way, which evals."""
    assert wait_until(lambda: bool(page.evaluate(condition)), 10.0), condition


def document(content: bytes) -> dict[str, Any]:
    found = re.search(rb'type="application/json">(.*?)</script>', content, re.DOTALL)
    assert found is not None
    data: dict[str, Any] = json.loads(found[1])
    return data


def show(
    browser: Browser, content: bytes, folder: Path, script: str | None = None
) -> tuple[Page, list[str]]:
    """A page opened from disk; the list holds what went wrong and what was asked for.

    Args:
        browser: The browser.
        content: The page.
        folder: Where it is written.
        script: JavaScript that runs before those of the page.
    """
    file = folder / "view.html"
    file.write_bytes(content)
    page, events = browser.new_page(viewport={"width": 1000, "height": 800}), []
    if script is not None:
        page.add_init_script(script)
    page.on("console", lambda message: events.append(f"console: {message.text}"))
    page.on("pageerror", lambda error: events.append(f"error: {error}"))
    page.on("request", lambda request: events.append(request.url))
    page.goto(file.as_uri())
    wait(page, "window.armwrightView !== undefined && !window.armwrightView.changed")
    assert events == [file.as_uri()]
    return page, events


def colours(page: Page) -> int:
    """How many colours the 3D view shows."""
    script = """() => {
      const gl = document.getElementById("view").getContext("webgl");
      const width = gl.drawingBufferWidth, height = gl.drawingBufferHeight;
      const pixels = new Uint8Array(4 * width * height);
      gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
      return new Set(new Uint32Array(pixels.buffer)).size;
    }"""
    return int(page.evaluate(script))
