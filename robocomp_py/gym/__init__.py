"""An environment of Gymnasium from a network: an agent learns to do what a component of it would do.

    from robocomp_py.gym import NetworkEnv, Range

It needs the extra `[gym]`. See docs/guides/learning.md.
"""

from __future__ import annotations

from .environment import NetworkEnv as NetworkEnv
from .values import Range as Range
