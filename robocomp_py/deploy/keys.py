"""Keys, certificates and permissions of a network: its processes, and the channels that each may use, from its graph.

    KEYS/                         0700, as all folders; files 0600
      ca/                         the authority of this deployment; its key never leaves this folder
        ca.pem  ca.key
      PROCESS/                    for each process, called as in the network, `left.arm` for `left/arm`; all it gets
        identity.json             its name, and a number that no other process of the network has
        ca.pem  certificate.pem  key.pem
        curve.key  curve.key_secret
        admitted/CLIENT.key       public keys of its clients, with the channels that they use
        peers/PROVIDER.key        those of the instances that it uses, likewise
      operator@/                  the same for tools; made only by `--operator`
      router@HOST/                for each host with a helper (`router@` on the machine that launches)
        ca.pem  certificate.pem  key.pem

A process has one identity, since its instances share what they open. Missing, expired and soon expiring files are made
again; the permissions always follow the graph, and the keys of removed instances are deleted.
"""

from __future__ import annotations

import contextlib
import datetime
import hashlib
import json
import os
import shutil
import stat
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..contract.interface import Verb
from ..errors import DeploymentError
from ..transports.deployment import deployments
from ..transports.keyfiles import read_public
from ..transports.permissions import OPERATOR, Edge, Graph, Principal, common_name, file_name, router_name
from . import certificates
from .certificates import Certificate, Issued

if TYPE_CHECKING:
    from .plan import Allowed, Plan

DAYS = 365.0
"""Default validity of certificates, in days."""

EXPIRES_SOON = datetime.timedelta(days=30)
"""Time before the end from which on certificates are made again; those with a shorter life, in its last third."""

_OF_EACH = "ca.pem", "certificate.pem", "key.pem"
_OF_PROCESS = *_OF_EACH, "curve.key", "curve.key_secret", "identity.json"
_NUMBERS = 0x10000


@dataclass(frozen=True)
class Made:
    """A file or folder: what it is, whether it is new, and until when it is valid (None: for ever)."""

    what: str
    is_new: bool
    expires: datetime.datetime | None


def graph_of(plan: Plan, *, operator: bool = False) -> Graph:
    """The allow-list: the channels that the processes of a network are wired to, and nothing else.

    With an operator, there is one more member, which may hear all topics, ask what components are and count, and call
    what the network allows tools to call.
    """
    process_of = {instance: process.name for process in plan.processes for instance in process.instances}
    found = dict.fromkeys(
        Edge(
            process_of.get(way.client, ""),
            process_of.get(way.provider, ""),
            way.provider,
            way.channel + behind,
            verb,
            way.looked_up + behind,
        )
        for way in plan.ways
        for behind, verb in way.parts or (("", way.verb),)
    )
    edges = tuple(edge for edge in found if edge.client != edge.provider)
    inner = tuple(edge for edge in found if edge.client == edge.provider)
    prefixes: dict[str, dict[str, None]] = {}
    for way in plan.ways:
        prefixes.setdefault(process_of[way.provider], {})[way.channel.rpartition("/")[0].rpartition("/")[0]] = None
    principals = tuple(
        Principal(each.name, each.instances, each.host, tuple(prefixes.get(each.name, ()))) for each in plan.processes
    )
    routers = {each.host or "": frozenset(each.addresses) for each in plan.helpers if each.addresses}
    if operator:
        home = "" if "" in routers else next(iter(routers), "")
        principals = (*map(partial(_observed, plan), principals), Principal(OPERATOR, (), home))
        edges = (*edges, *_of_operator(plan, process_of))
    return Graph(plan.name, principals, edges, routers, inner)


_ASKED = "describe", "measure", "watch"
"""What an operator may ask of `Introspection`. The rest changes components."""


def _of_operator(plan: Plan, process_of: Mapping[str, str]) -> Iterator[Edge]:
    for instance, ours in plan.ours.items():
        provider = process_of[instance]
        asked = [(f"{ours.channels}/Introspection/{name}", Verb.REQUIRES) for name in _ASKED]
        told = [f"{ours.channels}/IntrospectionPub/{name}" for name in ("called", "logged")]
        heard = [(channel, Verb.SUBSCRIBES) for channel in (*told, *ours.topics)]
        for channel, verb in (*asked, *heard):
            yield Edge(OPERATOR, provider, instance, channel, verb, channel)
    for each in plan.allow:
        for behind, verb in _PARTS.get(each.kind, ()) if each.instance in plan.ours else ():
            channel = f"{_prefix(plan, each)}/{each.interface}/{each.operation}{behind}"
            yield Edge(OPERATOR, process_of[each.instance], each.instance, channel, verb, channel)


