"""What may follow on a command line: the words that an argument parser would accept next."""

from __future__ import annotations

import argparse
import os
import re
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from .common import FINE
from .completing import ASKED, Values, What
from .unsafe import help_of_commands

if TYPE_CHECKING:
    from ..contract.types import Field

Finder = Callable[[Sequence[str], str], tuple[argparse.ArgumentParser, Sequence[str]]]
"""Finds the parser for a word behind others, and those of the others that it reads."""

_REPEATED = type(argparse.ArgumentParser().add_argument("-x", action="append"))
_SUBCOMMANDS = type(argparse.ArgumentParser().add_subparsers())
"""Kinds of arguments: argparse has no public names for them."""


class Candidate(NamedTuple):
    text: str
    """A whole word; the name of a folder, and what needs more behind it, end with `/` or `=`."""
    about: str = ""


def answer(find: Finder, words: Sequence[str]) -> int:
    """Print what may stand in the place of the last word; return the exit code."""
    for line in answered(find, words, os.environ[ASKED]):
        print(line)
    return FINE


def answered(find: Finder, words: Sequence[str], shell: str) -> list[str]:
    """The lines for a shell. bash gives its line up to the cursor as one text, the others give words."""
    typed = _split(words[0] if words else "")[1:] if shell == "bash" else list(words)
    *before, word = typed or [""]
    parser, own = find(before, word)
    found = list(dict.fromkeys(candidates(parser, own, word)))
    if shell == "bash":
        cut = max(word.rfind("="), word.rfind(":")) + 1  # bash replaces only what is behind these
        return [each.text[cut:] for each in found]
    return [f"{each.text}\t{' '.join(each.about.split())}" if each.about else each.text for each in found]


def _split(line: str) -> list[str]:
    """The words of a line in a shell; the last one is what is being typed, and may be empty."""
    for closing in ("", "'", '"', "\\"):
        try:
            found = shlex.split(f"{line}{closing}")
        except ValueError:
            continue
        return found if line[-1:].strip() or closing else [*found, ""]
    return [""]


def candidates(parser: argparse.ArgumentParser, words: Sequence[str], word: str) -> Iterator[Candidate]:
    """What may stand for `word` behind `words`."""
    place = _Place(parser)
    for each in words:
        place.pass_by(each)
    option, equals, value = word.partition("=")
    if place.value_of:
        yield from _values(place.value_of, word, place.given)
    elif place.takes_options and equals and (action := place.option(option)) is not None:
        yield from (Candidate(f"{option}={each.text}", each.about) for each in _values(action, value, place.given))
    elif place.takes_options and word.startswith("-"):
        yield from place.options(word)
    elif place.positional is not None:
        yield from _values(place.positional, word, place.given)


_Given = Mapping[str, Sequence[str]]
"""The words before, by the argument that they are values of."""


class _Place:
    """Where the cursor is, seen from the words before it. argparse offers no public way to its arguments."""

    def __init__(self, parser: argparse.ArgumentParser) -> None:
        self._enter(parser)
        self.takes_options = True
        self.given: dict[str, list[str]] = {}

    def _enter(self, parser: argparse.ArgumentParser) -> None:
        self._actions: Sequence[Any] = parser._actions
        self._positionals = [each for each in self._actions if not each.option_strings]
        self._taken = 0
        """Words that the first of the positionals has got."""
        self._wanted: list[argparse.Action] = []
        """The option whose value comes next, as often as it takes values."""
        self._used: set[int] = set()

    @property
    def value_of(self) -> argparse.Action | None:
        return self._wanted[0] if self._wanted else None

    @property
    def positional(self) -> argparse.Action | None:
        return self._positionals[0] if self._positionals else None

    def option(self, text: str) -> argparse.Action | None:
        return next((each for each in self._actions if text in each.option_strings), None)

    def options(self, prefix: str) -> Iterator[Candidate]:
        """Those that may still be given; the short form only if a single hyphen has been typed."""
        for each in self._actions:
            if id(each) in self._used and not isinstance(each, _REPEATED):
                continue
            fitting = [text for text in each.option_strings if text.startswith(prefix)]
            if fitting and each.help != argparse.SUPPRESS:
                yield Candidate(max(fitting, key=len), _help(each))

    def pass_by(self, word: str) -> None:
        if self._wanted:
            del self._wanted[0]
        elif self.takes_options and word == "--":
            self.takes_options = False
        elif self.takes_options and word.startswith("-") and word != "-":
            name, equals, _ = word.partition("=")
            if action := self.option(name):
                self._used.add(id(action))
                number = action.nargs if isinstance(action.nargs, int) else 1
                self._wanted = [] if equals else [action] * number
        elif action := self.positional:
            self._take(action, word)

    def _take(self, action: Any, word: str) -> None:
        if isinstance(action, _SUBCOMMANDS):
            if word in action.choices:
                self._enter(action.choices[word])
            return
        self.given.setdefault(action.dest, []).append(word)
        self._taken += 1
        most = action.nargs if isinstance(action.nargs, int) else 1
        if action.nargs not in ("*", "+", argparse.REMAINDER) and self._taken >= most:
            del self._positionals[0]
            self._taken = 0


