"""The shared part of compose and Kubernetes: an image with the components, and YAML."""

from __future__ import annotations

import sys
from typing import Any

import yaml

from ...version import __version__
from .base import APP, RUNTIME, USER

READY = "/tmp/ready"
"""The file that shows that a process in a container is ready."""

INSIDE = f"/{APP}"
"""The folder of the components."""


def dockerfile() -> str:
    """An image with all that the components of one machine need."""
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    return f"""
FROM python:{python}-slim
RUN pip install --no-cache-dir robocomp-py=={__version__}
RUN useradd --uid {USER} --create-home robot && install -d -m 0700 -o robot {RUNTIME}
COPY --chown=robot {APP} {INSIDE}
USER robot
WORKDIR {INSIDE}
ENV PYTHONUNBUFFERED=1 ROBOCOMP_RUNTIME_DIR={RUNTIME}
"""


class _Dumper(yaml.SafeDumper):
    """Lists are indented below their keys, as people write them; nothing is abbreviated by `&` and `*`."""

    def increase_indent(self, flow: bool = False, indentless: bool = False) -> None:
        super().increase_indent(flow, False)

    def ignore_aliases(self, data: Any) -> bool:
        return True


def as_yaml(*documents: dict[str, Any]) -> str:
    return yaml.dump_all(
        documents, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=100, explicit_start=len(documents) > 1
    )
