"""Zenoh access control for the routers of a network with keys: each process may do what the graph says."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from ...contract.interface import Verb
from ...wire import names
from ..permissions import OPERATOR, Graph, Principal, common_name, router_name


def access_control(graph: Graph, host: str, numbers: Mapping[str, int]) -> dict[str, Any]:
    """Zenoh's rules for the router of a host: each process may do only what its edges need.

    The router identifies processes of its host by their certificates. Messages of another host come through that
    host's router, which therefore gets the rights of all processes there.
    """
    rules, policies, subjects = [], [], []
    named = {each.name: each for each in graph.principals}
    speakers: dict[str, tuple[str, ...]] = {each.name: (each.name,) for each in graph.principals if each.host == host}
    routers = {router_name(other): other for other in graph.routers if other != host}
    for speaker, other in routers.items():
        speakers[speaker] = tuple(each.name for each in graph.principals if each.host == other)
    for number, (speaker, members) in enumerate(speakers.items()):
        keys: dict[str, set[str]] = {_NEIGHBOURS: {*_ASK, *_ANSWER}} if speaker in routers else {}
        for member in members:
            for act, key in _needs(graph, named[member], numbers):
                keys.setdefault(key, set()).add(act)
        by_acts: dict[tuple[str, ...], list[str]] = {}
        for key, acts in keys.items():
            by_acts.setdefault(tuple(sorted(acts)), []).append(key)
        ids = []
        for index, (messages, expressions) in enumerate(sorted(by_acts.items())):
            ids.append(f"{number}-{index}")
            rules.append(_rule(ids[-1], messages, "ingress", sorted(expressions)))
        if ids:
            subjects.append({"id": str(number), "cert_common_names": [common_name(speaker)]})
            policies.append({"rules": ids, "subjects": [str(number)]})
    rules.append(_rule("out", _ALL, "egress", ["**"]))
    known = [common_name(speaker) for speaker in speakers]
    if known:
        subjects.append({"id": "known", "cert_common_names": known})
        policies.append({"rules": ["out"], "subjects": ["known"]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


_ALL = (
    "declare_liveliness_subscriber",
    "declare_queryable",
    "declare_subscriber",
    "delete",
    "liveliness_query",
    "liveliness_token",
    "put",
    "query",
    "reply",
)
_WATCH = "declare_liveliness_subscriber", "liveliness_query"
_HEAR, _ANSWER, _SEND, _ASK = ("declare_subscriber",), ("declare_queryable", "reply"), ("put",), ("query",)
_BE_SEEN = ("liveliness_token",)
_NEIGHBOURS = "rc_router/*"
"""The keys on which routers ask each other whether they still answer."""
_PROVIDING, _USING = ("serves", "receives", "publishes"), ("calls", "commands", "subscribes")
"""The roles in liveliness tokens."""


def _needs(graph: Graph, principal: Principal, numbers: Mapping[str, int]) -> Iterator[tuple[str, str]]:
    """The message kinds that a process needs, each with a key. docs/reference/protocol-zenoh.md lists the keys."""

    def on(acts: Iterable[str], *keys: str) -> Iterator[tuple[str, str]]:
        return ((act, key) for act in acts for key in keys)

    mine, own = _links_of(numbers[principal.name]), principal.channels
    yield from on(_WATCH, "rc_lv/*/**")
    yield from on(_HEAR, f"rc_ack/*/{mine}/*", f"rc_to/*/{mine}/*/**")
    yield from on(_ANSWER, f"rc_ask/*/{mine}/*/*/**")
    for prefix in own:  # a process provides channels only under its own names
        yield from on((*_HEAR, *_ANSWER, *_SEND), f"rc/*/{prefix}/**")
        yield from on(_BE_SEEN, *(f"rc_lv/*/{role}/*/*/*/{mine}/{prefix}/**" for role in _PROVIDING))
    if graph.has_operator:
        yield from on(_ASK if principal.name == OPERATOR else ("reply",), "rc_ask/*/*/*/who")
    within = [edge for edge in graph.inner if edge.client == principal.name]
    for edge in (*graph.uses(principal.name), *within):
        theirs, in_token = _links_of(numbers[edge.provider]), edge.looked_up.replace(names.ANY, ".")
        yield from on(_ASK, f"rc_ask/*/{theirs}/*/text")
        yield from on(_BE_SEEN, *(f"rc_lv/*/{role}/*/*/*/{mine}/{in_token}" for role in _USING))
        if edge.verb is Verb.SUBSCRIBES:
            yield from on(_HEAR, f"rc/*/{edge.looked_up}")
            yield from on(_ASK, f"rc_ask/*/{theirs}/*/history/{edge.channel}")
            yield from on(_SEND, f"rc_ack/*/{theirs}/*")
        else:
            yield from on((*_ASK, *_SEND), f"rc/*/{edge.channel}")
            yield from on(_SEND, f"rc_to/*/{theirs}/*/{edge.channel}")
    for edge in (*graph.used_by(principal.name), *within):
        theirs = _links_of(numbers[edge.client])
        yield from on(_ASK, f"rc_ask/*/{theirs}/*/text")
        yield from on(_SEND, f"rc_to/*/{theirs}/*", f"rc_ack/*/{theirs}/*")


def _links_of(number: int) -> str:
    """Key pattern for the links of a process: their ids begin with the process's number."""
    return f"{number:04x}$*"


def _rule(name: str, messages: Sequence[str], flow: str, keys: Sequence[str]) -> dict[str, Any]:
    return {"id": name, "permission": "allow", "flows": [flow], "messages": list(messages), "key_exprs": list(keys)}
