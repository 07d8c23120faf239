"""What others say, as it may be shown on a terminal."""

from __future__ import annotations

import re

_MOVES = re.compile(r"\x1b(?!\[[0-9;:]*m)|[\x00-\x08\x0b-\x1a\x1c-\x1f\x7f-\x9f]")
"""Characters that move what stands on a terminal, or have it do something. What sets colours may stay."""


def harmless(text: str) -> str:
    return text if text.isprintable() else _MOVES.sub("", text)
