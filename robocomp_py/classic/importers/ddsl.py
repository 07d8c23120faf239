"""Writes programs as a DDSL file, in the style of a person; comments hold what cannot be converted."""

from __future__ import annotations

import os
import re
import textwrap
import unicodedata
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from ...contract.interface import Verb
from ...deploy.hosts.addresses import is_own
from ...dsl.ddsl.hosts import is_address, is_user
from .finding import Finder, Found
from .programs import HERE, CommandLine, Listing, Program, Text, address, command_line

WIDTH = 120

_LEFT_OUT = (
    "Left out everywhere: data for rcmanager's window (positions, colours, configFile), and downCommand, because "
    "rcdeploy stops what it has started."
)


def to_ddsl(listing: Listing, finder: Finder, folder: Path) -> str:
    """The text of a file in that folder."""
    return "\n".join(_Writer(listing, finder, folder).lines()) + "\n"


@dataclass
class _Instance:
    program: Program
    name: str
    found: Found | None
    host: str = ""
    """The DDSL name of its host; "" for this host."""
    dependences: list[str] = field(default_factory=list)


class _Writer:
    def __init__(self, listing: Listing, finder: Finder, folder: Path) -> None:
        self._listing, self._finder, self._folder = listing, finder, folder
        self._ports: dict[tuple[str, str], str] = {}
        self._hosts: dict[str, str] = {}
        """The DDSL names of hosts, by their names in the file: `10.0.0.7`, or `robot@10.0.0.7`."""
        brokers = [each for each in listing.programs if _is_broker(each)]
        self._brokers = {each.name: each for each in brokers}
        self._instances = self._named([each for each in listing.programs if each not in brokers])

    def lines(self) -> Iterator[str]:
        yield from _comment(f"Made from {self._listing.path} by rcdeploy --import. This file is yours.")
        if self._listing.path.lower().endswith(".xml"):
            yield from _comment(_LEFT_OUT)
        yield from _remarks(self._listing.notes, "")
        for each in self._brokers.values():
            message = f"`{each.name}` is the broker of IceStorm; rcdeploy runs one where topics go over Ice"
            yield from _remarks([Text(message, each.line)], "")
        yield ""
        paths = {self._path(each.found.cdsl): None for each in self._instances if each.found}
        yield from (f'import "{path}";' for path in paths)
        if paths:
            yield ""
        yield f"Deployment {_identifier(PurePosixPath(self._listing.path).stem)}"
        yield "{"
        yield from self._host_blocks()
        for number, instance in enumerate(self._instances):
            if number or self._hosts:
                yield ""
            yield from self._component(instance)
        yield "};"

    def _host_blocks(self) -> Iterator[str]:
        """The other hosts. The `security` clause of a network on several hosts is left to the user."""
        if not self._hosts:
            return
        message = "On several hosts, say who may take part: `security lan;` (see rcdeploy keys), or `security open;`."
        yield from _comment(message, "    ")
        for number, (said, name) in enumerate(self._hosts.items()):
            user, _, where = said.rpartition("@")
            yield from ([""] if number else [])
            yield from (f"    host {name}", "    {", f"        address {_quoted(where)};")
            yield from [f"        user {_quoted(user)};"] if user else []
            yield "    };"

    # Names and dependences.

    def _named(self, programs: list[Program]) -> list[_Instance]:
        instances: list[_Instance] = []
        taken: set[str] = set()
        by_name: dict[str, _Instance] = {}
        for program in programs:
            wanted = _identifier(program.name)
            name, number = wanted, 1
            while name.lower() in taken:
                number += 1
                name = f"{wanted}_{number}"
            taken.add(name.lower())
            folder = program.folder or _folder_of(program)
            found = self._finder.component(folder) if folder else None
            if found and not _fits_quotes(self._path(found.cdsl)):
                program.notes.append(Text("the path of its .cdsl has characters that DDSL cannot quote", program.line))
                found = None
            instance = _Instance(program, name, found, self._host(program))
            if name != program.name:
                program.notes.append(Text(f"its name was `{program.name}`", program.line))
            by_name.setdefault(program.name, instance)
            instances.append(instance)
        for instance in instances:
            self._depend(instance, by_name)
            self._note_clash(instance, instances)
        return instances

    def _host(self, program: Program) -> str:
        """The name of a program's host; "" for this one."""
        where = address(program.endpoint.text) if program.endpoint else address("")
        said = program.host or where.host
        if program.host and where.host and program.host != where.host:
            program.notes.append(Text(f"its endpoint is on {where.host}", program.line))
        user, at, there = said.rpartition("@")
        if not there or there in HERE or is_own(there):
            return ""
        if not is_address(there) or (at and not is_user(user)):
            program.notes.append(Text(f"{said} is not the address of a host", program.line))
            return ""
        name = _identifier(there)
        return self._hosts.setdefault(said, name if name[0] != "_" else f"host{name}")

    def _note_clash(self, instance: _Instance, instances: list[_Instance]) -> None:
        """Note that two CDSL files describe components of the same name; a network can have only one of them."""
        for other in instances:
            if other.found and instance.found and other.found.name.lower() == instance.found.name.lower():
                if other.found.cdsl != instance.found.cdsl:
                    message = (
                        f"{self._path(other.found.cdsl)} also describes a `{other.found.name}`: rename one of them"
                    )
                    instance.program.notes.append(Text(message, instance.program.line))
                return

    def _depend(self, instance: _Instance, by_name: dict[str, _Instance]) -> None:
        notes = instance.program.notes
        for need in instance.program.needs:
            other = by_name.get(need.text)
            if other is None:
                if need.text not in self._brokers:
                    notes.append(Text(f"it depends on `{need.text}`, which does not exist", need.line))
            elif other is instance or _reaches(other, instance, by_name):
                notes.append(Text(f"it depends on `{need.text}`, which depends on it: left out", need.line))
            elif other.name not in instance.dependences:
                instance.dependences.append(other.name)

    # One component.

    def _component(self, instance: _Instance) -> Iterator[str]:
        found = instance.found
        same = found is None or found.name.lower() == instance.name.lower()
        yield f"    Component {instance.name}{'' if same or not found else f' : {found.name}'}"
        yield "    {"
        clauses, notes = list(self._clauses(instance)), instance.program.notes
        yield from _remarks(sorted(notes, key=lambda each: each.line), "        ")
        yield from (f"        {each};" for each in clauses)
        yield "    };"

    def _clauses(self, instance: _Instance) -> Iterator[str]:
        """The converted clauses; the rest is noted."""
        program = instance.program
        if instance.found is None:
            where = f"is in {program.folder}" if program.folder else "is there"
            message = f"no .cdsl {where}: write one with what it requires and implements, and import it"
            program.notes.append(Text(message, program.line))
        command = command_line(program.command.text) if program.command else None
        if program.command is None:
            program.notes.append(Text("nothing says how it is started", program.line))
        elif command is None:
            message = f"only a shell understands `{program.command.text}`: write it into a script, and give its path"
            program.notes.append(Text(message, program.command.line))
        elif instance.found and (command.python or instance.found.python):
            yield from self._python_component(program, program.command, command)
        else:
            yield from self._other_program(program.command, program, command)
            yield from self._over_ice(instance, command)
        if instance.host:
            yield f"host {instance.host}"
        yield from self._wirings(instance, command)
        if instance.dependences:
            yield f"dependences {', '.join(instance.dependences)}"
        yield from self._address(instance)

    def _python_component(self, program: Program, said: Text, command: CommandLine) -> Iterator[str]:
        """The clauses for a component in Python: only its configuration, because rcdeploy knows how to start it."""
        program.notes.append(Text(f"it was started by `{said.text}`", said.line))
        configurations = [each for each in map(_configuration, command.arguments) if each]
        others = [each for each in command.arguments if not _configuration(each)]
        for path in configurations[:1]:
            there = self._finder.here(self._joined(program, path))
            if there is None or not there.is_file():
                program.notes.append(Text(f"its configuration {path} is not on this machine", said.line))
            elif not _fits_quotes(self._path(there)):
                program.notes.append(
                    Text(f"the path of its configuration {path} has characters that DDSL cannot quote", said.line)
                )
            else:
                yield f"config {_quoted(self._path(there))}"
        if others or configurations[1:]:
            left = " ".join([*others, *configurations[1:]])
            program.notes.append(Text(f"the arguments {left} are left out", said.line))

    def _other_program(self, said: Text, program: Program, command: CommandLine) -> Iterator[str]:
        """The clauses for another program: its command is run by `env`, which searches the PATH as a shell does."""
        path, words = "/usr/bin/env", list(command.words)
        if program.folder:
            there = self._finder.here(program.folder)
            words.insert(0, f"--chdir={there.absolute() if there else self._finder.expanded(program.folder)}")
        elif words[0].startswith(("/", "~")):
            path, *words = words
            path = str(self._finder.here(path) or self._finder.expanded(path))
        if not all(map(_fits_quotes, (path, *words))):
            message = f"`{said.text}` has quotes, which DDSL cannot express: write it into a script, and give its path"
            program.notes.append(Text(message, said.line))
            return
        yield f'path "{path}"'
        if words:
            line = f"args {', '.join(map(_quoted, words))}"
            several = f",\n{' ' * len('        args ')}".join(map(_quoted, words))
            yield line if len(line) <= WIDTH - len("        ;") else f"args {several}"

    def _over_ice(self, instance: _Instance, command: CommandLine) -> Iterator[str]:
        """The clauses for a program that continues to use Ice."""
        if instance.found is None or not instance.found.model.ports:
            return
        yield "middleware ice"
        arguments = [path for path in map(_configuration, command.arguments) if path]
        there = self._finder.here(self._joined(instance.program, arguments[0])) if arguments else None
        if there and there.is_file() and _fits_quotes(self._path(there)):
            yield f"config {_quoted(self._path(there))}"

    def _wirings(self, instance: _Instance, command: CommandLine | None) -> Iterator[str]:
        """Sources of interfaces that several instances implement: the one whose port is in the configuration."""
        arguments = [path for path in map(_configuration, command.arguments if command else ()) if path]
        there = self._finder.here(self._joined(instance.program, arguments[0])) if arguments else None
        if instance.found is None or there is None or not there.is_file():
            return
        ports = _proxies(there.read_text(encoding="utf-8", errors="replace"))
        used: dict[str, int] = {}
        for item in instance.found.model.ports:
            if item.verb is Verb.REQUIRES:
                interface = item.interface.text
                label = f"{interface}{used.get(interface) or ''}"
                used[interface] = used.get(interface, 0) + 1
                offering = [each for each in self._instances if each is not instance and _implements(each, interface)]
                meant = [each.name for each in offering if _port(each.program) == ports.get(label)]
                if len(offering) > 1 and len(meant) == 1:
                    yield f"requires {label} from {meant[0]}"

    def _address(self, instance: _Instance) -> Iterator[str]:
        program = instance.program
        where = address(program.endpoint.text) if program.endpoint else address("")
        line = program.endpoint.line if program.endpoint else program.line
        if program.endpoint and not where.port:
            program.notes.append(Text(f"its endpoint {program.endpoint.text} has no port", line))
        if where.port and (len(where.port) > len("65535") or not 1 <= int(where.port) <= 65535):
            program.notes.append(Text(f"its port, {where.port}, is not from 1 to 65535", line))
        elif where.port:
            first = self._ports.setdefault((instance.host, where.port), instance.name)
            if first != instance.name:
                program.notes.append(Text(f"its port, {where.port}, is also the port of `{first}`", line))
                return
            if where.host in HERE and not instance.host:
                yield f"ip {where.host if re.fullmatch(r'[a-z]+', where.host) else _quoted(where.host)}"
            yield f"port {where.port}"

    # Paths.

    def _joined(self, program: Program, path: str) -> str:
        return path if path.startswith("~") else os.path.join(program.folder, path)

    def _path(self, path: Path) -> str:
        """The path relative to `folder`, unless that leads far up."""
        relative = os.path.relpath(path.absolute(), self._folder.absolute())
        return str(path.absolute()) if relative.startswith(os.path.join("..", "..", "..")) else relative


