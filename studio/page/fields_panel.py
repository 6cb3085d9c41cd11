"""Panel of options whose forms are those of the API's schema: of tours and of tool paths."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from studio.page.entries_panel import field_widget, text_of, value_of
from studio.page.panel import Page, on_user_update, put_value
from studio.settings_form import FormField


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
        for field in fields:
            on_user_update(self._widgets[field.path], partial(self._set, field))

    def refresh(self) -> None:
        """Show the present values."""
        values = self._read()
        for field in self._fields:
            put_value(self._widgets[field.path], text_of(field, values))

    def _set(self, field: FormField, text: str) -> None:
        def command() -> None:
            self._write(field.path, value_of(field, text))
            self._page.refresh()

        self._page.queue.put(f"{self._word} {field.path}", command)
