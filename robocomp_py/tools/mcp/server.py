"""The tools of `rc mcp` over the Model Context Protocol. It needs the package `mcp`; see `need_mcp`."""

from __future__ import annotations

import contextlib
import os
from collections.abc import AsyncIterator, Mapping, Sequence
from typing import Any

import anyio
import anyio.to_thread
from mcp import types
from mcp.server.lowlevel import Server
from mcp.server.stdio import stdio_server

from .permissions import Permissions
from .requests import Answer, Requests

_AT_ONCE, _WAITING = 4, 16
"""Requests that are answered at the same time, and further ones that may wait for that."""

_PIECE, _LONGEST = 1 << 16, 1 << 20
"""Octets that are read at a time, and octets of a message, after which the client is left."""

_TEXT = {"type": "string"}


def make_server(requests: Requests, network: str, version: str = "") -> Server[Any]:
    """A server that passes the requests of one client on, each on a thread of its own."""
    limiter: list[anyio.CapacityLimiter] = []

    async def list_tools(context: Any, params: Any) -> types.ListToolsResult:
        return types.ListToolsResult(tools=_tools(requests))

    async def call_tool(context: Any, params: types.CallToolRequestParams) -> types.CallToolResult:
        if not limiter:
            limiter.append(anyio.CapacityLimiter(_AT_ONCE))  # which belongs to the loop
        if limiter[0].statistics().tasks_waiting >= _WAITING:
            answer = requests.refuse(params.name, params.arguments or {}, "too many requests at the same time")
            return _result(answer)
        answer = await anyio.to_thread.run_sync(
            requests.answer, params.name, params.arguments or {}, abandon_on_cancel=True, limiter=limiter[0]
        )
        return _result(answer)

    return Server(
        f"robocomp {network}",
        version=version,
        instructions=_instructions(requests, network),
        on_list_tools=list_tools,
        on_call_tool=call_tool,
    )


def _result(answer: Answer) -> types.CallToolResult:
    return types.CallToolResult(content=[types.TextContent(type="text", text=answer.text)], is_error=answer.failed)


async def serve_stdio(server: Server[Any]) -> None:
    """Serve the client at stdin and stdout until it closes them. What else this process prints goes to stderr."""
    lines: Any = _Lines(0)  # of what the library takes, it uses the iteration only
    async with stdio_server(stdin=lines) as (reading, writing):
        await server.run(reading, writing, server.create_initialization_options())


class _Lines:
    """The lines of a descriptor. The library's own reader keeps a thread that no signal can end."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor

    async def __aiter__(self) -> AsyncIterator[str]:
        begun = b""
        while True:
            with contextlib.suppress(PermissionError):  # a file, which can always be read
                await anyio.wait_readable(self._descriptor)
            read = os.read(self._descriptor, _PIECE)
            *lines, begun = (begun + read).split(b"\n")
            for line in lines:
                yield line.decode(errors="replace")
            if not read or len(begun) > _LONGEST:
                return


def _instructions(requests: Requests, network: str) -> str:
    allowed = requests.allowed
    may = "".join(
        f"You may {what}: {', '.join(names)}. " for what, names in zip(_DEEDS, _each(allowed), strict=True) if names
    )
    return (
        f"The running robot network `{network}`. Components publish topics, and serve queries, commands and actions, "
        f"which take long. Topics, parameters and measures may be read. {may or 'You may call nothing. '}"
        "Use `describe` before a call: it tells types, units and a template of the arguments. What you do may move a "
        "robot: check its effect by reading topics."
    )


_DEEDS = ("call", "begin goals of", "publish")


def _each(allowed: Permissions) -> tuple[Sequence[str], ...]:
    return allowed.calls, allowed.goals, allowed.publications


def _tools(requests: Requests) -> list[types.Tool]:
    bounds = requests.bounds
    timeout = {"type": "number", "default": 5, "exclusiveMinimum": 0, "maximum": bounds.longest, "description": "in s"}
    limit = timeout | {"default": 60, "maximum": bounds.longest_goal, "description": "in s; then it is cancelled"}
    arguments = {"type": "object", "description": "by name, as `describe` shows them", "default": {}}
    goal = {**_TEXT, "description": "as begin_goal returns it"}
    calls, goals, publications = (", ".join(each) or "none" for each in _each(requests.allowed))
    rate = f"Calls, goals and publications together: at most {bounds.calls_a_minute} a minute."
    return [
        _tool("list_components", "List the components that run, what they offer and use, and what is allowed.", {}),
        _tool(
            "list_channels",
            "List the topics, queries, commands and actions of the network, and which components provide and use each.",
            {
                "kind": {"enum": ["topic", "query", "command", "action"], "description": "only these"},
                "contains": {**_TEXT, "description": "only channels with this text in their names"},
            },
        ),
        _tool(
            "describe",
            "Describe a topic, query, command or action: types, comments with units, and a template of its arguments.",
            {"name": {**_TEXT, "description": "such as world/LaserPub/pushLaserData, or a part of it"}},
            "name",
        ),
        _tool(
            "read_topic",
            "Read the next messages of a topic, or the last one if the topic keeps it.",
            {
                "topic": {**_TEXT, "description": "such as world/LaserPub"},
                "count": {"type": "integer", "default": 1, "minimum": 1, "maximum": bounds.messages},
                "timeout": timeout,
            },
            "topic",
        ),
        _tool(
            "read_parameters",
            "Read the parameters of a component, with their ranges.",
            {"component": _TEXT},
            "component",
        ),
        _tool(
            "read_measures",
            "Read what a component has counted since its start: computes, overruns, calls, failures, durations.",
            {"component": _TEXT},
            "component",
        ),
        _tool(
            "call",
            f"Call a query, or send a command. Allowed: {calls}. {rate}",
            {
                "operation": {**_TEXT, "description": "such as wander/GotoPoint/go"},
                "arguments": arguments,
                "timeout": timeout,
            },
            "operation",
            reads=False,
        ),
        _tool(
            "begin_goal",
            f"Begin a goal of an action, and return at once. Allowed: {goals}. At most {bounds.goals} goals at a time.",
            {
                "action": {**_TEXT, "description": "such as arm/Navigation/goTo"},
                "arguments": arguments,
                "limit": limit,
            },
            "action",
            reads=False,
        ),
        _tool(
            "read_goal",
            "Wait for the end of a goal, and return its result; after the timeout, its status and newest feedback.",
            {"goal": goal, "timeout": timeout},
            "goal",
        ),
        _tool("cancel_goal", "Ask the server of a goal to cancel it.", {"goal": goal}, "goal", reads=False),
        _tool(
            "publish",
            f"Publish one message to all that subscribe to a topic. Allowed: {publications}.",
            {
                "topic": {**_TEXT, "description": "as it is allowed"},
                "arguments": arguments,
                "timeout": timeout,
            },
            "topic",
            reads=False,
        ),
    ]


def _tool(name: str, text: str, properties: Mapping[str, Any], *required: str, reads: bool = True) -> types.Tool:
    schema = {
        "type": "object",
        "properties": dict(properties),
        "required": list(required),
        "additionalProperties": False,
    }
    hints = types.ToolAnnotations(read_only_hint=reads, destructive_hint=not reads, open_world_hint=not reads)
    return types.Tool(name=name, description=text, input_schema=schema, annotations=hints)