def _implements(instance: _Instance, interface: str) -> bool:
    items = instance.found.model.ports if instance.found else ()
    return any(each.verb is Verb.IMPLEMENTS and each.interface.text == interface for each in items)


def _port(program: Program) -> str:
    return address(program.endpoint.text).port if program.endpoint else ""


def _proxies(configuration: str) -> dict[str, str]:
    """The port of each proxy in a configuration of RoboComp: `Laser1Proxy = laser:tcp -p 10003`."""
    found = re.findall(
        r"^[ \t]*(?:Proxies\.)?(\w+?)(?:Proxy)?[ \t]*=[^#\n]*?-p[ \t]*(\d+)", configuration, re.MULTILINE
    )
    return dict(found)


def _is_broker(program: Program) -> bool:
    command = command_line(program.command.text) if program.command else None
    endpoint = program.endpoint.text if program.endpoint else ""
    return endpoint.startswith("IceStorm/") or (command is not None and command.name in ("rcnode", "icebox"))


def _reaches(start: _Instance, end: _Instance, by_name: dict[str, _Instance]) -> bool:
    """Whether one depends on another, directly or indirectly, by the dependences converted so far."""
    named = {each.name: each for each in by_name.values()}
    waiting, seen = [start], set[str]()
    while waiting:
        each = waiting.pop()
        if each is end:
            return True
        if each.name not in seen:
            seen.add(each.name)
            waiting += [named[name] for name in each.dependences if name in named]
    return False