def _help(action: argparse.Action) -> str:
    return (action.help or "").partition(" (default")[0] % {"default": action.default, "prog": ""}


def _values(action: argparse.Action, word: str, given: _Given) -> Iterator[Candidate]:
    """The values of an argument that begin with a word."""
    if isinstance(action, _SUBCOMMANDS):
        about = help_of_commands(action)
        known: Iterable[Candidate] = (Candidate(each, about.get(each, "")) for each in action.choices or ())
    elif action.choices is not None:
        known = (Candidate(str(each)) for each in action.choices)
    else:
        known = _named(action, word, given)
    there = given.get(action.dest, ())
    yield from (each for each in known if each.text.startswith(word) and each.text not in there)


def _named(action: argparse.Action, word: str, given: _Given) -> Iterator[Candidate]:
    """The values of an argument that has no choices."""
    metavar = action.metavar if isinstance(action.metavar, str) else ""
    by: tuple[Values, ...] = vars(action).get("completed", ())
    endings = [each for each in by if isinstance(each, str) and not isinstance(each, What)]
    if not by and metavar in ("DIR", "FOLDER"):
        by = (What.FOLDER,)
    elif not by and (found := re.fullmatch(r"\w+(\.[a-z]+)", metavar)):
        endings = [found[1]]
    for each in by:
        if isinstance(each, What):
            yield from _names(each, word, given)
        elif not isinstance(each, str):
            yield from (Candidate(*pair) for pair in each.items())
    if endings or (not by and action.type is Path):
        yield from _files(word, endings)


def _names(what: What, word: str, given: _Given) -> Iterator[Candidate]:
    match what:
        case What.FOLDER:
            yield from _files(word, None)
        case What.NETWORK:
            from ..deploy.client import networks

            yield from (Candidate(name, "a network that runs") for name in networks())
            yield from _files(word, [".ddsl"])
        case What.HOST:
            from ..deploy.client import networks, running_plan
            from .hosts import HERE

            plans = (running_plan(name) or {} for name in networks())
            hosts = dict.fromkeys(str(each["name"]) for plan in plans for each in plan.get("hosts", ()))
            yield from (Candidate(name, "a host of a network that runs") for name in hosts)
            yield Candidate(HERE, "this machine")
        case What.CHECK:
            from ..tools.doctor.checks import CHECKS

            yield from (Candidate(each.NAME, each.HELP) for each in CHECKS)
        case What.MIDDLEWARE:
            from .. import installed

            yield from map(Candidate, installed.transports())
        case What.COMPONENT:
            from ..tools import announced

            yield from map(Candidate, announced.components(announced.told_in_files(), word))
        case What.ACTION:
            from ..tools import announced

            served = announced.channels(announced.told_in_files(), ("serves",))
            actions = [each.removesuffix("-start") for each in served if each.endswith("-start")]
            yield from map(Candidate, announced.fitting(actions, word))
        case What.CODE:
            from ..dsl.explanations import codes

            yield from map(Candidate, codes())
        case What.RECORDED:
            yield from _recorded(given.get("recording", ()), word)
        case What.INSTANCE:
            yield from _instances(given.get("network", ()))
        case What.DECLARED:
            yield from _declared([*given.get("network", ()), *given.get("words", ())])
        case What.FIELD:
            named = [*given.get("operation", ()), *given.get("topic", ()), *given.get("action", ())]
            yield from _fields(named, given.get("arguments", ()), word, of_action="action" in given)
        case What.PARAMETER | What.SETTING:
            yield from _parameters(given.get("component", ()), word, to_set=what is What.SETTING)
        case What.CHANNEL | What.TOPIC | What.CALLABLE:
            from ..tools import announced

            found = announced.channels(announced.told_in_files(), _ROLES[what])
            yield from map(Candidate, announced.fitting(found, word))


def _instances(networks: Iterable[str]) -> Iterator[Candidate]:
    """The instances, processes and systems of networks that run."""
    from ..deploy.client import network_of, running_plan
    from ..errors import DeploymentError

    for each in networks:
        try:
            plan = running_plan(network_of(each)) or {}
        except DeploymentError:
            continue
        for process in plan.get("processes", ()):
            names = [str(name) for name in process["instances"]]
            systems = [name.rsplit("/", up)[0] for name in names for up in range(1, name.count("/") + 1)]
            yield from map(Candidate, [*names, str(process["name"])])
            yield from (Candidate(name, "a system") for name in systems)


