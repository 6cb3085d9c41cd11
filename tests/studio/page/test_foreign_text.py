"""Names and texts from elsewhere, in every panel of the studio and in pages of plans: none runs."""

from collections.abc import Iterator
from html import escape, unescape
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Browser, Page, expect

import studio
from armwright_client import Client
from studio.code import all_code
from studio.page import entries_panel, robot_panel, task_panels
from studio.page.panel import Text, escaped
from studio.page.robot_panel import facts
from studio.page.studio_page import serve_page
from studio.settings_form import EntryForms
from studio.state import Branch, Failure, Verdict
from studio.workbench import Workbench
from tests.studio.page.mouse import blank

#: A start of the service and a browser in software take most of it.
pytestmark = pytest.mark.timeout(300)
#: What tells that something ran: a page's own mark.
HIT = "window.top.hit=1"
#: Names that run where they are read as elements, as code, or as links.
NAMES = (
    f"<img src=x onerror='{HIT}'>",
    f"<iframe srcdoc='<script>{HIT}</script>'></iframe>",
    "{" + HIT + "}",
    f"[go](javascript:{HIT}) ![x](http://127.0.0.1:9/x.png)",
    f"``` <svg onload='{HIT}'> ` {{{HIT}}}",
    f"</script><script>{HIT}</script>",
)
ROOT, ARM, TIP = NAMES[0], NAMES[1], NAMES[2]
BOX = "<collision><geometry><box size='0.1 0.1 0.4'/></geometry></collision>"


def urdf() -> str:
    links = "".join(f'<link name="{escape(name)}">{BOX}</link>' for name in (ROOT, ARM, TIP))
    joints = "".join(
        f'<joint name="{escape(name)}" type="revolute"><parent link="{escape(parent)}"/>'
        f'<child link="{escape(child)}"/><origin xyz="0 0 0.6"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
        for name, parent, child in ((NAMES[3], ROOT, ARM), (NAMES[4], ARM, TIP))
    )
    return f'<robot name="{escape(NAMES[5])}">{links}{joints}</robot>'


@pytest.fixture(scope="module")
def hostile(url: str) -> Iterator[Workbench]:
    """A workbench with names that run, wherever there is a name."""
    robot = {"name": "hostile", "urdf": urdf(), "default_limits": {"acceleration": "10 x velocity"}}
    boxes = [
        {
            "id": name,
            "shape": {"type": "box", "size": [size] * 3},
            "pose": {"position": [x, 0, 1.0]},
        }
        for name, size, x in zip(NAMES, [3.0, *[0.2] * 5], [0.0, *range(5, 10)], strict=True)
    ]
    for path, body in (("robots", robot), ("scenes", {"name": "around", "obstacles": boxes})):
        answer = httpx.post(f"{url}/v1/{path}", json=body)
        assert answer.status_code == 201, answer.text
    with Client(url) as client:
        workbench = Workbench(client, url, "hostile")
        workbench.load_scene("around")
        for word, field in (("stages", "kind"), ("goals", "name"), ("waypoints", "frame")):
            entries = tuple({"kind": name, field: name} for name in NAMES)
            workbench.set_entries(word, entries, None)
        workbench.plan()
        yield workbench


def texts(workbench: Workbench) -> dict[str, str]:
    """The text of each panel."""
    state, outcome = workbench.state, workbench.outcome
    assert isinstance(outcome, Failure)
    assert outcome.pair is not None
    branches = tuple(Branch(k, (), Verdict.OTHER, name, name) for k, name in enumerate(NAMES))
    forms = EntryForms("kind", dict.fromkeys(NAMES, ()))
    entries = {
        word: entries_panel.describe(getattr(state, word), forms)
        for word in ("stages", "goals", "waypoints")
    }
    return entries | {
        "robot": facts(workbench.model),
        "goal": robot_panel.describe(branches),
        "plan": task_panels.describe(outcome),
        "code": all_code(workbench.url, state, workbench.goal_tip()),
    }


def nothing_ran(page: Page) -> None:
    page.wait_for_timeout(500)
    assert page.evaluate("window.hit") is None
    assert page.locator("iframe").count() == 0
    assert page.locator("a[href^='javascript']").count() == 0
    assert page.locator("img[src*='127.0.0.1:9']").count() == 0


def test_no_name_runs_in_any_panel_or_page(hostile: Workbench, browser: Browser) -> None:
    server = serve_page(0)
    # What a page would show without the escape: so the names would run.
    bare = server.gui.add_markdown("")
    for text in texts(hostile).values():
        Text(server.gui, "").show(text)
    with blank(browser) as page:
        page.goto(f"http://127.0.0.1:{server.get_port()}")
        expect(page.get_by_text("In collision:").first).to_be_attached(timeout=60_000)
        expect(page.get_by_text(NAMES[2]).first).to_be_attached(timeout=20_000)
        nothing_ran(page)
        bare.content = f"x {NAMES[1]}"
        expect(page.locator("iframe")).to_be_attached(timeout=60_000)
        view = hostile.view_url()
        assert view is not None
        page.goto(view)
        page.wait_for_timeout(1000)
        nothing_ran(page)
        assert NAMES[0] in page.locator("body").inner_text()
    server.stop()


def test_all_markdown_of_the_studio_passes_the_escape() -> None:
    folder = Path(studio.__file__).parent
    calls = [
        path.name for path in folder.rglob("*.py") if "add_markdown" in path.read_text("utf-8")
    ]
    assert calls == ["panel.py"]


@pytest.mark.parametrize("name", NAMES)
def test_what_markdown_would_read_is_written_as_numbers(name: str) -> None:
    for text in (name, f"- **{name}** is", f"a\n{name}"):
        written = escaped(text)
        assert not set(written.replace("&#", "#")) & set("<>[]!`\\~&")
        assert unescape(written) == text
    block = f"```python\nprint({name!r})\n```"
    assert (
        escaped(f"{name}\n\n{block}\n\n{name}") == f"{escaped(name)}\n\n{block}\n\n{escaped(name)}"
    )
