"""`rc sim view` and `rc sim edit`: a scene in the browser."""

from __future__ import annotations

import argparse
import os
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from .common import FINE, WRONG, complain, show
from .completing import What, completed
from .live import Absent, add_middleware, port, reported

if TYPE_CHECKING:
    from ..sim.view.page import Page

_EXAMPLES = """\
examples:
  rc sim view house.xml     a scene; what is changed in its file is shown at once
  rc sim view house         the scene that runs in the network `house`, as it goes on
  rc sim view               ... in the network that runs here

Open the URL that it prints. It is for browsers on this machine, and only for those that know its token. Several may
look. Drag to look around, with the right button to move, turn the wheel to come nearer, and click a shape for what it
is. End it with Ctrl-C.

exit status: 0 done, 1 the scene is wrong or the port is taken, 2 usage, 130/143 by a signal
"""


VIEW_HELP = "show a scene in the browser, from a file or as it runs"


def add_view(to: argparse.ArgumentParser) -> None:
    to.description = "Serve a page that shows a scene: of a file, or of a component that runs. It changes nothing."
    to.epilog = _EXAMPLES
    what = to.add_argument("scene", nargs="?", default="", metavar="FILE.xml|NETWORK", help="a file, or what runs")
    completed(what, What.NETWORK)
    to.add_argument("--component", default="", metavar="NAME", help="which one, if several of a network have a scene")
    add_port(to)
    add_middleware(to)


def add_port(to: argparse.ArgumentParser) -> None:
    to.add_argument("--port", type=port, default=0, help="where to listen on 127.0.0.1 (default: any free port)")


EDIT_HELP = "edit the file of a scene in the browser"

_EDIT_EXAMPLES = """\
examples:
  rc sim edit house.xml               edit a scene
  rc sim edit house.xml --port 8800   ... at this port, for an SSH tunnel

Open the URL that it prints. Click a shape, or choose a node, then drag its arrows and rings, or edit its fields. Only
what was edited changes in the file, when it is saved. The first page that is opened edits; others look. A file that
something else has changed meanwhile is not overwritten.

exit status: 0 done, 1 the scene is wrong or the port is taken, 2 usage, 130/143 by a signal
"""


def add_edit(to: argparse.ArgumentParser) -> None:
    to.description = "Serve a page on which a scene is edited: positions, attributes, planes and meshes."
    to.epilog = _EDIT_EXAMPLES
    to.add_argument("scene", type=Path, metavar="FILE.xml", help="the scene; it has to exist")
    add_port(to)


def edit(options: argparse.Namespace) -> int:
    path: Path = options.scene
    if path.suffix.lower() != ".xml":
        return complain(f"rc sim edit: {path}: give it the file of a scene (.xml){_made(path)}")
    if not is_read(path):
        return WRONG
    with reported("rc sim edit") as code:
        from ..sim.view.desk import Desk
        from ..sim.view.editor import Editor
        from .replacing import replace_file

        editor = Editor(path, replace_file)
        return served(options.port, path.name, lambda page: Desk(page, editor, tell).follow, command="rc sim edit")
    return code()


def view(options: argparse.Namespace) -> int:
    if options.scene.lower().endswith(".xml"):
        return _view_file(Path(options.scene), options)
    return _view_network(options)


def _view_file(path: Path, options: argparse.Namespace) -> int:
    if not is_read(path):
        return WRONG
    with reported("rc sim view") as code:
        from ..sim.view.viewing import FileShow

        return served(options.port, path.name, lambda page: FileShow(page, path, tell).follow, command="rc sim view")
    return code()


def _view_network(options: argparse.Namespace) -> int:
    with reported("rc sim view") as code:
        from ..client.session import Session
        from ..sim.view.live import LiveShow, chosen
        from ..tools.census import check_names

        check_names(options.middleware)
        session = Session(network_named(options.scene), tuple(options.middleware), 5.0, owner="rc")
        try:
            name = chosen(session.census(), options.component)
            return served(
                options.port, name, lambda page: LiveShow(page, session, name, tell).follow, command="rc sim view"
            )
        finally:
            session.close()
    return code()


def network_named(text: str) -> str:
    """The name of a network, by its file or by itself; without a text, of the one that runs here, or "".

    Raises Absent and RobocompError.
    """
    from ..deploy.client import NotRunning, network_of, networks, not_running, running_plan
    from ..errors import ConfigurationError

    if Path(text).suffix not in ("", ".ddsl"):
        raise ConfigurationError(f"{text}: give it the file of a scene (.xml), or a network{_made(Path(text))}")
    running = networks()
    if text:
        name = network_of(text)
        if running_plan(name) is None:
            raise NotRunning(not_running(name, "start it with rcdeploy, or give the file of a scene (.xml)"))
        return name
    if len(running) > 1:
        raise Absent(f"several networks run here; name one of {', '.join(running)}")
    return "".join(running)


def _made(path: Path) -> str:
    """The command that makes a scene of a file that is not one; "" if none does."""
    return f"; to make one: rc sim import {path}" if path.suffix.lower() == ".urdf" else ""


def is_read(path: Path) -> bool:
    """Tell what `rc lint` tells of a scene; whether it can be read."""
    from .lint import check

    found = check([path])
    show(found)
    return not any(each.severity == "error" for each in found)


Follow = Callable[[threading.Event], None]
"""Goes on until the event is set."""


def served(number: int, title: str, begin: Callable[[Page], Follow], *, command: str) -> int:
    """Serve a page, print its address, and go on until Ctrl-C."""
    from ..sim.view.page import Page

    try:
        page = Page(title, number)
    except OSError as exc:
        print(f"{command}: port {number}: {os.strerror(exc.errno or 0)}; choose another --port", file=sys.stderr)
        return WRONG
    with page:
        follow = begin(page)
        print(page.url, flush=True)
        follow(threading.Event())
    return FINE


def tell(text: str) -> None:
    """A line for people, which may have texts of other programs."""
    from ..printable import printable

    print(printable(text), file=sys.stderr, flush=True)
