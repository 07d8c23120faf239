"""`offers front : Laser, LaserPub port 10003;`: the named instances of a component."""

from __future__ import annotations

from collections.abc import Iterator

from ..diagnostics import Report
from ..source import Name
from . import model as m

_NAMED, _INSTANCE = "named instance", "instance"


def check_offers(model: m.Deployment, report: Report) -> None:
    """Check that named instances have names of their own, and list each interface once."""
    seen: dict[str, tuple[str, m.Instance, Name]] = {}
    for what, instance, name in _names(model):
        first, owner, at = seen.setdefault(name.text, (what, instance, name))
        is_own = owner is instance and first is _INSTANCE  # an instance may offer its own name
        if at is name or is_own or what is _INSTANCE:  # which is checked with the systems
            continue
        if first is _INSTANCE:
            message, hint = f"`{name}` is the name of an instance, too", "rename one of them"
        elif owner is instance:
            message, hint = f"`{name}` is offered twice", "list the interfaces in one: offers NAME : Laser, LaserPub;"
        else:
            message = f"`{name}` is offered by `{owner.name}`, too"
            hint = "rename one of them, or put each component into a `System` of its own"
        report.error("duplicate", message, name.span, hint, ("first here", at.span))
    systems = {each.name.text: each.name for each in model.systems}
    for offer in (each for instance in model.instances for each in instance.offers):
        if system := systems.get(offer.name.text):
            message = f"`{offer.name}` is the name of a system, too"
            report.error("duplicate", message, offer.name.span, "rename one of them", ("the system", system.span))
        _check_interfaces(offer, report)


def _names(model: m.Deployment) -> Iterator[tuple[str, m.Instance, Name]]:
    """Those of instances come first."""
    yield from ((_INSTANCE, instance, instance.name) for instance in model.instances)
    yield from ((_NAMED, instance, offer.name) for instance in model.instances for offer in instance.offers)


def _check_interfaces(offer: m.Offer, report: Report) -> None:
    seen: dict[str, Name] = {}
    for name in offer.interfaces:
        first = seen.setdefault(name.text, name)
        if first is not name:
            message = f"`{offer.name}` offers `{name}` twice"
            report.error("duplicate", message, name.span, "remove one of them", ("first here", first.span))