_PARTS: Mapping[str, Sequence[tuple[str, Verb]]] = {
    "call": (("", Verb.REQUIRES),),
    "goal": (
        *((f"-{part}", Verb.REQUIRES) for part in ("start", "result", "cancel")),
        *((f"-{part}", Verb.SUBSCRIBES) for part in ("feedback", "status")),
    ),
}
"""What a client needs of what is allowed, by its kind. A publication needs the name of another publisher."""


def _prefix(plan: Plan, allowed: Allowed) -> str:
    """What the channel of an operation begins with. A named instance stands beside the one that offers it."""
    channels = plan.ours[allowed.instance].channels
    return "/".join(filter(None, (channels.rpartition("/")[0], allowed.named))) if allowed.named else channels


def _observed(plan: Plan, principal: Principal) -> Principal:
    """A process that an operator looks at: all its instances provide something."""
    mine = [each for each in principal.instances if each in plan.ours]
    own = [plan.ours[each].channels for each in mine]
    own += [_prefix(plan, each) for each in plan.allow if each.instance in mine]
    return replace(principal, channels=tuple(dict.fromkeys((*principal.channels, *own))))


def has_operator(folder: Path) -> bool:
    """Whether keys of an operator were made there."""
    return (folder / OPERATOR / "certificate.pem").is_file()


def make_keys(
    plan: Plan,
    folder: Path,
    now: datetime.datetime,
    *,
    days: float = DAYS,
    renew: bool = False,
    operator: bool | None = None,
) -> tuple[Made, ...]:
    """Make what is missing, expired or soon to expire; with `renew`, everything except the authority.

    `operator`: whether tools get keys; None: if they had some. Raises DeploymentError.
    """
    graph = graph_of(plan, operator=has_operator(folder) if operator is None else operator)
    try:
        return tuple(_Maker(graph, folder, now, days, renew).make())
    except OSError as exc:
        raise DeploymentError(f"keys: {exc.filename or folder}: {exc.strerror}") from exc


def troubles(
    plan: Plan, folder: Path, now: datetime.datetime, network: str = "NET.ddsl"
) -> tuple[list[str], list[str]]:
    """The errors that keep a network from starting with the keys in a folder, and warnings.

    `network` is the file as the command line names it, with all options that change what is planned.
    Raises DeploymentError.
    """
    graph = graph_of(plan, operator=has_operator(folder))
    errors: list[str] = []
    warnings: list[str] = []
    again = f"run: rcdeploy keys {network} -o {folder}"
    if not folder.is_dir():
        return [f"there are no keys in {folder}; {again}"], []
    if stat.S_IMODE(folder.stat().st_mode) & 0o077:
        errors.append(f"{folder} is open to other users; chmod 700 {folder}")
    owners = [(each.folder, each.name) for each in graph.principals]
    owners += [(router_name(host), router_name(host)) for host in graph.routers]
    for name, what in owners:
        found = _certificate(folder / name / "certificate.pem")
        if found and not _is_signed(folder, name):
            errors.append(f"the certificate of `{what}` was not issued by the authority in {folder / 'ca'}; {again}")
        elif found is None:
            errors.append(f"there is no certificate of `{what}` in {folder / name}; {again}")
        elif found.expires <= now:
            errors.append(f"the certificate of `{what}` expired on {_date(found.expires)}; {again} --renew")
        elif found.expires - now <= _soon(found):
            warnings.append(f"the certificate of `{what}` expires on {_date(found.expires)}; {again} --renew")
    for host, addresses in graph.routers.items():
        found = _certificate(folder / router_name(host) / "certificate.pem")
        if found and not addresses <= found.addresses:
            where = ", ".join(sorted(addresses - found.addresses))
            errors.append(f"the certificate of the router on {host or 'this machine'} is not for {where}; {again}")
    if not errors and not _is_current(graph, folder):
        errors.append(f"the keys in {folder} are those of an older version of the network; {again}")
    return errors, warnings


def folder_of(folder: Path, process: str) -> Path:
    """All that a process gets: its `keys`."""
    return folder / file_name(process)


def files_of(plan: Plan, host: str, folder: Path) -> tuple[Path, ...]:
    """The folders that a host gets: those of its processes, and that of its router. Never the authority's key."""
    found = [folder_of(folder, each.name) for each in plan.processes if each.host == host]
    return (*found, *([folder / router_name(host)] if host in graph_of(plan).routers else []))


def contents(graph: Graph) -> dict[str, tuple[str, ...]]:
    """The files of each process and router once their keys are made, as paths in its folder, by name."""
    unnumbered = {each.name: b"" for each in graph.principals}
    found: dict[str, tuple[str, ...]] = {router_name(host): _OF_EACH for host in graph.routers}
    found |= {each.folder: _OF_PROCESS for each in graph.principals}
    for folder, files in permissions(graph, unnumbered).items():
        owner, _, below = folder.partition("/")
        found[owner] += tuple(f"{below}/{file}" for file in files)
    return found


