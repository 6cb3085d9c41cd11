"""One HTML file with data, style and script: it opens from disk and asks no host."""

import base64
import hashlib
import html
from functools import cache
from importlib.resources import files
from typing import Any

from pydantic_core import to_json

#: Scripts in the order in which they need each other.
_SCRIPTS = ("matrix.js", "motion.js", "scene.js", "curves.js", "labels.js", "witness.js", "page.js")
_ASSETS = "assets"


def content_security_policy() -> str:
    """The policy of a page: its own script by its hash, WebAssembly in it, its own styles."""
    digest = base64.b64encode(hashlib.sha256(_script().encode()).digest()).decode()
    return (
        f"default-src 'none'; script-src 'sha256-{digest}' 'wasm-unsafe-eval'; "
        "style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'"
    )


def page(document: dict[str, Any]) -> bytes:
    """The page of a document, UTF-8.

    Args:
        document: Document that is shown, see ``service.endpoints.plans.view``.
    """
    # A "<" in JSON can only be inside of a text: escaped, nothing in it can end the script element.
    data = to_json(document, inf_nan_mode="null").decode().replace("<", "\\u003c")
    filled = _asset("page.html")
    for name, text in (
        ("TITLE", html.escape(str(document["title"]))),
        ("POLICY", html.escape(content_security_policy(), quote=True)),
        ("STYLE", _asset("page.css")),
        ("DATA", data),
        ("SCRIPT", _script()),
    ):
        filled = filled.replace(f"<!--{name}-->", text, 1)
    return filled.encode()


@cache
def checker() -> str:
    """The checker of witnesses, WebAssembly packed by gzip, as Base64 (checkers/build_wasm.py)."""
    content = files("service.viewer").joinpath(_ASSETS, "armwright_check.wasm.gz").read_bytes()
    return base64.b64encode(content).decode()


@cache
def _script() -> str:
    return '"use strict";\n' + "\n".join(_asset(name) for name in _SCRIPTS)


@cache
def _asset(name: str) -> str:
    return files("service.viewer").joinpath(_ASSETS, name).read_text("utf-8")
