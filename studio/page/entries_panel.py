"""Panels of lists of entries and of options, by forms of the API's schema."""

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import viser

from studio.page.panel import Page, Text, on_user_update, put_value
from studio.settings_form import EntryForms, FormField
from studio.state import Entries, moved, with_field, without

#: In dropdowns: the service decides; of entries: none is chosen.
_DEFAULT = "default"
_NONE = "–"
#: Longest text of an entry in the list [characters].
_MAX_TEXT = 60


class EntriesPanel:
    """Adds, orders and removes entries, and edits the one that is chosen.

    Args:
        page: Page of the studio.
        word: An entry in a word, without the s of the field of the state that holds all: "stage".
        forms: Fields by the kind of an entry.
        make: Makes an entry of a kind.
    """

    def __init__(
        self,
        page: Page,
        word: str,
        forms: EntryForms,
        make: Callable[[str], dict[str, Any]],
    ) -> None:
        self._page, self._word, self._forms, self._make = page, word, forms, make
        self._write = partial(page.workbench.set_entries, f"{word}s")
        self._chosen: int | None = None
        self._kind: str | None = None
        self._fields: FieldsPanel | None = None
        self._folder: viser.GuiFolderHandle | None = None
        gui = page.server.gui
        kind = gui.add_dropdown(f"Kind of {word}", [*forms.fields], visible=len(forms.fields) > 1)
        add = gui.add_button(f"Add {word}")
        add.on_click(lambda _: self._run(partial(self._add, kind.value)))
        self._text = Text(gui)
        self._choice = gui.add_dropdown(f"Edit {word}", [_NONE])
        on_user_update(self._choice, lambda label: self._run(lambda: self.choose(number_in(label))))
        order = gui.add_button_group(f"This {word}", ["earlier", "later", "remove"])
        order.on_click(lambda event: self._run(partial(self._order, event.target.value)))
        self._container = gui.add_folder(f"Fields of the {word}")

    @property
    def chosen(self) -> int | None:
        """Number of the entry that is edited, from 0."""
        count = len(self._read())
        return self._chosen if self._chosen is not None and self._chosen < count else None

    def choose(self, number: int | None) -> None:
        """Edit an entry, or none.

        Args:
            number: Number of the entry, from 0.
        """
        self._chosen = number

    def refresh(self) -> None:
        """Show the entries, and the fields of the chosen one."""
        entries = self._read()
        forms = self._forms
        self._text.show(describe(entries, forms) or f"No {self._word} yet.")
        labels = labels_of(entries, forms)
        if labels != [*self._choice.options]:
            self._choice.options = labels
        chosen = self.chosen
        put_value(self._choice, labels[0 if chosen is None else chosen + 1])
        kind = None if chosen is None else forms.kind(entries[chosen])
        if kind != self._kind:
            self._make_fields(kind)
        if self._fields is not None:
            self._fields.refresh()

    def _read(self) -> Entries:
        entries: Entries = getattr(self._page.workbench.state, f"{self._word}s")
        return entries

    def _make_fields(self, kind: str | None) -> None:
        if self._folder is not None:
            self._folder.remove()
        self._fields, self._folder, self._kind = None, None, kind
        if kind is None:
            return
        with self._container:
            self._folder = self._page.server.gui.add_folder(kind)
            with self._folder:
                fields = self._forms.fields[kind]
                self._fields = FieldsPanel(self._page, self._word, fields, self._entry, self._set)

    def _entry(self) -> Mapping[str, Any]:
        return {} if self.chosen is None else self._read()[self.chosen]

    def _set(self, name: str, value: Any) -> None:
        chosen = self.chosen
        if chosen is not None:
            key = f"{self._word} {chosen} {name}"
            self._write(with_field(self._read(), chosen, name, value), key)

    def _add(self, kind: str) -> None:
        entries = self._read()
        self._write((*entries, self._make(kind)), None)
        self._chosen = len(entries)

    def _order(self, word: str) -> None:
        chosen = self.chosen
        if chosen is None:
            raise ValueError(f"choose a {self._word} first")
        entries = self._read()
        if word == "remove":
            self._write(without(entries, chosen), None)
            self._chosen = None
            return
        steps = -1 if word == "earlier" else 1
        self._write(moved(entries, chosen, steps), None)
        self._chosen = min(max(chosen + steps, 0), len(entries) - 1)

    def _run(self, action: Callable[[], None]) -> None:
        self._page.run(f"{self._word} {id(action)}", action)


