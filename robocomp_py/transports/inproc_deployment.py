"""Deployment within one process. It is apart from the transport, which tools that look at what runs need not import."""

from __future__ import annotations

from .deployment import Deployment, Near


class InprocDeployment(Deployment):
    summary = "objects, between components of one process"
    colour = "#6b7280"
    near = Near.PROCESS
    unprotected = ""  # one process
    shares = False
