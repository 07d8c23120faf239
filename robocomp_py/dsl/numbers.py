"""Numbers as the languages spell them."""

from __future__ import annotations


def whole(text: str) -> int:
    """An integer: decimal, whatever zeros it begins with, or hexadecimal after 0x."""
    return int(text, 16 if "x" in text.lower() else 10)


def real(text: str) -> float:
    """A number; infinite if it is too large for a float."""
    return float(whole(text)) if "x" in text.lower() else float(text.rstrip("fF"))
