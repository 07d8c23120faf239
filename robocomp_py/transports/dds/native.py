"""Description of topics and types for DDS programs that do not use this package. Imported by `rcgen` only."""

from __future__ import annotations

from ...codegen import omgidl
from ...codegen.native import Json, Use, channels, exceptions, structs


def native(uses: list[Use], about: str) -> tuple[dict[str, str], Json]:
    parts = (omgidl.REQUEST_HEADER, omgidl.REPLY_HEADER, omgidl.PUBLICATION_HEADER, omgidl.TIME, omgidl.FAILURE)
    files = omgidl.idl([omgidl.CREDIT, *structs(uses, headed=True)], [*parts, *exceptions(uses)], about)
    suffix = {"publication": "", "request": "Request", "reply": "Reply"}
    topics = channels(uses, lambda use, kind: {"topic": f"rc/{use.channel}{suffix[kind]}"})
    return files, {"domain": 0, "idl": sorted(files), "channels": topics}
