"""The clauses of DDSL, one row each: syntax, place, explanation, checks, and what the plan of a network has of it.

A row is all that the grammar, the parser, the checks, the planner, completion, hover texts and colours need. A new
clause also needs its field in `model`, the field of `Plan` or `Process` that it sets, and a line on its page.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from ...contract.component import Component
from ..cdsl.model import Amount, Setting
from ..diagnostics import Report
from ..source import Name, Span
from . import model as m
from .allow import check_allow, read_allow
from .clocks import CLOCK_SETTINGS, CLOCK_WORDS, check_clock, leader_of
from .hosts import check_hosts
from .offers import check_offers
from .programs import check_programs, environment_of, notifies_of
from .restarts import RESTART_SETTINGS, check_restarts, grace_of, restart_values, same_restart
from .scope import place_of, whole


class Block(StrEnum):
    """A block that clauses stand in; the value is its name in the grammar."""

    NETWORK = "deployment"
    SYSTEM = "system"
    INSTANCE = "component"
    HOST = "machine"


class Refers(StrEnum):
    """What the names in a clause stand for."""

    INSTANCE = "instance"
    HOST = "host"
    MIDDLEWARE = "middleware"
    OPERATION = "operation"
    """A path of an `allow`."""


@dataclass(frozen=True, slots=True)
class Written:
    """A clause as it stands in a file."""

    names: tuple[Name, ...]
    """Its words, numbers and texts, except the keywords."""
    settings: tuple[Setting, ...]
    amounts: tuple[Amount, ...]
    span: Span
    system: tuple[str, ...]
    """The systems around it, the outermost first."""

    def within(self, name: Name) -> Name:
        """The full name of something that belongs to the system around the clause."""
        return Name(whole(self.system, name.text), name.span)


def _first(written: Written) -> Name:
    return written.names[0]


def _names(value: Name | tuple[Name, ...]) -> tuple[Name, ...]:
    return value if isinstance(value, tuple) else (value,)


@dataclass(frozen=True)
class ClauseType:
    """One kind of clause. Its name is that of its rule in the grammar, and usually of its field in the model."""

    name: str
    syntax: str
    """The rule in the grammar, as lark reads it; CHOICE stands for one of its `choices`."""
    where: tuple[Block, ...]
    example: str
    doc: str
    """What it is for: the hover text of its first word."""
    choices: Mapping[str, str] = field(default_factory=dict)
    """The words of which one is chosen, with their hover texts."""
    settings: Mapping[str, str] = field(default_factory=dict)
    """The names that can be set in parentheses, with their hover texts."""
    values: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    """The words that a setting may have as its value, with their hover texts."""
    words: tuple[str, ...] = ()
    """The words that `doc` explains, if its syntax does not begin with a word of its own."""
    misplaced: str = ""
    """A hint for one that stands in the wrong block."""
    read: Callable[[Written], Any] = _first
    """The value of its field."""
    many: bool = False
    """Whether it may be repeated: its field is a tuple, and `read` makes what is appended."""
    attribute: str = ""
    """Its field in the model, if that has another name."""
    refers: Refers | None = None
    named: Callable[[Any], Iterable[Name]] = _names
    """The names in its value that refer to something."""
    check: Callable[[m.Deployment, Report], None] | None = None
    alike: Callable[[m.Deployment, m.Instance], object] | None = None
    """What all instances of a process must have in common, if it holds for a whole process."""
    plan: Callable[[m.Deployment, Mapping[str, Component], Report], Any] | None = None
    """The value of the field of `Plan` with its name, as JSON has it. Gets the components of the instances, by name."""
    process: Callable[[m.Deployment, Sequence[m.Instance]], Any] | None = None
    """The value of the field of `Process` with its name, as JSON has it. Gets the instances of the process."""

    @property
    def in_model(self) -> str:
        """The name of its field in the model."""
        return self.attribute or self.name

    @property
    def explained(self) -> tuple[str, ...]:
        """The words that its explanation is about."""
        return self.words or (self.syntax.split('"')[1],)

    @property
    def rule(self) -> str:
        choices = " | ".join(f'"{word}"' for word in self.choices)
        rule = f"{self.name}: {self.syntax}".replace("CHOICE", f"_{self.name}_choice")
        return f"{rule}\n!_{self.name}_choice: {choices}\n" if choices else f"{rule}\n"


_SCOPES = (Block.NETWORK, Block.SYSTEM, Block.INSTANCE)
_NETWORK = "write it once, for the whole network"
_EACH = "write it in the block of each component"


def _offer(written: Written) -> tuple[m.Offer]:
    name, *rest = written.names
    numbers = [each for each in rest if each.text.isdecimal()]
    interfaces = tuple(each for each in rest if each not in numbers)
    return (m.Offer(written.within(name), interfaces, written.span, next(iter(numbers), None)),)


def _wiring(written: Written) -> tuple[m.Wiring]:
    verb, port, provider, *middleware = written.names
    return (m.Wiring(verb, port, provider, written.span, middleware[0] if middleware else None),)


def _quality(written: Written) -> tuple[m.Quality]:
    *verbs, port = written.names
    return (m.Quality(verbs[0] if verbs else None, port, written.settings, written.span),)


def _variable(written: Written) -> tuple[m.Variable]:
    name, value = written.names
    return (m.Variable(name, value, written.span),)


def _middleware(written: Written) -> Name:
    """`zenoh`, or `auto(zenoh)` as one name."""
    first, *inner = written.names
    return Name(f"{first}({inner[0]})", first.span.to(inner[0].span)) if inner else first


CLAUSES = (
    # Of the network, and of what is in it.
    ClauseType(
        "middleware",
        '"middleware" NAME ("(" NAME ")")? ";"',
        (Block.NETWORK, Block.INSTANCE),
        "middleware dds;",
        "what carries the messages of all components, or of one",
        misplaced="write it for the network or for a component",
        read=_middleware,
        refers=Refers.MIDDLEWARE,
    ),
    ClauseType(
        "namespace",
        '"namespace" NAME ("/" NAME)* ";"',
        (Block.NETWORK,),
        "namespace robot1/base;",
        "the prefix of all channel names",
        misplaced=_NETWORK,
        read=lambda written: "/".join(name.text for name in written.names),
    ),
    ClauseType(
        "security",
        '"security" CHOICE ";"',
        (Block.NETWORK,),
        "security lan;",
        "which processes may take part in the network",
        choices={
            "local": "only this user on this machine takes part: loopback, sockets and shared memory of one folder",
            "lan": "only processes with a key take part, and everything is encrypted: see `rcdeploy keys`",
            "open": "every process that reaches the network takes part",
        },
        misplaced=_NETWORK,
        plan=lambda model, components, report: model.security.text if model.security else "local",
    ),
    ClauseType(
        "clock",
        '"clock" _whom _settings? ";"',
        (Block.NETWORK,),
        "clock lidar(speed 10, lost stop);",
        "the instance whose clock all others follow",
        settings=CLOCK_SETTINGS,
        values=CLOCK_WORDS,
        misplaced=_NETWORK,
        read=lambda written: m.Clock(written.names[0], written.settings, written.span),
        refers=Refers.INSTANCE,
        named=lambda clock: (clock.leader,),
        check=check_clock,
        plan=lambda model, components, report: leader_of(model),
    ),
    ClauseType(
        "escalation",
        '"escalation" CHOICE ";"',
        (Block.NETWORK, Block.SYSTEM),
        "escalation one_for_all;",
        "what else is restarted with a failed instance",
        choices={
            "one_for_one": "only the failed instance is restarted",
            "rest_for_one": "the failed instance is restarted, and those that start after it",
            "one_for_all": "all instances of the system, or of the network, are restarted",
        },
        misplaced="write it for the network or for a `System`",
        check=check_restarts,
    ),
    ClauseType(
        "restart",
        '"restart" CHOICE _settings? ";"',
        _SCOPES,
        "restart on_failure(intensity 5, period 1 min);",
        "whether an instance is started again when it has ended",
        choices={
            "never": "it is not started again",
            "on_failure": "it is restarted if it fails",
            "always": "it is restarted whenever it ends by itself",
        },
        settings=RESTART_SETTINGS,
        read=lambda written: m.Restart(written.names[0], written.settings, written.span),
        check=check_restarts,
        alike=same_restart,
        process=restart_values,
    ),
    ClauseType(
        "host",
        '"host" NAME ";"',
        (Block.SYSTEM, Block.INSTANCE),
        "host onboard;",
        "the machine that it runs on, which a `host` block describes",
        refers=Refers.HOST,
        check=check_hosts,
        alike=place_of,
    ),
    # Of an instance.
    ClauseType(
        "path",
        '"path" STRING ";"',
        (Block.INSTANCE,),
        'path "program";',
        "an executable beside the network file, instead of the generated component",
        check=check_programs,
    ),
    ClauseType(
        "existing",
        '"existing" STRING ";"',
        (Block.INSTANCE,),
        'existing "urg_node --frame base";',
        "the command of an installed program, instead of the generated component",
        check=check_programs,
    ),
    ClauseType(
        "notifies",
        '"notifies" ";"',
        (Block.INSTANCE,),
        "notifies;",
        "the program tells by sd_notify(3) when it is ready, and others wait for that",
        misplaced=_EACH,
        read=lambda written: m.Clause("notifies", written.span),
        named=lambda value: (),
        check=check_programs,
        process=notifies_of,
    ),
    ClauseType(
        "args",
        '"args" STRING ("," STRING)* ";"',
        (Block.INSTANCE,),
        'args "--fast";',
        "further arguments of the command",
        read=lambda written: written.names,
        many=True,
    ),
    ClauseType(
        "env",
        '"env" NAME STRING ";"',
        (Block.INSTANCE,),
        'env LOG_COLOURS "no";',
        "a variable of the environment of its process",
        read=_variable,
        many=True,
        process=environment_of,
    ),
    ClauseType(
        "config",
        '"config" STRING ";"',
        (Block.INSTANCE,),
        'config "etc/other.toml";',
        "a configuration instead of the component's `etc/config.toml`",
    ),
    ClauseType(
        "process",
        '"process" NAME ";"',
        (Block.INSTANCE,),
        "process vision;",
        "the process that it shares with others of that name",
        read=lambda written: written.within(written.names[0]),
    ),
    ClauseType(
        "grace",
        '"grace" duration ";"',
        (Block.INSTANCE,),
        "grace 500 ms;",
        "the time it has to end before it is killed, in seconds or with a unit",
        misplaced=_EACH,
        read=lambda written: written.amounts[0],
        check=check_restarts,
        process=grace_of,
    ),
    ClauseType(
        "ip",
        '"ip" (STRING | ADDRESS | NAME) ";"',
        (Block.INSTANCE,),
        "ip localhost;",
        "the address of the machine that it runs on",
        check=check_hosts,
    ),
    ClauseType(
        "port",
        '"port" INT ";"',
        (Block.INSTANCE,),
        "port 10003;",
        "the TCP port of its first interface",
        check=check_hosts,
    ),
    # Between instances.
    ClauseType(
        "dependences",
        '"dependences" _whom ("," _whom)* ","? ";"',
        (Block.INSTANCE,),
        "dependences lidar;",
        "it starts when these instances are ready",
        read=lambda written: written.names,
        many=True,
        refers=Refers.INSTANCE,
    ),
    ClauseType(
        "wiring",
        '_client NAME "from" _whom ("middleware" NAME)? ";"',
        (Block.INSTANCE,),
        "requires Laser from lidar;",
        "the instance to use if several offer the interface",
        words=("requires", "subscribesTo", "from"),
        read=_wiring,
        many=True,
        attribute="wirings",
    ),
    ClauseType(
        "offers",
        '"offers" NAME ":" NAME ("," NAME)* ","? ("port" INT)? ";"',
        (Block.INSTANCE,),
        "offers front : Laser, LaserPub port 10003;",
        "the component provides these interfaces under a further name, as another instance",
        misplaced="write it in the block of the component that provides it: offers front : Laser;",
        read=_offer,
        many=True,
        check=check_offers,
    ),
    ClauseType(
        "qos",
        '"qos" _topic? NAME "(" (setting ("," setting)* ","?)? ")" ";"',
        (Block.INSTANCE,),
        "qos LaserPub(best_effort, depth 1);",
        "the QoS of a topic, instead of that of the CDSL and the configuration",
        read=_quality,
        many=True,
    ),
    ClauseType(
        "allow",
        '"allow" _whom ("," _whom)* ","? ";"',
        (Block.NETWORK, Block.INSTANCE),
        "allow lidar/Laser/getLaserData;",
        "what an agent may do through `rc mcp`: calls, goals of actions, publications to what it subscribes to",
        misplaced="write it for the network, with paths from an instance, or for a component",
        read=lambda written: written.names,
        many=True,
        refers=Refers.OPERATION,
        check=check_allow,
        plan=read_allow,
    ),
    # Of a host.
    ClauseType(
        "address",
        '"address" (STRING | ADDRESS | NAME) ";"',
        (Block.HOST,),
        'address "192.168.1.10";',
        "where the host is reached: an IP address, or a name in quotes",
        check=check_hosts,
    ),
    ClauseType(
        "user", '"user" (STRING | NAME) ";"', (Block.HOST,), 'user "robot";', "the login on the host", check=check_hosts
    ),
    ClauseType(
        "port", '"port" INT ";"', (Block.HOST,), "port 2222;", "the port of the host's SSH server", check=check_hosts
    ),
    ClauseType(
        "workdir",
        '"workdir" STRING ";"',
        (Block.HOST,),
        'workdir "/home/robot/patrol";',
        "the working directory of processes on the host",
        check=check_hosts,
    ),
    ClauseType(
        "python",
        '"python" STRING ";"',
        (Block.HOST,),
        'python "python3.12";',
        "the interpreter on the host",
        check=check_hosts,
    ),
    ClauseType(
        "lost",
        '"lost" CHOICE ";"',
        (Block.HOST,),
        "lost keep;",
        "what happens to the processes on the host when the launcher of the network is gone",
        choices={
            "stop": "processes on the host end when the launcher of the network is gone",
            "keep": "processes on the host go on when the launcher of the network is gone",
        },
    ),
)


def clause_type(name: str, block: Block | None = None) -> ClauseType:
    """The clause of a rule of the grammar, in a block if that matters."""
    return next(each for each in CLAUSES if each.name == name and block in (None, *each.where))


def beginning(word: str) -> ClauseType | None:
    """The clause that a word begins; None for any other word."""
    return next((each for each in CLAUSES if word in each.explained), None)


def explanation(word: str, first: str = "") -> str:
    """The hover text of a word of a clause; "" for other words.

    `first` is the word that begins its clause, because some words have different meanings in different clauses.
    """
    around = beginning(first)
    found = list(_explanations(around, word)) if around else []
    return "; ".join(dict.fromkeys(found or (text for each in CLAUSES for text in _explanations(each, word))))


def _explanations(each: ClauseType, word: str) -> Iterator[str]:
    if word in each.explained:
        yield f"{each.doc}, as in `{each.example}`"
    for words in (each.choices, each.settings, *each.values.values()):
        if word in words:
            yield words[word]


def grammar_rules() -> str:
    """The rules of all clauses, and the alternatives of each block, for the grammar."""
    rules = dict.fromkeys(each.rule for each in CLAUSES)
    blocks = (f"_in_{block}: {' | '.join(each.name for each in CLAUSES if block in each.where)}\n" for block in Block)
    return "".join((*blocks, *rules))


def misplaced_hints() -> dict[str, str]:
    """Hints for clauses in the wrong block, by patterns for the text around the error."""
    hints = {}
    for each in CLAUSES:
        if each.misplaced:
            end = r"\s*;" if each.syntax.endswith(f'"{each.explained[0]}" ";"') else r"\b"
            hints[rf"\b(?-i:{each.explained[0]}){end}"] = each.misplaced
    return hints


def referring(block: m.Deployment | m.System | m.Instance | m.Host) -> Iterator[tuple[Refers, Name]]:
    """The names in the clauses of a block that refer to something, and to what."""
    for kind in dict.fromkeys(clause.kind for clause in block.clauses):
        each = clause_type(kind)
        if each.refers and (value := getattr(block, each.in_model)):
            yield from ((each.refers, name) for name in each.named(value))
