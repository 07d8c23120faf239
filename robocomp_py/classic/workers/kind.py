"""How a component of RoboComp's own generator is known, and what its ports mean."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ...contract.component import Component


def accepts(folder: Path) -> bool:
    return (folder / "src" / "specificworker.py").is_file() and not (folder / "specificworker.py").exists()


def component(component: Component) -> Component:
    """RoboComp's generators take `requires Laser(ice)` and `requires Laser` for the same: no port has a middleware."""
    ports = (replace(port, middleware=None) if port.middleware == "ice" else port for port in component.ports)
    return replace(component, ports=tuple(ports))
