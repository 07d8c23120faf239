"""A plan as files for systemd, compose and Kubernetes.

Pure except for `write_export`: a plan becomes texts and a list of files to copy beside them.
"""

from __future__ import annotations

from collections.abc import Callable

from ..plan import Plan
from .base import Export, write_export
from .compose import compose
from .kubernetes import kubernetes
from .systemd import systemd

__all__ = ["EXPORTERS", "Export", "write_export"]

EXPORTERS: dict[str, Callable[[Plan, str], Export]] = {
    "systemd": systemd,
    "compose": compose,
    "kubernetes": kubernetes,
}
"""By name; each takes a plan and the name of its file."""
