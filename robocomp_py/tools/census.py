"""Asks the middlewares which ends of channels there are."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any, TypeVar

from .. import installed
from ..errors import ConfigurationError, TransportError
from ..spelling import unknown
from ..transports.deployment import deployment_of, deployments
from .announced import told_by_transport
from .network import End, Network
from .programs import described

T = TypeVar("T")


@dataclass(frozen=True)
class Seen:
    """What processes announce, and what could not be looked at."""

    ends: list[End] = field(default_factory=list)
    """The interfaces of the framework included."""
    tellers: dict[str, frozenset[str]] = field(default_factory=dict)
    """The middlewares that could tell what uses them, by the host that was asked; "" is this one."""
    troubles: list[str] = field(default_factory=list)
    """What went wrong."""


def take_census(
    middlewares: Sequence[str] = (),
    *,
    own: bool = False,
    options: Mapping[str, Mapping[str, Any]] | None = None,
    meanwhile: Callable[[], object] = lambda: None,
) -> Network:
    """What runs now over these middlewares, by default over all that can tell.

    With `own`, the interfaces of the framework are shown, too. `options` are those of middlewares. `meanwhile` is
    called once all have been asked, since some have to wait for what others tell.

    Raises ConfigurationError if a named middleware cannot tell, and TransportError.
    """
    with installed.asked_once(), ExitStack() as asking:
        check_names(middlewares)
        ends: list[End] = []
        names = middlewares or _nearest_first(deployments())
        asked = [_asked(name, (options or {}).get(name, {}), asking) for name in names]
        meanwhile()
        for name, heard in zip(names, asked, strict=True):
            found = heard()
            if found is None and middlewares:
                raise ConfigurationError(f"{name} cannot tell what uses it")
            ends += found or ()
        ends += of_programs(middlewares, options)
    return Network(ends, own=own)


def take_files() -> Network:
    """What processes on this host announce in files, which can be read in no time, with the framework's interfaces."""
    return Network([End(transport, told) for transport, told in told_by_transport()], own=True)


def check_names(middlewares: Sequence[str]) -> None:
    """Raise ConfigurationError if one of these is not installed."""
    for name in middlewares:
        if name not in installed.transports():
            raise ConfigurationError(unknown("middleware", name, installed.transports()))


def take_each(middlewares: Sequence[str] = (), options: Mapping[str, Mapping[str, Any]] | None = None) -> Seen:
    """The same, but what goes wrong with one middleware is only told. By default, all middlewares are asked."""
    ends: list[End] = []
    tellers, troubles = [], []
    with installed.asked_once():
        for name in middlewares or _nearest_first(deployments()):
            try:
                check_names((name,))
                with ExitStack() as asking:
                    found = _asked(name, (options or {}).get(name, {}), asking)()
            except ConfigurationError:
                continue  # it is not installed
            except TransportError as exc:
                troubles.append(str(exc))
                continue
            if found is not None:
                ends += found
                tellers.append(name)
        ends += of_programs(middlewares, options)
    return Seen(ends, {"": frozenset(tellers)}, troubles)


def of_programs(middlewares: Sequence[str], options: Mapping[str, Mapping[str, Any]] | None = None) -> list[End]:
    """What programs serve that announce nothing, also on other hosts, as the networks that run here describe them."""
    return [
        End(
            each.middleware,
            each.told,
            each.host,
            options={**(options or {}).get(each.middleware, {}), **each.options},
            supplement=each.supplement,
        )
        for each in described()
        if not middlewares or each.middleware in middlewares
    ]


def _nearest_first(names: Iterable[str]) -> list[str]:
    """Middlewares that stay on one host come first, since they cost least there."""
    return sorted(names, key=lambda name: (deployment_of(name).near is None, name))


def _asked(middleware: str, options: Mapping[str, Any], asking: ExitStack) -> Callable[[], list[End] | None]:
    """The census of a middleware, begun until `asking` ends. The function waits for what it finds."""
    heard = _tried(middleware, lambda: asking.enter_context(deployment_of(middleware).asking(options)))

    def ends() -> list[End] | None:
        found = _tried(middleware, heard) if heard else None
        return None if found is None else [End(middleware, told, options=options) for told in found]

    return ends


def _tried(middleware: str, do: Callable[[], T]) -> T | None:
    try:
        return do()
    except ImportError:
        return None  # so no component on this host uses it
    except TransportError as exc:
        raise TransportError(f"{middleware}: {exc}") from exc
