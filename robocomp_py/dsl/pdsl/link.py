"""Model to contract. For files in which `check` found no error."""

from __future__ import annotations

from typing import Any

from ...contract.parameters import Parameter, ParameterKind, ParameterList, ParameterSet
from ..numbers import real, whole
from ..source import Name
from . import model as m


def link(file: m.File) -> ParameterSet:
    return _scope(file.scope)


def _scope(scope: m.Scope) -> ParameterSet:
    return ParameterSet(scope.name.text, tuple(map(_param, scope.params)), tuple(map(_list, scope.lists)))


def _list(each: m.List) -> ParameterList:
    low, high = (whole(bound.text) for bound in each.items) if each.items else (0, None)
    return ParameterList(each.scope.name.text, _scope(each.scope), low, high, each.doc)


def _param(param: m.Param) -> Parameter:
    kind = ParameterKind(param.kind)
    low, high = (_value(kind, bound) for bound in param.range) if param.range else (None, None)
    choices = tuple(value.text for value in param.values)
    default = _value(kind, param.default)
    return Parameter(param.name.text, kind, default, low, high, choices, param.mandatory, param.doc, param.dynamic)


def _value(kind: ParameterKind, text: Name) -> Any:
    match kind:
        case ParameterKind.INT:
            return whole(text.text)
        case ParameterKind.FLOAT | ParameterKind.DOUBLE:
            return real(text.text)
        case ParameterKind.BOOL:
            return text.text == "true"
        case ParameterKind.STRING | ParameterKind.ENUM:
            return text.text
