"""`rc param`: parameters of running components."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from .common import FINE, describe, print_table, sleep_while_read
from .completing import What, completed
from .hosts import add_hosts, hosts_of
from .live import (
    COMPONENT,
    EXIT_STATUS,
    Absent,
    add_json,
    add_middleware,
    add_waiting,
    awaited,
    check_component_of_one_host,
    components_named,
    count,
    positive,
    reported,
    say,
)

if TYPE_CHECKING:
    from concurrent.futures import Future

    from ..runtime.RoboCompIntrospection import Setting
    from ..tools.access import Access
    from ..tools.network import Network

NAME = "param"

_EXAMPLES = f"""\
examples:
  rc param list                          names and values, of all components or of some
  rc param describe wander               types, ranges, choices, comments; which can be changed now
  rc param get wander max_speed
  rc param set wander max_speed=0.8 motors[0].limit=3      all of them, or none if one is refused
  rc param watch wander                  print changes until Ctrl-C
  rc param dump wander > wander.yaml     as ROS 2 writes them (`/wander: ros__parameters:`)
  rc param load wander wander.yaml       set those that differ

Only dynamic parameters can be changed while a component runs.

{EXIT_STATUS}
"""


def add_arguments(to: argparse.ArgumentParser) -> None:
    to.description = "Show and change parameters. Each component checks a change itself, as it does its configuration."
    to.epilog = _EXAMPLES
    commands = to.add_subparsers(dest="does", metavar="COMMAND", required=True)

    def command(name: str, about: str, component: str | None = None) -> argparse.ArgumentParser:
        made = commands.add_parser(name, help=about)
        describe(made, about, to)
        named = made.add_argument("component", nargs=component, metavar="COMPONENT", help=COMPONENT)
        completed(named, What.COMPONENT)
        add_waiting(made)
        add_hosts(made)
        add_middleware(made)
        return made

    add_json(command("list", "list names and values", "*"))
    one = command("get", "print the value of one parameter")
    completed(one.add_argument("name", metavar="NAME", help="the parameter"), What.PARAMETER)
    add_json(one)
    several = command("set", "change parameters, all or none")
    completed(
        several.add_argument("values", nargs="+", metavar="NAME=VALUE", help="a parameter and its value"), What.SETTING
    )
    add_json(several)
    shown = command("describe", "show types, ranges, choices and comments")
    completed(
        shown.add_argument("name", nargs="?", default="", metavar="NAME", help="a parameter (default: all)"),
        What.PARAMETER,
    )
    add_json(shown)
    watched = command("watch", "print changes until Ctrl-C")
    watched.add_argument(
        "-n", "--count", dest="most", type=count, metavar="COUNT", help="end after this number of changes"
    )
    watched.add_argument("--for", dest="seconds", type=positive, metavar="SECONDS", help="end after this time")
    add_json(watched)
    command("dump", "print the parameters as a file of ROS 2", "+")
    loaded = command("load", "set those parameters of a file of ROS 2 that differ")
    loaded.add_argument("file", type=Path, metavar="FILE", help="a file of ROS 2, as `rc param dump` prints it")
    add_json(loaded)


@dataclass(frozen=True)
class _At:
    """The components that a command is about, and how they are reached."""

    access: Access
    network: Network
    names: list[str]
    deadline: float

    def settings(self, component: str) -> list[Setting]:
        from ..tools import params

        return params.read(self.access, self.network, component, self.deadline)

    def asked(self) -> dict[str, Future[list[Setting]]]:
        """The settings of all components, which are asked at the same time: one that hangs takes a whole deadline."""
        return {name: self.access.threads.submit(self.settings, name) for name in self.names}

    @property
    def one(self) -> str:
        if len(self.names) > 1:
            raise Absent(f"there are several: {', '.join(self.names)}; write more of the name")
        return self.names[0]


def run(options: argparse.Namespace) -> int:
    from ..tools import params
    from ..tools.access import Access

    does: dict[str, Callable[[_At, argparse.Namespace], int]] = {
        "list": _list,
        "get": _get,
        "set": _set,
        "describe": _describe,
        "watch": _watch,
        "dump": _dump,
        "load": _load,
    }
    wanted = [options.component] if isinstance(options.component, str) else options.component
    with reported(f"rc param {options.does}") as code, hosts_of(options) as hosts, Access() as access:

        def pick(network: Network) -> tuple[Network, list[str]]:
            try:
                found = components_named(params.components(network), wanted)
            except Absent as exc:
                raise ValueError(str(exc)) from exc
            for each in found if wanted else ():
                check_component_of_one_host(network, each)
            return network, found

        network, names = awaited(options, pick, hosts)
        try:
            return does[options.does](_At(access, network, names, options.timeout), options)
        except ValueError as exc:
            raise Absent(str(exc)) from exc
    return code()


def _list(at: _At, options: argparse.Namespace) -> int:
    from ..errors import RobocompError
    from ..tools import params

    rows = []
    for component, told in at.asked().items():
        try:
            found = told.result()
        except RobocompError as exc:
            say("rc param list", f"{component}: {exc}")
            continue
        for each in found:
            if options.json:
                print(json.dumps({"component": component, "name": each.name, "value": params.typed(each)}))
            rows.append((component, each.name, each.value, "dynamic" if each.editable else ""))
    if rows and not options.json:
        print_table(("component", "parameter", "value", ""), rows, wrapped=("value",))
    if not rows:
        named = at.one if options.component and len(at.names) == 1 else ""
        raise Absent(f"{named} has no parameters" if named else "no component here has parameters")
    return FINE


def _get(at: _At, options: argparse.Namespace) -> int:
    from ..tools import params

    found = _named(at.settings(at.one), options.name)
    told = {"component": at.one, "name": found.name, "value": params.typed(found)}
    print(json.dumps(told) if options.json else found.value)
    return FINE


def _set(at: _At, options: argparse.Namespace) -> int:
    from ..errors import ConfigurationError
    from ..tools import params

    texts: dict[str, str] = {}
    for each in options.values:
        name, equals, text = each.partition("=")
        if not equals or not name:
            hint = f"; write {'='.join(options.values)}" if len(options.values) == 2 else ""
            raise ConfigurationError(f"`{each}` is no NAME=VALUE{hint}")
        texts[name] = text
    params.change(at.access, at.network, at.one, texts, at.deadline)
    if options.json:
        _print_changed(at, texts)
    return FINE


def _print_changed(at: _At, names: Iterable[str]) -> None:
    """The values that these parameters have now, for machines."""
    from ..tools import params

    now = {each.name: each for each in at.settings(at.one)}
    for name in names:
        print(json.dumps({"component": at.one, "name": name, "value": params.typed(now[name])}))


def _describe(at: _At, options: argparse.Namespace) -> int:
    from ..tools import params

    found = at.settings(at.one)
    chosen = [_named(found, options.name)] if options.name else found
    if not chosen:
        raise Absent(f"{at.one} has no parameters")
    rows = []
    for each in chosen:
        comment = " ".join(each.comment.split())
        if options.json:
            print(json.dumps({"component": at.one, **params.plain(each)}))
        rows.append(
            (each.name, each.value, params.allowed(each), each.initial, "dynamic" if each.editable else "", comment)
        )
    if not options.json:
        print_table(("parameter", "value", "allowed", "default", "", "comment"), rows, wrapped=("allowed", "comment"))
    return FINE


_LOOK = 0.25
"""Seconds between two looks for changes."""


def _watch(at: _At, options: argparse.Namespace) -> int:
    from ..errors import Unreachable
    from ..tools import asking, params

    component = at.one
    known = {each.name: each.value for each in at.settings(component)}
    revision: int | None = None
    printed = 0
    begun = time.monotonic()
    while not options.seconds or time.monotonic() - begun < options.seconds:
        told = asking.measure(at.access, at.network, component, at.deadline)
        if told is None:
            raise Absent(f"{component} no longer tells of its parameters")
        if told.revision != revision:
            try:
                settings = at.settings(component)
            except Unreachable:  # it ends, or is started again: the next look tells
                sleep_while_read(_LOOK)
                continue
            revision = told.revision
            for each in settings:
                if known.get(each.name) != each.value:
                    known[each.name] = each.value
                    line = json.dumps({"name": each.name, "value": params.typed(each)})
                    print(line if options.json else f"{each.name} = {each.value}", flush=True)
                    printed += 1
                    if printed == options.most:
                        return FINE
        sleep_while_read(_LOOK)
    return FINE


def _dump(at: _At, options: argparse.Namespace) -> int:
    from ..tools import params

    print(params.to_yaml({name: told.result() for name, told in at.asked().items()}), end="")
    return FINE


def _load(at: _At, options: argparse.Namespace) -> int:
    from ..tools import params

    try:
        if options.file.stat().st_size > params.LONGEST_FILE:
            raise Absent(f"{options.file} is longer than {params.LONGEST_FILE} octets")
        text = options.file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as exc:
        raise Absent(f"{options.file}: {getattr(exc, 'strerror', None) or 'is not UTF-8 text'}") from exc
    try:
        given = params.from_yaml(text, at.one)
    except ValueError as exc:
        raise Absent(f"{options.file}: {exc}") from exc
    now = {each.name: each for each in at.settings(at.one)}
    changed = {name: text for name, text in given.items() if name not in now or _differs(now[name], text)}
    if changed:
        params.change(at.access, at.network, at.one, changed, at.deadline)
    if options.json:
        _print_changed(at, changed)
        return FINE
    for name, value in changed.items():
        print(f"{name} = {value}")
    return FINE


def _differs(setting: Setting, text: str) -> bool:
    from dataclasses import replace

    from ..tools import params

    return bool(params.typed(setting) != params.typed(replace(setting, value=text)))


def _named(found: list[Setting], name: str) -> Setting:
    from ..spelling import unknown

    known = {each.name: each for each in found}
    if name not in known:
        raise Absent(unknown("parameter", name, known))
    return known[name]
