"""The codes of all that can be complained about, read from the code."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from pathlib import Path

import robocomp_py

PACKAGE = Path(robocomp_py.__file__).parent

_SLUG_AT = {
    "error": 0,
    "warning": 0,
    "_error": 0,
    "_warning": 0,
    "Diagnostic": 0,
    "Fault": 0,
    "Implausible": 0,
    "_find": 1,
    "_check_names": 2,
    "Complaint": 2,
    "_complain": 0,
    "_give_up": 0,
}
"""Which argument of a call is a slug."""

_NEITHER = ("log", "made", "usage")
"""Who has a method `error`, too: a logger, a parser of arguments."""


def every_slug() -> set[str]:
    """Those of the languages, of the generator, of the deployer, of the commands, and of configurations."""
    parts = [PACKAGE / name for name in ("dsl", "codegen", "deploy", "cli", "lsp", "usercode", "classic")]
    checks = [PACKAGE / name for name in ("contract/parameters.py", "runtime/settings.py", "innermodel/read.py")]
    checks += [PACKAGE / "transports" / name for name in ("iceoptions.py", "ice/places.py")]
    return slugs_in([*checks, *(path for part in parts for path in part.rglob("*.py"))])


def slugs_in(paths: Iterable[Path]) -> set[str]:
    return {slug for path in paths for slug in _slugs_of(path)}


def _slugs_of(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call):
            name = getattr(node.func, "attr", getattr(node.func, "id", ""))
            whose = getattr(getattr(node.func, "value", None), "id", "")
            at = _SLUG_AT.get(name, len(node.args))
            slug = node.args[at] if at < len(node.args) and whose not in _NEITHER else None
            if isinstance(slug, ast.Constant) and isinstance(slug.value, str) and " " not in slug.value:
                yield slug.value
