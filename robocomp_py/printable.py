"""Texts of other programs, for terminals: control characters could move the cursor, hide text or reorder it."""

from __future__ import annotations


def printable(text: str) -> str:
    """A text without control characters, but with its lines."""
    return text if text.isprintable() else "".join(each if _is_harmless(each) else "\ufffd" for each in text)


def spaced(text: str) -> str:
    """A text with spaces for all characters that are not printable, except line breaks."""
    return "".join(each if _is_harmless(each) else " " for each in text)


def one_line(text: str) -> str:
    """A text in one line, without control characters."""
    return printable(text).replace("\n", " ")


def _is_harmless(character: str) -> bool:
    return character.isprintable() or character == "\n"
