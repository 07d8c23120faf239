"""The command line of a component, and the checked settings that it, the environment and its configuration give."""

from __future__ import annotations

import argparse
import contextlib
import faulthandler
import inspect
import logging
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from .. import installed
from ..arguments import Parser
from ..contract.component import MAX_SECONDS, Component
from ..contract.middleware import carrier
from ..errors import ConfigurationError
from ..transports.base import find_transport
from ..version import __version__
from . import settings
from .commonbehavior import port_of
from .ending import GRACE
from .keys import is_assignment
from .settings import Settings
from .worker import Worker

log = logging.getLogger("robocomp.worker")

_MOST_LISTED = 8
"""Maximum number of keys without effect that the start lists; `rc lint` lists all."""


def exit_code(*every: argparse.Namespace) -> int:
    """The exit code if components could not be configured: 2 if a middleware does not exist, else 1."""
    named = {carrier(each.middleware, "") for each in every} - {""}
    return 1 if named <= installed.transports().keys() else 2


def parser_of(component: Component) -> argparse.ArgumentParser:
    """The parser for the command line of a component."""
    name = component.name
    parser = Parser(
        prog=f"rc run {name}",
        description=f"{component.description or f'Run the component {name}.'} Stop it with Ctrl-C or SIGTERM.",
        epilog="Every key of the configuration can be set with --set component.period=0.02 --set params.NAME=VALUE, or "
        "in the environment with ROBOCOMP__COMPONENT__PERIOD=0.02. The command line overrides the environment, which "
        "overrides the file.",
        formatter_class=argparse.HelpFormatter,
    )
    parser.add_argument(
        "--config",
        type=Path,
        metavar="FILE",
        help="configuration file (default: the one in etc/ of the component's folder)",
    )
    parser.add_argument("--name", help=f"name of this instance (default: {name.lower()})")
    parser.add_argument("--middleware", help="middleware that carries its messages, like the key `middleware`")
    parser.add_argument(
        "--set", action="append", default=[], type=_assignment, metavar="KEY=VALUE", help="set one key; may be repeated"
    )
    parser.add_argument(
        "--keys", metavar="FOLDER", help="keys for connections between hosts, as made by `rcdeploy keys`"
    )
    parser.add_argument(
        "--grace",
        type=_grace,
        metavar="SECONDS",
        help=f"time to stop after a request, before the process is ended by force (default: {GRACE:g})",
    )
    parser.add_argument(
        "--print-config",
        action="store_true",
        help="print the effective configuration and where each value comes from, and exit",
    )
    parser.add_argument("--json", action="store_true", help="with --print-config: one JSON object per key")
    parser.add_argument("--version", action="version", version=f"robocomp_py {__version__}")
    return parser


def read_plain(arguments: Sequence[str]) -> argparse.Namespace | None:
    """Parse arguments that consist of options with values only, as rcdeploy writes them; None for any other.

    The result equals that of `parser_of`. A process of many components saves memory this way: a parser takes a quarter
    of the memory of a component.
    """
    options = argparse.Namespace(
        config=None, name=None, middleware=None, set=[], keys=None, grace=None, print_config=False, json=False
    )
    if len(arguments) % 2:
        return None
    for option, value in zip(arguments[::2], arguments[1::2], strict=True):
        match option:
            case _ if value.startswith("-") or not value.strip():
                return None
            case "--set" if is_assignment(value):
                options.set.append(value)
            case "--config":
                options.config = Path(value)
            case "--name" | "--middleware" | "--keys":
                setattr(options, option.removeprefix("--"), value)
            case _:
                return None
    return options


def _assignment(text: str) -> str:
    """The argument of `--set`, if its form is valid."""
    if not is_assignment(text):
        raise argparse.ArgumentTypeError(f"`{text}` is not key=value, as in --set params.max_speed=0.5")
    return text


def _grace(text: str) -> float:
    try:
        seconds = float(text)
    except ValueError:
        seconds = -1.0
    if not 0 < seconds <= MAX_SECONDS:
        raise argparse.ArgumentTypeError(
            f"`{text}` is not a number of seconds above 0 and up to {MAX_SECONDS:g}, as in --grace 10"
        )
    return seconds


def prepare(worker_class: type[Worker[Any]], options: argparse.Namespace) -> tuple[Settings, settings.Document]:
    """The checked settings of a component, given its options, and the document that holds them.

    Raises ConfigurationError.
    """
    document = _document(worker_class, options)
    chosen = settings.check(worker_class.component, document, options.name)
    _check_middlewares(worker_class, chosen, document)
    return chosen, document