def _folder_of(program: Program) -> str:
    """The folder of a program whose command has an absolute path; otherwise ""."""
    command = command_line(program.command.text) if program.command else None
    is_absolute = command is not None and command.file.startswith(("/", "~"))
    return str(PurePosixPath(command.file).parent) if command and is_absolute else ""


def _configuration(argument: str) -> str:
    """The configuration file that an argument of a RoboComp component names; "" if it names none."""
    if argument.startswith("--Ice.Config="):
        return argument.partition("=")[2]
    return "" if argument.startswith("-") else argument


def _identifier(text: str) -> str:
    """The valid name that is most similar to a text: `cámara` becomes `camara`."""
    bare = "".join(char for char in unicodedata.normalize("NFKD", text) if not unicodedata.combining(char))
    found = re.sub(r"[^A-Za-z0-9_]+", "_", bare).strip("_")
    return found if re.match(r"[A-Za-z_]", found) else f"_{found}"


def _fits_quotes(text: str) -> bool:
    """Whether DDSL can quote a text: it must have no quote and no line break."""
    return '"' not in text and "\n" not in text


def _quoted(text: str) -> str:
    return f'"{text}"'


def _remarks(notes: Iterable[Text], margin: str) -> Iterator[str]:
    for each in notes:
        yield from _comment(f"line {each.line}: {each.text}", margin)


def _comment(text: str, margin: str = "") -> Iterator[str]:
    """A wrapped comment. Characters that would end its line, or join it with the next, become blanks."""
    plain = "".join(char if char.isprintable() else " " for char in text)
    width = WIDTH - len(margin) - 3
    for line in textwrap.wrap(plain, width, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False):
        yield f"{margin}// {line}".rstrip("\\ ")
