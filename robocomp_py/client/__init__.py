"""A running network for scripts and notebooks, without models, generated code or source: `robocomp_py.connect`."""

from __future__ import annotations

from .connection import Connection as Connection
from .connection import connect as connect
