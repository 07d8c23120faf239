"""Where a deployment runs: hosts, addresses, ports. Values of a host reach commands, but never as options."""

from __future__ import annotations

import re
from dataclasses import replace
from ipaddress import ip_address

from ..diagnostics import Report, did_you_mean
from ..numbers import whole
from ..source import Name
from . import model as m
from .scope import HERE, host_of

SSH = 22
_MOST = 65535

_LABEL = re.compile(r"(?!-)[A-Za-z0-9_-]{1,63}(?<!-)\Z")
_NUMBERS = re.compile(r"[0-9.]*\Z")
_USER = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}\Z")
_WORKDIR = re.compile(r"/(?:(?!\.\.(?:/|\Z))[^/\x00-\x1f\x7f]*(?:/|\Z))*\Z")
_PROGRAM = re.compile(r"[A-Za-z0-9_/][A-Za-z0-9_./+-]*\Z")


def check_hosts(model: m.Deployment, report: Report) -> None:
    """Check the definitions of hosts, and that each instance is on one of them."""
    _check_blocks(model, report)
    for instance in model.instances:
        _check_place(model, instance, report)
    check_ports(model, report)


def _check_blocks(model: m.Deployment, report: Report) -> None:
    names: dict[str, Name] = {}
    addresses: dict[tuple[str, int], m.Host] = {}
    for host in model.hosts:
        first = names.setdefault(host.name.text, host.name)
        if first is not host.name:
            message = f"host `{host.name}` is defined twice"
            report.error("duplicate", message, host.name.span, "", ("first here", first.span))
        _check_host(model, host, report)
        if host.address:
            key = host.address.text.lower(), whole(host.port.text) if host.port else SSH
            other = addresses.setdefault(key, host)
            if other is not host and other.address:
                message = f"`{host.name}` and `{other.name}` have the same address, so they are one machine"
                hint = "write one `host` block, and use its name everywhere"
                report.error("host-clash", message, host.address.span, hint, ("the other one", other.address.span))
    known = list(names)
    for name in (*(each.host for each in model.systems), *(each.host for each in model.instances)):
        if name and name.text not in names and name.text not in model.skipped:
            hint = did_you_mean(name.text, known) or f'say where it is: host {name} {{ address "192.168.1.10"; }};'
            report.error("unknown-host", f"unknown host `{name}`", name.span, hint)


def _check_host(model: m.Deployment, host: m.Host, report: Report) -> None:
    if host.address is None:
        if "address" not in model.skipped:
            hint = 'add, for example: address "192.168.1.10";'
            report.error("bad-host", f"host `{host.name}` has no address", host.name.span, hint)
    elif not is_address(host.address.text):
        message = f"`{host.address}` is not an address"
        report.error("bad-host", message, host.address.span, "write a number, as in 192.168.1.10, or a host's name")
    if host.user and not is_user(host.user.text):
        message = f"`{host.user}` is not a valid user name"
        hint = "letters, digits, `_`, `.` and `-`, and no `-` in front"
        report.error("bad-host", message, host.user.span, hint)
    if host.port:
        _check_port(host.port, report)
    if host.workdir and not _WORKDIR.match(host.workdir.text):
        message = f"`{host.workdir}` is not an absolute path"
        report.error("bad-host", message, host.workdir.span, "write a path that begins with `/`")
    if host.python and not _PROGRAM.match(host.python.text):
        message = f"`{host.python}` is not the name or path of an interpreter"
        report.error("bad-host", message, host.python.span, 'as in: python "python3.12";')


def is_address(text: str) -> bool:
    """Whether a text is an IP address, or may be the name of a host."""
    try:
        ip_address(text)
    except ValueError:
        return len(text) < 254 and not _NUMBERS.match(text) and all(map(_LABEL.match, text.rstrip(".").split(".")))
    _, found, zone = text.partition("%")
    return not found or bool(_LABEL.match(zone))


def is_user(text: str) -> bool:
    """Whether a text may be a user name. No valid name can be mistaken for a command-line option."""
    return bool(_USER.match(text))


def _check_place(model: m.Deployment, instance: m.Instance, report: Report) -> None:
    ip = instance.ip
    if ip and instance.host:
        message = "`ip` and `host` both say where it runs"
        report.error("duplicate", message, ip.span, "remove the `ip`", ("the host is here", instance.host.span))
    elif ip and not is_address(ip.text):
        report.error("bad-host", f"`{ip}` is not an address", ip.span, "write localhost, a number, or a host's name")
    elif ip and ip.text in HERE and not instance.port and "port" not in model.skipped:
        said = host_of(model, replace(instance, ip=None))
        if said is None:  # else it says that this one runs here
            message = "`ip` has no effect without a `port`"
            report.warning("ineffective-ip", message, ip.span, "add, for example, `port 10003;`")


def check_ports(model: m.Deployment, report: Report) -> None:
    """Check that no two instances on one host have the same port."""
    seen: dict[tuple[str, int], Name] = {}
    ports = [(each, port) for each in model.instances for port in (each.port, *(offer.port for offer in each.offers))]
    for instance, port in ports:
        if port is None:
            continue
        host = host_of(model, instance)
        number = _check_port(port, report)
        where = "" if host is None or host.text in HERE else host.text
        first = seen.setdefault((where, number), port)
        if first is not port:
            report.error("port-clash", f"port {number} is taken", port.span, "", ("first here", first.span))


def _check_port(port: Name, report: Report) -> int:
    number = whole(port.text)
    if not 1 <= number <= _MOST:
        report.error("bad-port", f"{number} is not a port; allowed: 1 to {_MOST}", port.span)
    return number
