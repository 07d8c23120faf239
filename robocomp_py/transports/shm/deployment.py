"""Shared memory as a deployment sees it."""

from __future__ import annotations

from pathlib import Path

from ..deployment import Deployment, Near


class ShmDeployment(Deployment):
    summary = "memory that the processes of one host share"
    colour = "#0f8a5f"
    directory = "shm"
    near = Near.HOST
    unprotected = ""  # one user of one host
    shares = False
    leaves_memory = True
    shared_memory = "/dev/shm"
    modules = (("iceoryx2", "iceoryx2"),)

    def memory_files(self) -> list[Path]:
        from ..runtime_folder import runtime_dir
        from .room import SHARED_MEMORY, prefix

        return list(Path(SHARED_MEMORY).glob(f"{prefix(runtime_dir(self.directory))}*"))

    def crowded(self, connections: int) -> str:
        from .room import crowded  # asks the operating system

        return crowded(connections)
