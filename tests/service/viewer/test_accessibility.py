"""Pages work for everybody: by the rules of axe-core, by keyboard, and without colours."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Browser, Page

from tests.service.viewer.pages import document, show, wait

NAMES = ("plan", "failure", "task", "tour")
#: Everything that a page offers to do.
_CONTROLS = "button, input, select, summary, [tabindex='0']"
#: Keeps what is written and drawn on the canvas of curves.
_RECORD = """(() => {
  window.drawn = { texts: [], strokes: new Set() };
  const kind = CanvasRenderingContext2D.prototype, write = kind.fillText, stroke = kind.stroke;
  kind.fillText = function (text, ...rest) {
    window.drawn.texts.push([text, this.fillStyle]); write.call(this, text, ...rest); };
  kind.stroke = function () { window.drawn.strokes.add(this.strokeStyle); stroke.call(this); };
})()"""


@dataclass(frozen=True)
class Shown:
    """A page in the browser, and what is in it."""

    name: str
    page: Page
    data: dict[str, Any]
    events: list[str]


@pytest.fixture(scope="module", params=NAMES)
def shown(
    request: pytest.FixtureRequest, browser: Browser, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Shown]:
    content = request.getfixturevalue(request.param)
    folder: Path = tmp_path_factory.mktemp("shown")
    page, events = show(browser, content, folder, _RECORD)
    yield Shown(request.param, page, document(content), events)
    page.close()


def contrast(first: str, second: str) -> float:
    """The contrast of two colours "#rrggbb", by the formula of WCAG 2.2."""

    def luminance(colour: str) -> float:
        parts = [int(colour[k : k + 2], 16) / 255.0 for k in (1, 3, 5)]
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    high, low = sorted((luminance(first), luminance(second)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_no_rule_of_axe_is_broken_or_left_open(shown: Shown) -> None:
    page = shown.page
    page.set_viewport_size({"width": 1000, "height": 4500})
    page.locator("summary").click()
    page.evaluate("byId('side').style.maxHeight = 'none'")  # all texts are on the screen
    wait(page, "!window.armwrightView.changed")
    found = Axe().run(page, options={"resultTypes": ["violations", "incomplete"]}).response
    assert [(item["id"], item["nodes"]) for item in found["violations"]] == []
    assert [(item["id"], item["nodes"]) for item in found["incomplete"]] == []
    passed = {item["id"] for item in found["passes"]}
    assert {"color-contrast", "document-title", "html-has-lang", "landmark-one-main"} <= passed
    assert shown.data["robot"] in page.title()
    assert page.get_attribute("html", "lang") == "en"
    page.set_viewport_size({"width": 1000, "height": 800})
    page.evaluate("byId('side').style.maxHeight = ''")


def test_tab_reaches_every_control_in_order_with_a_visible_focus(shown: Shown) -> None:
    page = shown.page
    count = page.evaluate(
        """(controls) => {
          window.controls = [...document.querySelectorAll(controls)].filter(
            (item) => item.checkVisibility());
          document.activeElement.blur(); window.scrollTo(0, 0);
          return window.controls.length; }""",
        _CONTROLS,
    )
    assert count >= 6
    page.locator("h1").click()
    for key, order in (("Tab", range(count)), ("Shift+Tab", range(count - 2, -1, -1))):
        for k in order:
            page.keyboard.press(key)
            place, width, style, colour = page.evaluate(
                """() => { const at = document.activeElement, css = getComputedStyle(at);
                  return [window.controls.indexOf(at), parseFloat(css.outlineWidth),
                          css.outlineStyle, css.outlineColor]; }"""
            )
            assert (place, style) == (k, "solid")
            assert width >= 2.0
            red, green, blue = (int(c) for c in colour[4:-1].split(","))
            assert contrast(f"#{red:02x}{green:02x}{blue:02x}", "#ffffff") >= 3.0


def test_every_control_has_a_role_and_a_name(shown: Shown) -> None:
    session = shown.page.context.new_cdp_session(shown.page)
    nodes = session.send("Accessibility.getFullAXTree")["nodes"]
    controls = [
        (node["role"]["value"], node.get("name", {}).get("value", ""))
        for node in nodes
        if any(p["name"] == "focusable" and p["value"]["value"] for p in node.get("properties", ()))
    ]
    assert all(role not in {"generic", "none", "img"} and name for role, name in controls), controls
    roles = {role for role, _ in controls}
    assert {"application", "checkbox"} <= roles
    assert {"button", "slider", "combobox"} <= roles or shown.name == "failure"


def test_text_and_lines_of_the_curves_stand_out(shown: Shown) -> None:
    page = shown.page
    if shown.name == "failure":
        assert page.is_hidden("#plot")
        return
    for k in range(page.evaluate("curves.length")):
        page.select_option("#curve", index=k)
        wait(page, "!window.armwrightView.changed")
    assert page.evaluate("getComputedStyle(byId('plots')).backgroundColor") == "rgb(255, 255, 255)"
    texts = page.evaluate("window.drawn.texts")
    assert {"rad", "1", "2"} <= {text for text, _ in texts}
    assert min(contrast(colour, "#ffffff") for _, colour in texts) >= 4.5
    strokes = set(page.evaluate("[...window.drawn.strokes]")) - {"#d5dae1"}  # but for the grid
    assert min(contrast(colour, "#ffffff") for colour in strokes) >= 3.0


def test_nothing_is_told_by_colour_alone(shown: Shown) -> None:
    page = shown.page
    signs = page.evaluate("Object.values(VERDICTS).map((item) => item[1][0])")
    assert len(set(signs)) == len(signs)
    if shown.name == "failure":
        listed = page.locator("#list button").all_inner_texts()
        assert len(listed) == len(shown.data["configurations"])
        for text, item in zip(listed, shown.data["configurations"], strict=True):
            sign = page.evaluate("(item) => sign(item)", item)
            assert sign in text
            assert item["reason"] in text
        assert page.get_attribute("#list button >> nth=1", "aria-pressed") == "true"
    else:
        page.select_option("#curve", index=0)
        legend = page.locator("#legend > span").all_inner_texts()
        assert [text.split(":")[0] for text in legend] == [str(i + 1) for i in range(len(legend))]
        assert page.evaluate("interval(curves[0].times, 0.0)") == [0, 0]
    # The closest pair is striped: in grey alone it still differs.
    darker = page.evaluate("""() => {
      const item = motion ? nearestAt(state.time) : data.configurations[state.chosen];
      const frames = motion ? placed(arm.frames(motion.at(state.time)), state.time) : singles[1];
      const gl = view.gl, width = gl.drawingBufferWidth, height = gl.drawingBufferHeight;
      const reds = (some) => {
        view.begin();
        view.draw(frames, { only: () => true, color: () => [0.6, 0.6, 0.6],
                            striped: (body) => some && item.pair.includes(body.name) });
        const pixels = new Uint8Array(4 * width * height);
        gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
        return pixels.filter((_, i) => i % 4 === 0);
      };
      const plain = reds(false), striped = reds(true);
      return plain.filter((red, i) => red > 1.8 * striped[i]).length; }""")
    assert darker > 40


def test_it_fits_a_narrow_screen_and_asks_no_host(shown: Shown) -> None:
    page = shown.page
    page.set_viewport_size({"width": 320, "height": 640})
    assert page.evaluate("document.scrollingElement.scrollWidth") <= 320
    small = """(controls) => [...document.querySelectorAll(controls)].filter((item) => {
      const box = (item.closest("label") || item).getBoundingClientRect();
      return item.checkVisibility() && Math.min(box.width, box.height) < 24;
    }).map((item) => item.id || item.tagName)"""
    assert page.evaluate(small, "button, input, select, summary") == []
    # The file alone: nothing was asked for, and nothing complained, in all that was done with it.
    assert [event for event in shown.events if not event.startswith("file:")] == []
    assert len(shown.events) == 1