def numbers(plan: Plan, folder: Path) -> dict[str, int]:
    """The number of each process. Raises DeploymentError if there are no keys."""
    graph = graph_of(plan, operator=has_operator(folder))
    found = {each.name: _identity(folder / each.folder).get("number", -1) for each in graph.principals}
    if -1 in found.values():
        raise DeploymentError(f"there are no keys of {graph.name} in {folder}")
    return found


class _Maker:
    def __init__(self, graph: Graph, folder: Path, now: datetime.datetime, days: float, renew: bool) -> None:
        self._graph, self._folder, self._now, self._days, self._renew = graph, folder, now, days, renew

    def make(self) -> Iterator[Made]:
        self._check_folder()
        _folder(self._folder)
        if not (self._folder / ".gitignore").exists():
            _write(self._folder / ".gitignore", b"*\n")  # keys must not be published
        self._check_names()
        authority, made = self._authority()
        yield made
        taken = {number for number in self._numbers().values() if number is not None}
        for principal in self._graph.principals:
            yield from self._principal(principal, authority, taken)
        for host, addresses in self._graph.routers.items():
            yield self._certificate(router_name(host), router_name(host), authority, addresses)
        self._permissions()
        yield from self._remove_others()

    def _check_folder(self) -> None:
        """Refuse a folder with other files: it would be made private and hidden from git."""
        there = {path.name for path in self._folder.iterdir()} if self._folder.is_dir() else set()
        if there - {".gitignore"} and "ca" not in there:
            raise DeploymentError(f"keys: {self._folder} contains other files; choose a folder for the keys alone")

    def _check_names(self) -> None:
        folders = [each.folder for each in self._graph.principals]
        clash = next(
            (name for name in folders if folders.count(name) > 1 or name == "ca" or name[:1] in ("", ".")), None
        )
        if clash:
            raise DeploymentError(f"keys: `{clash}` cannot be the name of a process with keys; rename it")

    def _authority(self) -> tuple[Issued, Made]:
        folder = self._folder / "ca"
        found = _certificate(folder / "ca.pem")
        if found and (folder / "ca.key").is_file() and found.expires - self._now > EXPIRES_SOON:
            issued = Issued((folder / "ca.pem").read_bytes(), (folder / "ca.key").read_bytes())
            return issued, Made("the authority", False, found.expires)
        _folder(folder)
        issued = certificates.make_authority(self._graph.name, self._now)
        _write(folder / "ca.key", issued.key)
        _write(folder / "ca.pem", issued.certificate)
        return issued, Made("the authority", True, certificates.read(issued.certificate).expires)

    def _numbers(self) -> dict[str, int | None]:
        return {each.name: _identity(self._folder / each.folder).get("number") for each in self._graph.principals}

    def _principal(self, principal: Principal, authority: Issued, taken: set[int]) -> Iterator[Made]:
        folder = _folder(self._folder / principal.folder)
        identity = _identity(folder)
        if identity.get("name") != principal.name:
            number = next(each for each in _candidates(principal.name) if each not in taken)
            taken.add(number)
            _write(folder / "identity.json", json.dumps({"name": principal.name, "number": number}).encode() + b"\n")
        yield self._certificate(principal.folder, principal.name, authority, ())
        yield self._curve(folder, principal.name)

    def _certificate(self, folder_name: str, name: str, authority: Issued, addresses: Collection[str]) -> Made:
        folder = _folder(self._folder / folder_name)
        what, serves = f"certificate of {name}", bool(addresses)
        pem, found = folder / "certificate.pem", _certificate(folder / "certificate.pem")
        if (
            found
            and not self._renew
            and (folder / "key.pem").is_file()
            and found.name == common_name(name)
            and found.addresses == frozenset(addresses)
            and found.expires - self._now > _soon(found)
            and _is_signed(self._folder, folder_name)
        ):
            return Made(what, False, found.expires)
        issued = certificates.issue(authority, common_name(name), addresses, self._now, self._days, serves=serves)
        _write(folder / "key.pem", issued.key)
        _write(pem, issued.certificate)
        _write(folder / "ca.pem", authority.certificate)
        return Made(what, True, certificates.read(issued.certificate).expires)

    def _curve(self, folder: Path, name: str) -> Made:
        what, secret = f"CURVE keys of {name}", folder / "curve.key_secret"
        if secret.is_file() and (folder / "curve.key").is_file() and not self._renew:
            return Made(what, False, None)
        public, private = next(filter(all, (each.key_pair() for each in deployments().values())))
        _write(secret, _curve_file(name, public, private))
        _write(folder / "curve.key", _curve_file(name, public))
        return Made(what, True, None)

    def _permissions(self) -> None:
        for name, files in permissions(self._graph, self._public_keys()).items():
            folder = _folder(self._folder / name)
            there = {path.name for path in folder.iterdir()}
            for file, text in files.items():
                if file not in there or (folder / file).read_bytes() != text:
                    _write(folder / file, text)
            for file in there - files.keys():
                (folder / file).unlink()

    def _public_keys(self) -> dict[str, bytes]:
        return {each.name: _public_key(self._folder / each.folder) for each in self._graph.principals}

    def _remove_others(self) -> Iterator[Made]:
        """Remove the folders of processes that the network no longer has."""
        wanted = {"ca", *(each.folder for each in self._graph.principals), *map(router_name, self._graph.routers)}
        for folder in sorted(self._folder.iterdir()):
            is_ours = (folder / "certificate.pem").is_file() and (folder / "key.pem").is_file()
            if folder.name not in wanted and folder.is_dir() and not folder.is_symlink() and is_ours:
                shutil.rmtree(folder)
                yield Made(f"{folder.name} removed: it is no longer part of the network", True, None)


