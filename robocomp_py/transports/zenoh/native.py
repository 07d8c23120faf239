"""Description of keys, headers and types for Zenoh programs that do not use this package. Imported by `rcgen` only."""

from __future__ import annotations

from ...codegen import omgidl
from ...codegen.native import Json, Use, channels, exceptions, headers, structs


def native(uses: list[Use], about: str) -> tuple[dict[str, str], Json]:
    files = omgidl.idl([omgidl.FAILURE, *structs(uses, headed=False), *exceptions(uses)], [omgidl.TIME], about)
    keys = channels(uses, lambda use, kind: {"key": f"rc/0/{use.channel}"})
    return files, {"domain": 0, "idl": sorted(files), "attachments": headers(uses), "channels": keys}
