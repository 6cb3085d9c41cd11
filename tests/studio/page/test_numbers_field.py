"""A field of numbers, without a browser: what is being typed is never written over."""

from types import SimpleNamespace
from typing import Any

from studio.page.robot_panel import NumbersField, Units


class Gui:
    """As much of viser's interface as a field needs, with keys that a person presses."""

    def __init__(self) -> None:
        self.widget = SimpleNamespace(value="", label="", on_update=self._listen)

    def add_text(self, *_: Any) -> SimpleNamespace:
        return self.widget

    def add_dropdown(self, *_: Any) -> SimpleNamespace:
        return SimpleNamespace(value="m, rad", on_update=lambda _: None)

    def _listen(self, heard: Any) -> None:
        self.heard = heard

    def type(self, text: str) -> None:
        self.widget.value = text
        self.heard(SimpleNamespace(client=1, target=self.widget))


def test_values_that_come_back_late_do_not_replace_what_was_typed_on() -> None:
    gui: Any = Gui()
    acted: list[list[float]] = []
    field = NumbersField(gui, "x", Units(gui), "length", (1.0,), acted.append)
    for text in ("0", "0.", "0.3", "0.30"):
        gui.type(text)
    assert acted == [[0.0], [0.3]]
    field.show((0.0,))
    assert gui.widget.value == "0.30", "the state is behind"
    field.show((0.3,))
    assert gui.widget.value == "0.30"
    field.show((0.0,))
    assert gui.widget.value == "0", "undone"
    gui.type("0.1")
    gui.type("0.2")
    field.show((0.1,))
    field.show((0.1,))
    assert gui.widget.value == "0.1", "the last was refused"