def permissions(graph: Graph, public_keys: Mapping[str, bytes]) -> dict[str, dict[str, bytes]]:
    """The files with the clients that each process admits and the servers that it connects to, by folder."""
    found: dict[str, dict[str, bytes]] = {}
    for principal in graph.principals:
        clients: dict[str, set[str]] = {}
        providers: dict[tuple[str, str], set[str]] = {}
        for edge in graph.used_by(principal.name):
            clients.setdefault(edge.client, set()).add(edge.channel)
        for edge in graph.uses(principal.name):
            providers.setdefault((edge.instance, edge.provider), set()).add(edge.channel)
        found[f"{principal.folder}/admitted"] = {
            f"{file_name(name)}.key": _curve_file(name, public_keys[name], channels=channels)
            for name, channels in clients.items()
        }
        found[f"{principal.folder}/peers"] = {
            f"{file_name(instance)}.key": _curve_file(instance, public_keys[name], channels=channels)
            for (instance, name), channels in providers.items()
        }
    return found


def _is_current(graph: Graph, folder: Path) -> bool:
    """Whether the permissions are those of this graph."""
    keys = {each.name: _public_key(folder / each.folder) for each in graph.principals}
    for name, files in permissions(graph, keys).items():
        try:
            there = {path.name: path.read_bytes() for path in (folder / name).iterdir()}
        except OSError:
            return False
        if there != files:
            return False
    return True


def _is_signed(folder: Path, name: str) -> bool:
    """Whether the authority that is there now has signed a certificate, and is the one that its owner knows."""
    try:
        authority, known = ((folder / each / "ca.pem").read_bytes() for each in ("ca", name))
        pem = (folder / name / "certificate.pem").read_bytes()
    except OSError:
        return False
    return known == authority and certificates.is_signed_by(pem, authority)


# Files.


def _candidates(name: str) -> Iterator[int]:
    """Numbers for a process: the same ones for the same name, as long as they are free."""
    first = int.from_bytes(hashlib.sha256(name.encode()).digest()[:2], "big")
    return ((first + step) % _NUMBERS for step in range(_NUMBERS))


def _folder(path: Path) -> Path:
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    path.chmod(0o700)
    return path


def _write(path: Path, data: bytes) -> None:
    """Write the whole file at once, and never readable for others."""
    draft = path.with_name(f".{path.name}.draft")
    with contextlib.suppress(FileNotFoundError):
        draft.unlink()
    with os.fdopen(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(data)
    draft.replace(path)


def _identity(folder: Path) -> dict[str, Any]:
    try:
        told = json.loads((folder / "identity.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return told if isinstance(told, dict) and type(told.get("number")) is int else {}


def _certificate(path: Path) -> Certificate | None:
    try:
        return certificates.read(path.read_bytes())
    except (OSError, ValueError):
        return None


def _curve_file(name: str, public: bytes, secret: bytes = b"", channels: Collection[str] | None = None) -> bytes:
    """In the form of `zmq.auth`."""
    lines = [f"# {'Secret: for its owner alone.' if secret else 'Public key'} of {name}", "metadata"]
    lines += [f'    channels = "{" ".join(sorted(channels))}"'] if channels is not None else []
    lines += ["curve", f'    public-key = "{public.decode()}"']
    lines += [f'    secret-key = "{secret.decode()}"'] if secret else []
    return "\n".join([*lines, ""]).encode()


def _public_key(folder: Path) -> bytes:
    return read_public(folder / "curve.key")[0]


def _soon(found: Certificate) -> datetime.timedelta:
    return min(EXPIRES_SOON, (found.expires - found.begins) / 3)


def _date(when: datetime.datetime) -> str:
    return f"{when:%Y-%m-%d}"
