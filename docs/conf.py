"""The documentation as a site: `make docs` writes it to site/, which works from files without a network."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError

project = "robocomp_py"
extensions = ["myst_parser", "sphinx.ext.autodoc"]
html_theme = "furo"
html_title = "robocomp_py"
html_show_sphinx = False
html_copy_source = False

myst_heading_anchors = 4
default_role = "code"  # docstrings have names in single back-quotes

autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "undoc-members": True}
autodoc_typehints = "description"
nitpicky = False

suppress_warnings = ["misc.highlighting_failure"]  # pages on mistakes show wrong files

DOCS = Path(__file__).parent

_LOADED = re.compile(
    r"""(?:<script[^>]+src=|<link(?=[^>]+rel=["']?(?:stylesheet|preload|icon|preconnect))[^>]+href=|<img[^>]+src="""
    r"""|@import\s+|url\()\s*["']?(?:https?:)?//[^"')\s>]+""",
    re.IGNORECASE,
)


def setup(app: Sphinx) -> None:
    for language in ("idsl", "cdsl", "pdsl", "ddsl", "smdsl", "slice", "idl"):
        app.add_lexer(language, TextLexer)
    app.connect("source-read", _with_readme)
    app.connect("autodoc-process-docstring", _as_text)
    app.connect("build-finished", _works_offline)


def _with_readme(app: Sphinx, name: str, source: list[str]) -> None:
    """The README of the project is the first page; other pages link to it there."""
    if name == "index":
        readme = (DOCS.parent / "README.md").read_text(encoding="utf-8")
        for there, here in (("](docs/", "]("), ("[changes](CHANGELOG.md)", "changes"), ("](LICENSE", "](../LICENSE")):
            readme = readme.replace(there, here)
        source[0] = readme + source[0]
    elif name == "README":
        source[0] = source[0].replace("](../README.md)", "](index.md)")
    else:
        source[0] = source[0].replace("](../../README.md)", "](../index.md)")


def _as_text(app: Sphinx, what: str, name: str, thing: object, options: Any, lines: list[str]) -> None:
    """Docstrings are plain text: what is indented is shown as it is, and only back-quotes are markup."""
    made: list[str] = []
    for line in lines:
        inside = line.startswith(" ") and bool(line.strip())
        if inside and (not made or not made[-1].strip()):
            made += ["::", ""]
        made.append(line if inside else re.sub(r"(`[^`]*`)|([*|\\_])", lambda at: at[1] or f"\\{at[2]}", line))
    lines[:] = made


def _works_offline(app: Sphinx, exception: Exception | None) -> None:
    """Fail if a page would load anything from the network."""
    for path in Path(app.outdir).rglob("*"):
        if exception is None and path.suffix in (".html", ".css"):
            found = _LOADED.search(path.read_text(encoding="utf-8"))
            if found:
                raise ExtensionError(f"{path}: loads from the network: {found[0]}")
