"""Networks as `rc doctor` and others see them, made of single ends and links."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from robocomp_py.contract.interface import Operation
from robocomp_py.runtime.RoboCompIntrospection import Description, Measures
from robocomp_py.runtime.RoboCompIntrospection import End as ToldEnd
from robocomp_py.testing import everything as e
from robocomp_py.tools.doctor.checks import examine
from robocomp_py.tools.doctor.facts import Asked, Facts
from robocomp_py.tools.network import End, Network
from robocomp_py.transports.census import Told


def end(
    owner: str, role: str, channel: str, *, pid: int = 1, traits: str = "", operation: Operation[Any] | None = None
) -> End:
    meant = operation or (e.news if role in ("publishes", "subscribes") else e.divide)
    return End("near", Told(owner, pid, role, channel, meant.fingerprint, meant.text, traits))


def facts(*ends: End, **more: Any) -> Facts:
    return Facts("here", network=Network(ends), **more)


def findings(given: Facts, check: str) -> list[str]:
    return [f"{finding.weight} {finding.text}: {finding.advice}" for _, finding in examine(given, [check])]


def asked(name: str, measures: Measures | None = None, ends: Iterable[ToldEnd] = (), **more: Any) -> Asked:
    return Asked(name, 1, "", Description(instance=name, host="here", ends=list(ends)), measures, **more)


WORLD = end("world", "serves", "world/Everything/divide")
HAND = end("hand", "calls", "world/Everything/divide", pid=2)
NEWS = end("world", "publishes", "world/Everything/news", traits="-")
EYE = end("eye", "subscribes", "*/Everything/news", pid=3)


def way(client: str, provider: str, channel: str, **more: Any) -> dict[str, Any]:
    verb = "subscribesTo" if channel.endswith("news") else "requires"
    told = {"client": client, "provider": provider, "channel": channel, "middleware": "near", "parts": [], "verb": verb}
    return told | more


def plan(*ways: dict[str, Any], hosts: dict[str, str] | None = None) -> dict[str, Any]:
    instances = ["world", "hand", "eye"]
    return {
        "name": "house",
        "ways": list(ways),
        "processes": [{"name": name, "instances": [name], "host": (hosts or {}).get(name, "")} for name in instances],
        "ours": {name: {"channels": name, "over": ["near 3"]} for name in instances},
    }


DIVIDE = way("hand", "world", "world/Everything/divide")
HEARD = way("eye", "world", "world/Everything/news")
THERE = [
    end(name, "serves", f"{name}/CommonBehavior/getState", pid=pid)
    for name, pid in (("world", 1), ("hand", 2), ("eye", 3))
]
