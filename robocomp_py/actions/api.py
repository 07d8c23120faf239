"""All names that generated code imports for actions."""

from __future__ import annotations

from ..contract.interface import Action
from .client import ActionProxy
from .goal import Goal, ServerGoal

__all__ = ["Action", "ActionProxy", "Goal", "ServerGoal"]
