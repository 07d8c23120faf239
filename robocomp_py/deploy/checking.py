"""Checks of a network by itself: the middlewares and files that it names, and the options of its command line."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from ..contract.middleware import carrier
from ..contract.parameters import ParameterSet
from ..dsl.ddsl.model import Deployment, Instance
from ..dsl.diagnostics import Report
from ..dsl.nearby import nearby
from ..dsl.source import Name, Source
from ..runtime.keys import KEYS
from ..runtime.notify import BETWEEN
from ..spelling import unknown
from . import placing
from .plan import Overrides
from .routes import stays_inside, unfit, unshared
from .uses import Node


class Checks:
    """The checks of one network. What is wrong goes to the report."""

    def __init__(
        self,
        model: Deployment,
        overrides: Overrides,
        report: Report,
        shared: Callable[[Instance], str],
        find_program: Callable[[str, Instance], Path | None],
    ) -> None:
        """`shared` returns the process that an instance shares with others, or ""; `find_program` finds a program of
        an instance on this host by its word."""
        self._model, self._overrides, self._report = model, overrides, report
        self._shared, self._find_program = shared, find_program
        self._folder = model.source.path.parent
        self.unfit: set[str] = set()
        """Middlewares that have been reported where the network names them."""

    def network(self) -> None:
        """Check what needs no component."""
        model = self._model
        named = [instance for instance in model.instances if instance.middleware]
        self._check_middleware(model.middleware, [each for each in model.instances if each not in named])
        if self._overrides.middleware:
            self._check_middleware(Name(self._overrides.middleware, model.name.span), model.instances, override=True)
        for instance in model.instances:
            self._check_instance(instance)
        if not model.instances and not self._report.errors:
            self._report.warning("empty-deployment", "there is nothing to run", model.name.span)

    def options(self, nodes: Sequence[Node]) -> None:
        """Check the instances that options of the command line name."""
        instances = [each.name.text for each in self._model.instances]
        own_programs = {each.name.text: each.program for each in self._model.instances if each.program}
        diaries = self._overrides.diaries
        for name, assignment in (*self._overrides.settings, *diaries):
            is_diary = (name, assignment) in diaries
            origin = Source(Path(self._overrides.option(name, assignment)), "", has_places=False).span(0, 0)
            if name in own_programs:
                what = "it writes no diary" if is_diary else "its configuration cannot be set here"
                message, hint = f"`{name}` is your own program; {what}", "" if is_diary else "give it `args` or `env`"
                self._report.error("configuration", message, origin, hint, ("it is this one", own_programs[name].span))
            elif (is_diary or name != "*") and name not in instances:
                whole = "" if is_diary else _with_instance(name, assignment.partition("=")[0], nodes)
                message = f"unknown instance `{name}`" if whole else unknown("instance", name, instances)
                hint = f"write the instance first, as in {whole}" if whole else ""
                self._report.error("unknown-instance", message, origin, hint)

    def _check_instance(self, instance: Instance) -> None:
        for name in (instance.middleware, *(wiring.middleware for wiring in instance.wirings)):
            self._check_middleware(name, [instance])
        if instance.path and not placing.is_elsewhere(self._model, instance):
            self._check_program(instance, instance.path)
        if instance.config:
            self._check_config(instance, instance.config)
        for argument in instance.args if not instance.program else ():
            if argument.text == BETWEEN:
                message = f"`{BETWEEN}` separates the components of one process and cannot be an argument"
                self._error("configuration", message, argument, "call it otherwise, or set a parameter")
        if instance.existing and not placing.host_name(self._model, instance):
            self._check_existing(instance, instance.existing)

    def _check_program(self, instance: Instance, path: Name) -> None:
        file = self._folder / path.text
        if not file.is_file():
            self._missing(path, nearby(file, path.text, (), instance.local))
        elif not os.access(file, os.X_OK):
            self._error("not-executable", f"{file} is not executable", path)

    def _check_config(self, instance: Instance, config: Name) -> None:
        file = self._folder / config.text
        if not file.is_file():
            others = {each.config.text for each in self._model.instances if each.config}
            self._missing(config, nearby(file, config.text, others, instance.local))

    def _missing(self, name: Name, hint: str) -> None:
        message = f"there is no file {self._folder / name.text}"
        self._error("missing-file", message, name, hint or "write it, or correct the name")

    def _check_existing(self, instance: Instance, command: Name) -> None:
        words = placing.existing_command(command.text)
        if words and not self._find_program(words[0], instance):
            message = f"there is no program `{words[0]}` on this host"
            self._error("missing-file", message, command, "install it, or write its path")

    def _check_middleware(self, name: Name | None, users: Iterable[Instance], *, override: bool = False) -> None:
        """Whether the network's middleware can carry the messages of the instances that it is named for."""
        carried = carrier(name.text, "") if name else ""
        if name is None or not carried:
            return
        fault = unfit(carried)
        if fault is None and override is bool(self._overrides.middleware) and stays_inside(carried):
            alone = [each.name.text for each in users if not each.program and not self._shared(each)]
            fault = unshared(carried, alone[0]) if alone else None
        if fault:
            self.unfit.add(name.text)
            message = f"--middleware {name}: {fault.message}" if override else fault.message
            self._error(fault.code, message, name, fault.hint)

    def _error(self, code: str, message: str, at: Name, hint: str = "") -> None:
        self._report.error(code, message, at.span, hint)


def _with_instance(part: str, rest: str, nodes: Sequence[Node]) -> str:
    """The full key for a key without an instance, if an instance has such a parameter; "" if none has."""
    if part not in KEYS:
        return ""
    name = re.split(r"[.\[]", rest)[0]
    having = [each.name for each in nodes if part == "params" and _has(each.component.params, name)]
    return next((f"`{each}.{part}.{rest}`" for each in (*having, *(node.name for node in nodes))), "")


def _has(params: ParameterSet | None, name: str) -> bool:
    return params is not None and name in [
        *(each.name for each in params.parameters),
        *(each.name for each in params.lists),
    ]
