"""Markdown of the page, in which names and texts from elsewhere stay text.

viser's pages take HTML in Markdown as it is, scripts of frames included. Names of joints, links,
robots, obstacles and plans, and the texts of errors, come from files and services of others. So
all text passes here, the only place that calls `add_markdown`: what could begin an element, code, a
link or a picture is written as the number of its character, which is shown and not read.
"""

import re
from urllib.parse import quote

import viser

#: A block of code as `studio.code` writes it; nothing in it is read.
_CODE = re.compile(r"^```(?:python|sh)\n.*?^```$", re.MULTILINE | re.DOTALL)
_READ = re.compile(r"[&<>\[\]!`\\~]")


def escaped(text: str) -> str:
    """Text with emphasis, lists, tables and blocks of code, but nothing that runs or loads.

    Args:
        text: Text with names and texts from anywhere.
    """
    parts, end = [], 0
    for block in _CODE.finditer(text):
        parts += [_escaped(text[end : block.start()]), block[0]]
        end = block.end()
    return "".join([*parts, _escaped(text[end:])])


def _escaped(text: str) -> str:
    return _READ.sub(lambda found: f"&#{ord(found[0])};", text)


class Text:
    """A text of the page.

    Args:
        gui: Interface of viser.
        text: Text that is shown first.
    """

    def __init__(self, gui: viser.GuiApi, text: str = "") -> None:
        self._widget = gui.add_markdown(escaped(text))

    def show(self, text: str, link: tuple[str, str] | None = None) -> None:
        """Show a text.

        Args:
            text: Text with names and texts from anywhere.
            link: Words of ours and the address of a page, shown below it.
        """
        below = "" if link is None else f"\n\n[{link[0]}]({quote(link[1], safe=':/?=&%')})"
        self._widget.content = escaped(text) + below