def _document(worker_class: type[Worker[Any]], options: argparse.Namespace) -> settings.Document:
    component = worker_class.component
    path = options.config or settings.find(worker_class._home or Path(inspect.getfile(worker_class)).parent)
    document = settings.read_for(_short(path), component) if path else settings.Document(params=component.params)
    document.passed_on = worker_class._takes_any_params and component.params is None
    settings.environment(document, component, os.environ)
    for assignment in options.set:
        settings.override(document, assignment)
    if options.middleware:
        origin = f"--middleware {options.middleware}"
        settings.override(document, f"middleware={options.middleware}", origin)
    if options.keys:
        _set_keys(document, options.keys)
    settings.settle(document, component, worker_class.middleware)
    return document


def _set_keys(document: settings.Document, folder: str) -> None:
    from ..transports.deployment import deployments  # only a component with keys needs these
    from .effective import toml

    if not Path(folder).is_dir():
        raise ConfigurationError(f"--keys {folder}: no such folder; create it with `rcdeploy keys`")
    for transport in (name for name, each in deployments().items() if each.keyed):
        value = toml(str(Path(folder).absolute()))
        settings.override(document, f"transports.{transport}.keys={value}", f"--keys {folder}")


def print_config(
    worker_class: type[Worker[Any]], chosen: Settings, document: settings.Document, *, as_json: bool
) -> None:
    from . import effective  # only --print-config needs it

    found = effective.effective(worker_class.component, chosen, document, worker_class.middleware)
    print(effective.as_json(found) if as_json else effective.as_toml(found), end="")


def tell_notes(document: settings.Document) -> None:
    """Log renamed keys, and how the lines of a file in a foreign format were read."""
    other = {"config.toml": "config", "config": "config.toml"}.get(document.path.name) if document.path else None
    if document.path and other and document.path.with_name(other).is_file():
        unread = document.path.with_name(other)
        log.info("%s is not read, because %s exists; to read it: --config %s", unread, document.path, _short(unread))
    for each in document.renamed:
        log.warning("%s: %s", each.origin or document.place(each.key), each.message)
    for note in document.notes:
        if not note.understood:
            log.warning("%s:%d: %s", document.path, note.line, note.why)
    idle = [
        note.key
        for note in document.notes
        if note.understood and not note.became and not (note.undeclared and document.passed_on)
    ]
    if document.notes:
        more = f" and {len(idle) - _MOST_LISTED} more" if len(idle) > _MOST_LISTED else ""
        shown = f"{', '.join(idle[:_MOST_LISTED])}{more}"
        log.info("configured by %s, written for RoboComp; without effect here: %s", document.path, shown or "nothing")


def _short(path: Path) -> Path:
    """The path relative to the working directory, if it is below it."""
    try:
        return path.resolve().relative_to(Path.cwd())
    except ValueError:
        return path


def _check_middlewares(worker_class: type[Worker[Any]], chosen: Settings, document: settings.Document) -> None:
    """Check that every middleware named is installed, and that those in use can be imported.

    Raises ConfigurationError with the place of the first that is not.
    """
    used = _middlewares(worker_class, chosen)
    for key, middleware in settings.middlewares(chosen).items():
        try:
            if middleware in used or middleware not in installed.transports():
                find_transport(middleware)
        except ConfigurationError as exc:
            raise ConfigurationError(f"{document.place(key)}: {exc}") from exc
    for middleware in sorted(used):
        find_transport(middleware)


def _middlewares(worker_class: type[Worker[Any]], chosen: Settings) -> set[str]:
    """The middlewares that its operations use, including those of `CommonBehavior`."""
    component, generated_for = worker_class.component, worker_class.middleware
    routed = {
        middleware
        for port in component.ports
        for operation in port.interface.called(port.verb)
        for middleware in chosen.middlewares(port, operation, generated_for)
    }
    return routed | {carrier(chosen.middleware, generated_for)} if port_of(component) else routed


def configure_logging(chosen: Settings) -> None:
    tell_where_on_abort()
    launched = "NOTIFY_SOCKET" in os.environ  # then the launcher adds time and name
    form = "%(levelname)s: %(message)s" if launched else f"%(asctime)s {chosen.instance} %(levelname)s: %(message)s"
    logging.basicConfig(level=chosen.log.upper(), format=form, datefmt="%H:%M:%S", stream=sys.stderr)
    log_records(lambda record: chosen.instance)


def log_records(instance: Callable[[logging.LogRecord], str]) -> None:
    """If a launcher reads records, write them instead of text. `instance` returns the component that logs one."""
    if "ROBOCOMP_RECORDS" not in os.environ:  # `records.WANTED`, which is not imported for nothing
        return
    from .records import RecordFormatter, wanted

    if wanted():
        for handler in logging.getLogger().handlers:
            handler.setFormatter(RecordFormatter(instance))


def tell_where_on_abort() -> None:
    """Print the stacks of all threads on SIGABRT, which watchdogs send, and on crashes of native code."""
    with contextlib.suppress(ValueError, OSError):  # stderr is closed
        faulthandler.enable()
