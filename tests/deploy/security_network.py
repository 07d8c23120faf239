"""A network as the tests of its security have it: a camera, who may use it, and who may not."""

from __future__ import annotations

import datetime
from pathlib import Path

from robocomp_py.contract.interface import Verb
from robocomp_py.deploy.auto import Way
from robocomp_py.deploy.keys import Made, make_keys
from robocomp_py.deploy.plan import Plan, Security
from robocomp_py.deploy.process import Process
from robocomp_py.transports.zenoh.deployment import router as zenoh_router

NOW = datetime.datetime.now(datetime.UTC).replace(microsecond=0)
DAY = datetime.timedelta(days=1)


def way(
    client: str, provider: str, operation: str, verb: Verb = Verb.REQUIRES, channel: str = "", looked_up: str = ""
) -> Way:
    name = channel or f"robot/{provider.rpartition('/')[2]}/Everything/{operation}"
    return Way(client, "Everything", provider, verb, "Everything", operation, "zeromq", "test", name, looked_up or name)


def process(name: str, host: str = "") -> Process:
    command = ("python", "-m", "robocomp_py.cli.rc", "run", f"/components/{name}", "--name", name)
    return Process(name, name.title(), command, Path("/"), host=host)


def network(*ways: Way, names: tuple[str, ...] = ("camera", "viewer", "other"), router: str = "") -> Plan:
    """`router`: where its router on this machine listens."""
    helpers = (zenoh_router("", {"router": {"listen/endpoints": [router]}}, *addressed(router)),) if router else ()
    return Plan(
        "Patrol",
        "zeromq",
        tuple(process(name) for name in names),
        (),
        ways=ways or (way("viewer", "camera", "divide"),),
        security=Security.LAN,
        helpers=helpers,
    )


def addressed(*endpoints: str) -> list[str]:
    """The hosts of endpoints."""
    return [each.partition("/")[2].rpartition(":")[0] for each in endpoints]


def made(
    plan: Plan, folder: Path, *, days: float = 365, renew: bool = False, now: datetime.datetime = NOW
) -> list[Made]:
    return list(make_keys(plan, folder, now, days=days, renew=renew))