def _declared(paths: Iterable[str]) -> Iterator[Candidate]:
    """The instances in the files of networks."""
    from ..dsl.workspace import Workspace

    for each in paths:
        model = Workspace().deployment(Path(each).expanduser())
        for instance in model.instances if model else ():
            yield Candidate(str(instance.name), str(instance.kind or ""))


def _fields(named: Sequence[str], before: Sequence[str], word: str, *, of_action: bool) -> Iterator[Candidate]:
    """`NAME=` for each field of the channel or action that was named, `A.B=` within a struct; then the values it is one
    of."""
    from ..contract.types import BOOL, Enumeration, spell

    taken = {each.partition("=")[0] for each in before}
    try:
        leaves = list(_leaves(_inputs(named[0], of_action=of_action))) if named else []
    except ValueError:
        return  # a shell can show no error
    for path, field in leaves:
        kind = field.type
        if path in taken:
            continue
        if not word.startswith(f"{path}="):
            about = spell(kind).replace("::", ".")
            yield Candidate(f"{path}=", f"{about}; {field.doc}" if field.doc else about)
        elif isinstance(kind, Enumeration):
            yield from (Candidate(f"{path}={name}") for name, _ in kind.members)
        elif kind is BOOL:
            yield from (Candidate(f"{path}={value}") for value in ("true", "false"))


def _inputs(name: str, *, of_action: bool) -> Sequence[Field]:
    """The fields that a channel or an action takes; none if several channels have this name.

    Raises ValueError if no channel or action has it.
    """
    from ..tools import actions
    from ..tools.census import take_files

    network = take_files()
    if of_action:
        return actions.named(network, name).action.inputs
    found = network.named(name)
    return found[0].operation.inputs if len(found) == 1 else ()


def _leaves(fields: Iterable[Field], above: str = "") -> Iterator[tuple[str, Field]]:
    """All fields but structs, whose own fields are meant instead, with their paths."""
    from ..contract.types import Struct

    for each in fields:
        path = f"{above}{each.name}"
        if isinstance(each.type, Struct):
            yield from _leaves(each.type.fields, f"{path}.")
        else:
            yield path, each


def _recorded(paths: Iterable[str], word: str) -> Iterator[Candidate]:
    """The topics of a recording."""
    from ..errors import RobocompError
    from ..tools import announced
    from ..tools.recording.reader import Recording

    for each in paths:
        try:
            with Recording(Path(each).expanduser()) as recording:
                yield from map(Candidate, announced.fitting(recording.topics, word))
        except RobocompError:
            return  # a shell can show no error


_ASKING_S = 1.0
"""Seconds that a component has to tell its parameters: a person waits for them."""


def _parameters(components: Sequence[str], word: str, *, to_set: bool) -> Iterator[Candidate]:
    """The parameters of the component that was named, or `NAME=` and then the values that it takes."""
    from ..errors import RobocompError
    from ..tools import params
    from ..tools.access import Access
    from ..tools.census import take_files

    network = take_files()
    known = params.components(network)
    meant = [each for each in known if f"/{each}".endswith(f"/{components[0]}")] if components else []
    if len(meant) > 1:
        meant = [each for each in meant if each == components[0]]
    if not meant:
        return
    try:
        with Access() as access:
            found = params.read(access, network, meant[0], _ASKING_S)
    except (RobocompError, ValueError):
        return  # a shell can show no error
    for each in found:
        about = f"{each.value}; {params.allowed(each)}" + (f"; {each.comment}" if each.comment else "")
        if not to_set:
            yield Candidate(each.name, about)
        elif each.editable and word.startswith(f"{each.name}="):
            values = each.choices or (("true", "false") if each.type == "bool" else ())
            yield from (Candidate(f"{each.name}={value}") for value in values)
        elif each.editable:
            yield Candidate(f"{each.name}=", about)


_ROLES = {
    What.CHANNEL: ("publishes", "subscribes", "serves", "receives"),
    What.TOPIC: ("publishes", "subscribes"),
    What.CALLABLE: ("serves", "receives"),
}
"""Of the ends of channels that are meant."""


def _files(typed: str, endings: Sequence[str] | None) -> Iterator[Candidate]:
    """Folders, and the files with one of these endings. An empty list means all files, and None means no files.

    Hidden ones need their dot to be typed.
    """
    folder, _, start = typed.rpartition("/")
    before = typed[: len(typed) - len(start)]
    try:
        found = sorted(os.scandir(os.path.expanduser(before) if folder or before else "."), key=lambda each: each.name)
    except OSError:
        return
    for each in found:
        if not each.name.startswith(start) or (each.name.startswith(".") and not start):
            continue
        if each.is_dir():
            yield Candidate(f"{before}{each.name}/")
        elif endings is not None and (not endings or each.name.lower().endswith(tuple(endings))):
            yield Candidate(before + each.name)
