"""Colours and pictures of planes. Pictures are read by Pillow, which the extras `[sim]` and `[viewer]` have."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .read import InnerModelError

Pixels = NDArray[np.uint8]
"""Red, green and blue, rows from the top, shape (height, width, 3)."""

GREY = (0.5, 0.5, 0.5, 1.0)
"""The colour of what has none."""

MOST_SHOWN = 2048
"""Of a row or a column of what is on a plane. Larger files are made smaller."""


def colour_of(text: str) -> tuple[float, float, float, float] | None:
    """The colour that a texture names as `#rrggbb`; None if it names a file."""
    if re.fullmatch("#[0-9A-Fa-f]{6}", text):
        red, green, blue = bytes.fromhex(text[1:])
        return red / 255, green / 255, blue / 255, 1.0
    return None


def read_picture(path: Path) -> Pixels:
    """The picture of a file. Raises InnerModelError if it cannot be read."""
    try:
        from PIL import Image
    except ImportError as exc:
        text = f"{path} is not drawn: pictures need `pip install 'robocomp-py[sim]'` ({exc})"
        raise InnerModelError(text) from exc
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(path) as opened:
                opened.draft("RGB", (MOST_SHOWN, MOST_SHOWN))
                opened.thumbnail((MOST_SHOWN, MOST_SHOWN))
                return np.asarray(opened.convert("RGB"))
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError, Image.DecompressionBombWarning) as exc:
        raise InnerModelError(f"{path} is not drawn: it is no picture that can be read: {exc}") from exc
