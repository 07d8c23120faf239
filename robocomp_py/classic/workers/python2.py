"""Converts the source text of components from Python 2 to Python 3.

Components made before 2019 are written in Python 2. A converter (`lib2to3`, or `fissix`) converts their text in memory;
their files remain unchanged. It keeps line numbers, so tracebacks stay correct.
"""

from __future__ import annotations

import ast
import importlib
import re
import sys
import warnings
from functools import cache, lru_cache
from typing import Any

_CONVERTERS = ("lib2to3", "fissix")
"""The first is part of Python up to 3.12; the second replaces it in later versions."""


class NotConverted(SyntaxError):
    """A text is not Python 3 and cannot be converted. It has the attributes of the original SyntaxError."""

    @property
    def why(self) -> str:
        """The message for the author of the file."""
        if _tool() is not None:
            return f"not valid Python 3, and 2to3 cannot convert it: {self.msg}"
        return (
            f"not valid Python 3 ({self.msg}); if it is Python 2, install a converter for Python "
            f"{sys.version_info.major}.{sys.version_info.minor}: pip install fissix "
            "(Debian, up to Python 3.12: apt-get install python3-lib2to3)"
        )


@lru_cache(maxsize=64)
def as_python3(text: str, name: str) -> tuple[str, bool]:
    """The text in Python 3, and whether it was converted. Raises NotConverted."""
    try:
        parsed(text, name)
    except (SyntaxError, ValueError) as exc:
        return _converted(text, name, exc), True
    return text, False


def parsed(text: str, name: str) -> ast.Module:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # for example about escapes in strings
        return ast.parse(text, name)


def _converted(text: str, name: str, original: SyntaxError | ValueError) -> str:
    for attempt in (_untabbed(text), _by_2to3(text), _by_2to3(_untabbed(text))):
        try:
            if attempt is not None:
                parsed(attempt, name)
                return attempt
        except (SyntaxError, ValueError):
            continue
    raise NotConverted(*original.args) from original


def _untabbed(text: str) -> str:
    """The text with leading tabs expanded to multiples of eight, as in Python 2."""
    return re.sub(r"^[ \t]+", lambda found: found[0].expandtabs(8), text, flags=re.MULTILINE)


def _by_2to3(text: str) -> str | None:
    tool = _tool()
    if tool is None:
        return None
    try:
        return str(tool.refactor_string(text.replace("\r\n", "\n").rstrip() + "\n", "their file"))
    except Exception:  # its tokenizer and parser raise various exceptions: the text is not Python 2 either
        return None


@cache
def _tool() -> Any:
    """The converter, if there is one."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Python 3.11 and 3.12 warn that lib2to3 will be removed
        for package in _CONVERTERS:
            try:
                refactor = importlib.import_module(f"{package}.refactor")
            except ImportError:
                continue
            tool = refactor.RefactoringTool(refactor.get_fixers_from_package(f"{package}.fixes"))
            tool.logger.disabled = True  # it logs which optional fixers it skips
            return tool
    return None
