"""Build the documentation as a site: `make site`.

    python scripts/site.py [--pages-only]

Writes the pages to build/pages: those of docs, the change log, how to contribute, the client, the
notebooks, and what is made of the code's docstrings. Links into the repository's other files become
plain text. Then Zensical builds build/site; a warning of it is an error.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).parents[1]
CONFIGURATION = ROOT / "mkdocs.yml"
PAGES = ROOT / "build/pages"
#: Pages from beside docs, and where they are on the site.
BESIDE = {
    ROOT / "CHANGELOG.md": "CHANGELOG.md",
    ROOT / "CONTRIBUTING.md": "CONTRIBUTING.md",
    ROOT / "README.md": "overview.md",
    ROOT / "client/README.md": "client.md",
}
#: Pages that mkdocstrings fills from docstrings.
DOCSTRINGS = {
    "reference_library.md": ("The library in full", ("armwright",)),
    "reference_client.md": (
        "The client in full",
        (
            "armwright_client.client",
            "armwright_client.options.plan_options",
            "armwright_wire.plans.plan",
            "armwright_client.errors",
        ),
    ),
}
#: The section of the navigation that pages join which no section names.
_OTHER_SECTION = "How-to"
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)#\s]*)(#[^)\s]*)?\)")
#: What a line of Zensical or of the reader of docstrings begins with where something is wrong.
_WARNING = re.compile(r"^(griffe|warning|error)\b", re.MULTILINE | re.IGNORECASE)
_FENCE = re.compile(r"(```.*?```)", re.DOTALL)


def places() -> dict[Path, str]:
    """Where each page and picture is on the site, by its file."""
    docs = ROOT / "docs"
    files = [path for path in docs.rglob("*") if path.is_file() and path.suffix != ".ipynb"]
    return {path: path.relative_to(docs).as_posix() for path in sorted(files)} | BESIDE


def write_pages(folder: Path) -> list[str]:
    """Write all pages and pictures.

    Args:
        folder: Where to; what is in it is removed.

    Returns:
        Names of the pages.
    """
    shutil.rmtree(folder, ignore_errors=True)
    where = places()
    for path, place in where.items():
        target = folder / place
        target.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".md":
            text = path.read_text("utf-8")
            target.write_text(relink(text, path, place, where), "utf-8")
        else:
            shutil.copy(path, target)
    for place, (title, modules) in DOCSTRINGS.items():
        body = "\n\n".join(f"::: {module}" for module in modules)
        (folder / place).write_text(f"# {title}\n\n{body}\n", "utf-8")
    for notebook in sorted((ROOT / "docs/notebooks").glob("*.ipynb")):
        target = folder / "notebooks" / f"{notebook.stem}.md"
        target.parent.mkdir(exist_ok=True)
        target.write_text(notebook_page(json.loads(notebook.read_text("utf-8"))), "utf-8")
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*.md"))


def relink(text: str, path: Path, place: str, where: dict[Path, str]) -> str:
    """A page with its links as the site needs them.

    Args:
        text: The page.
        path: Its file.
        place: Where it is on the site.
        where: Where every page is.
    """

    def site_link(match: re.Match[str]) -> str:
        picture, label, target, anchor = match.groups()
        if "://" in target or not target:
            return match[0]
        file = (path.parent / target).resolve()
        if file.is_dir() and (file / "README.md") in where:
            file /= "README.md"
        if file not in where:
            return label
        link = os.path.relpath(where[file], Path(place).parent.as_posix())
        return f"{picture}[{label}]({link}{anchor or ''})"

    parts = _FENCE.split(text)
    return "".join(part if part.startswith("```") else _LINK.sub(site_link, part) for part in parts)


def notebook_page(notebook: dict[str, Any]) -> str:
    """A notebook as a page: its text, its code, and what that printed and drew."""
    return "\n\n".join(part for cell in notebook["cells"] for part in _cell(cell)) + "\n"


def _cell(cell: dict[str, Any]) -> Iterator[str]:
    source = "".join(cell["source"])
    if cell["cell_type"] == "markdown":
        yield source
        return
    yield f"```python\n{source}\n```"
    for output in cell["outputs"]:
        if output["output_type"] == "stream":
            yield f"```text\n{''.join(output['text']).rstrip()}\n```"
        for kind, content in output.get("data", {}).items():
            if kind == "image/png":
                yield f"![Picture](data:image/png;base64,{''.join(content).strip()})"


def navigation(nav: Sequence[Any], names: Sequence[str]) -> list[Any]:
    """The navigation with its patterns filled in, and the pages that nothing names.

    Args:
        nav: As the configuration has it; `folder/*` means the pages of a folder.
        names: Pages that there are.

    Raises:
        ValueError: A page is named that is not there.
    """
    filled = [_filled(entry, names) for entry in nav]
    listed = set(_listed(filled))
    missing = sorted(listed - set(names))
    if missing:
        raise ValueError(f"mkdocs.yml names pages that are not there: {', '.join(missing)}")
    for entry in filled:
        if isinstance(entry, dict) and _OTHER_SECTION in entry:
            entry[_OTHER_SECTION] += [name for name in names if name not in listed]
    return filled


def _filled(entry: Any, names: Sequence[str]) -> Any:
    if isinstance(entry, dict):
        ((title, inner),) = entry.items()
        if isinstance(inner, str):
            return {title: _pages_of(inner, names) if inner.endswith("/*") else inner}
        return {title: [page for one in inner for page in _flat(_filled(one, names))]}
    return _pages_of(entry, names) if entry.endswith("/*") else entry


def _flat(entry: Any) -> list[Any]:
    return entry if isinstance(entry, list) else [entry]


def _pages_of(pattern: str, names: Sequence[str]) -> list[str]:
    """Pages of a folder, its README first."""
    folder = pattern.removesuffix("*")
    return sorted(
        (name for name in names if name.startswith(folder)),
        key=lambda name: (not name.endswith("README.md"), name),
    )


def _listed(entry: Any) -> Iterator[str]:
    if isinstance(entry, str):
        yield entry
    else:
        for inner in entry.values() if isinstance(entry, dict) else entry:
            yield from _listed(inner)


def main() -> None:
    """Write the pages and build the site."""
    parser = argparse.ArgumentParser(description="Build the documentation as a site.")
    parser.add_argument("--pages-only", action="store_true", help="build no site of the pages")
    pages_only = parser.parse_args().pages_only
    names = write_pages(PAGES)
    configuration = yaml.safe_load(CONFIGURATION.read_text("utf-8"))
    configuration["nav"] = navigation(configuration["nav"], names)
    # Paths of a configuration are relative to it.
    filled = ROOT / ".mkdocs-filled.yml"
    filled.write_text(yaml.safe_dump(configuration, sort_keys=False), "utf-8")
    print(f"{len(names)} pages in {PAGES}")
    if pages_only:
        return
    command = [sys.executable, "-m", "zensical", "build", "--clean", "--strict"]
    command += ["--config-file", str(filled)]
    try:
        built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    finally:
        filled.unlink()
    said = built.stdout + built.stderr
    print(said)
    if built.returncode or _WARNING.search(said):
        sys.exit("the site was not built without warnings")


if __name__ == "__main__":
    main()
