"""Types of DDS as data, from every description: {"Arm::Point": (("x", "float"), ...)}."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

from cyclonedds.idl import IdlStruct
from cyclonedds.idl._typesupport.DDS.XTypes import TypeMapping

Description = dict[str, tuple[tuple[str, str], ...]]

# -- what the library says of a class, and idlc in the C that it writes ------------------

_KINDS = {
    1: "boolean", 2: "uint8", 3: "int16", 4: "int32", 5: "int64", 6: "uint16", 7: "uint32", 8: "uint64",
    9: "float", 10: "double", 12: "int8", 13: "uint8", 16: "int8", 112: "string",
}  # fmt: skip
"""XTypes' numbers. The idlc of Cyclone DDS 0.10 takes uint8 for octet, 2, and int8 for char, 16."""

_SEQUENCES, _COMPLETE = (128, 129), 242


def of_class(kind: type[IdlStruct]) -> Description:
    return _mapped(kind.__idl__.get_type_mapping())


def of_c(source: str) -> Description:
    """All topic types of a C file of idlc's."""
    found: Description = {}
    for text in re.findall(r"#define TYPE_MAP_CDR_\w+ \(unsigned char \[\]\)\{(.*?)\n\}", source, re.DOTALL):
        octets = bytes(int(each, 16) for each in re.findall(r"0x([0-9a-f]{2})", text))
        found |= _mapped(TypeMapping.deserialize(b"\x00\x07\x00\x00" + octets))
    return found


def _mapped(mapping: Any) -> Description:
    structs: dict[bytes, Any] = {
        pair.type_identifier.value: pair.type_object.value.value for pair in mapping.identifier_object_pair_complete
    }

    def spelled(kind: Any) -> str:
        if kind.discriminator in _SEQUENCES:
            return f"sequence<{spelled(kind.value.element_identifier)}>"
        if kind.discriminator == _COMPLETE:
            return str(structs[kind.value].header.detail.type_name)
        return _KINDS[kind.discriminator]

    return {
        struct.header.detail.type_name: tuple(
            (member.detail.name, spelled(member.common.member_type_id)) for member in struct.member_seq
        )
        for struct in structs.values()
    }


# -- what a text in IDL says -----------------------------------------------------------


def of_idl(texts: Mapping[str, str]) -> Description:
    found: Description = {}
    for text in texts.values():
        bare = re.sub(r"//.*|@\w+|^#.*", "", text, flags=re.MULTILINE)
        _scope(iter(re.findall(r"::|\w+|[-{}<>;=]", bare)), "", found)
    return found


def _scope(tokens: Iterator[str], module: str, found: Description) -> None:
    for token in tokens:
        match token:
            case "module":
                name = _name(next(tokens))
                assert next(tokens) == "{"
                _scope(tokens, f"{module}::{name}".removeprefix("::"), found)
            case "struct":
                name = f"{module}::{_name(next(tokens))}"
                assert name not in found, f"{name} is there twice"
                assert next(tokens) == "{"
                found[name] = tuple(_members(tokens, module))
            case "const":
                while next(tokens) != ";":
                    pass
            case "}":
                assert next(tokens) == ";"
                return
            case _:
                raise AssertionError(f"{token} in module {module}")


def _members(tokens: Iterator[str], module: str) -> Iterator[tuple[str, str]]:
    declared: list[str] = []
    for token in tokens:
        if token == "}":
            assert next(tokens) == ";"
            return
        if token == ";":
            *kind, name = declared
            yield _name(name), _spelled("".join(kind), module)
            declared = []
        else:
            declared.append(token)


def _spelled(kind: str, module: str) -> str:
    if kind.startswith("sequence<"):
        return f"sequence<{_spelled(kind[9:-1], module)}>"
    if kind in _KINDS.values():
        return kind
    path = [_name(part) for part in kind.removeprefix("::").split("::")]
    return "::".join(path if len(path) > 1 else [module, *path])


def _name(text: str) -> str:
    return text.removeprefix("_")
