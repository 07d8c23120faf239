"""How many seeds a simulated story is told with: `make seeds` tells each with twenty."""

from __future__ import annotations

import os

SEEDS = range(int(os.environ.get("ROBOCOMP_SEEDS", "4")))
