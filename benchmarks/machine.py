"""Describes the machine and the versions of a measurement, without which figures say little."""

from __future__ import annotations

import os
import platform
from importlib.metadata import version
from pathlib import Path

from .tables import Table


def describe() -> Table:
    libraries = ("numpy", "msgpack", "pyzmq", "cyclonedds", "eclipse-zenoh", "iceoryx2")
    allocator = [f"{name}={value}" for name, value in sorted(os.environ.items()) if name.startswith("MALLOC_")]
    rows = [
        ("processor", f"{_processor()}, {len(os.sched_getaffinity(0))} cores for us"),
        ("kernel", f"{platform.system()} {platform.release()}"),
        ("Python", f"{platform.python_implementation()} {platform.python_version()}"),
        ("libraries", ", ".join(f"{name} {version(name)}" for name in libraries)),
        ("busy", f"{os.getloadavg()[0]:.1f} processes running on average in the minute before"),
    ]
    if allocator:
        rows.append(("malloc", " ".join(allocator)))
    return Table("machine", "machine", ("", ""), rows)


def _processor() -> str:
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return platform.machine()  # ARM's has no such line
