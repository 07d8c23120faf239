"""Recognizes components of RoboComp's own generators, and adjusts the meaning of their ports."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ...contract.component import Component


def accepts(folder: Path) -> bool:
    return (folder / "src" / "specificworker.py").is_file() and not (folder / "specificworker.py").exists()


def component(component: Component) -> Component:
    """The component with ports whose middleware is open: for RoboComp's generators, `requires Laser(ice)` means
    `requires Laser`."""
    ports = (replace(port, middleware=None) if port.middleware == "ice" else port for port in component.ports)
    return replace(component, ports=tuple(ports))
