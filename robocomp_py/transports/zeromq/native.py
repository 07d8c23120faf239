"""What programs of ZeroMQ need to talk to a component without this package; only the generator imports it."""

from __future__ import annotations

from ...codegen import omgidl
from ...codegen.native import Json, Use, channels, exceptions, headers, layout, structs
from ...contract import types as t


def native(uses: list[Use], about: str) -> tuple[dict[str, str], Json]:
    frames = {
        "publication": ["channel", "NUL", "header", "payload"],
        "request": ["channel", "NUL", "header", "payload"],
        "reply": ["header", "payload"],
    }
    kinds = [*structs(uses, headed=False), *exceptions(uses), omgidl.FAILURE]
    more: Json = {
        "first_frame": {kind: frames[kind] for kind in headers(uses)},
        "headers": headers(uses),
        "channels": channels(uses, lambda use, kind: {}),
        "types": {kind.name: layout(kind) for kind in t.walk(*kinds)},
    }
    if twice := omgidl.ambiguous(kinds):
        more["ambiguous"] = sorted(twice)
    return {}, more
