"""The seeds with which simulated stories are told."""

from __future__ import annotations

import os

SEEDS = range(20)
"""Each ends well with all of them."""

REPEATED = range(int(os.environ.get("ROBOCOMP_SEEDS", "4")))
"""Those with which a story is told twice; `make seeds` does so with twenty."""
