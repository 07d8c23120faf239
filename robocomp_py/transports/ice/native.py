"""Description of objects and contexts for Ice programs that do not use this package. Imported by `rcgen` only."""

from __future__ import annotations

from ...codegen.native import Json, Use, channels
from .. import iceoptions


def native(uses: list[Use], about: str) -> tuple[dict[str, str], Json]:
    return {}, {"channels": channels(uses, _address)}


def _address(use: Use, kind: str) -> Json:
    if kind == "publication":
        return {"topic": iceoptions.IceOptions().topic_of(use.channel), "operation": use.operation.name}
    mode = "idempotent" if use.operation.idempotent else "normal"
    return {"identity": iceoptions.identity_of(use.channel), "operation": use.operation.name, "mode": mode}