def field_widget(gui: viser.GuiApi, field: FormField) -> Any:
    """The widget of a field: a choice, or a text.

    Args:
        gui: Interface that the widget is added to.
        field: Field of the form.
    """
    label = f"{field.path} *" if field.required else field.path
    known = "" if field.default is None else f" (default {json.dumps(field.default)})"
    hint = f"{field.description}{known}".strip() or None
    if field.kind in ("choice", "flag"):
        choices = field.choices or ("yes", "no")
        return gui.add_dropdown(label, [_DEFAULT, *map(str, choices)], hint=hint)
    return gui.add_text(label, "", hint=hint)


def labels_of(entries: Entries, forms: EntryForms) -> list[str]:
    """Choices of the entry to be edited: none, and each by its number and kind.

    Args:
        entries: Entries in order.
        forms: Forms by the kind of entry.
    """
    return [_NONE, *(f"{i} {forms.kind(entry)}" for i, entry in enumerate(entries))]


def number_in(label: str) -> int | None:
    """The number of the entry of a choice, from 0; None where none is chosen.

    Args:
        label: Label of the choice.
    """
    number = label.partition(" ")[0]
    return int(number) if number.isdigit() else None


def describe(entries: Entries, forms: EntryForms) -> str:
    """The entries as a list in Markdown: each by its kind and its fields, shortened.

    Args:
        entries: Entries in order.
        forms: Forms by the kind of entry.
    """
    lines = []
    for number, entry in enumerate(entries):
        rest = ", ".join(f"{k}={json.dumps(v)}" for k, v in entry.items() if k != forms.tag)
        short = rest if len(rest) <= _MAX_TEXT else f"{rest[:_MAX_TEXT]}…"
        lines.append(f"{number}. **{forms.kind(entry)}** {short}".rstrip())
    return "\n".join(lines)


def text_of(field: FormField, entry: Mapping[str, Any]) -> str:
    """The text of a field's widget.

    Args:
        field: Field of the form.
        entry: Entry that may have the field.
    """
    value = entry.get(field.path)
    if field.kind == "flag":
        return _DEFAULT if value is None else ("yes" if value else "no")
    if value is None:
        return _DEFAULT if field.kind == "choice" else ""
    return value if isinstance(value, str) else json.dumps(value)


def value_of(field: FormField, text: str) -> Any:
    """The value of a field for its widget's text; None where the service decides.

    Args:
        field: Field of the form.
        text: Text of the widget.

    Raises:
        ValueError: The text is no such value; the message says what is.
    """
    if not text.strip() or (field.kind in ("choice", "flag") and text == _DEFAULT):
        return None
    if field.kind == "flag":
        return text == "yes"
    if field.kind in ("choice", "text"):
        return text
    read: dict[str, Callable[[str], Any]] = {"integer": int, "number": float, "json": json.loads}
    try:
        return read[field.kind](text)
    except ValueError:
        wanted = {"integer": "a whole number", "number": "a number"}
        other = 'JSON: [0.05, 0.1], true, "name", or {"x": 1}'
        raise ValueError(f"{field.path}: {text!r} is not {wanted.get(field.kind, other)}") from None


class FieldsPanel:
    """A widget for each field.

    Args:
        page: Page of the studio.
        word: Subject of the options: "tour".
        fields: Fields of the form.
        read: Answers the present values by name.
        write: Changes one; None leaves it to the service.
    """

    def __init__(
        self,
        page: Page,
        word: str,
        fields: Sequence[FormField],
        read: Callable[[], Mapping[str, Any]],
        write: Callable[[str, Any], None],
    ) -> None:
        self._page, self._word, self._fields = page, word, fields
        self._read, self._write = read, write
        self._widgets = {field.path: field_widget(page.server.gui, field) for field in fields}
        self._text = Text(page.server.gui)
        self._faults: dict[str, str] = {}
        for field in fields:
            on_user_update(self._widgets[field.path], partial(self._set, field))

    def refresh(self) -> None:
        """Show the present values, but leave texts that stand for them or are being typed."""
        values = self._read()
        for field in self._fields:
            widget = self._widgets[field.path]
            if field.path not in self._faults and not _stands_for(field, widget.value, values):
                put_value(widget, text_of(field, values))

    def _set(self, field: FormField, text: str) -> None:
        self._faults.pop(field.path, None)
        try:
            value = value_of(field, text)
        except ValueError as error:  # half-typed, perhaps
            self._faults[field.path] = str(error)
        self._text.show("\n".join(f"- {fault}" for fault in self._faults.values()))
        if field.path not in self._faults:
            self._page.run(f"{self._word} {field.path}", lambda: self._write(field.path, value))


def _stands_for(field: FormField, text: str, values: Mapping[str, Any]) -> bool:
    """Whether a text is one of the present value: 0.10 and 0.1 are the same number."""
    try:
        return bool(value_of(field, text) == values.get(field.path))
    except ValueError:
        return False
