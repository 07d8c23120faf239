"""What a .cdsl file says, and where."""

from __future__ import annotations

from dataclasses import dataclass

from ...contract.interface import Verb
from ..source import Name, Source, Span

AGM = ("AGMExecutive.idsl", "AGMExecutiveTopic.idsl", "AGMCommonBehavior.idsl", "AGMWorldModel.idsl")
"""The files that RoboComp's generators import automatically for a component with the option `agmagent`."""

AGENT = (
    (Verb.IMPLEMENTS, "AGMCommonBehavior"),
    (Verb.REQUIRES, "AGMExecutive"),
    (Verb.SUBSCRIBES, "AGMExecutiveTopic"),
)
"""The ports that they add to such a component, unless its file names them."""

SECONDS = {"us": 1e-6, "ms": 1e-3, "s": 1.0, "min": 60.0}
"""The units of time."""


@dataclass(frozen=True, slots=True)
class Amount:
    """A number with or without a unit: `50 ms`."""

    number: float
    unit: Name | None
    span: Span

    @property
    def seconds(self) -> float | None:
        """None if it has no unit of time."""
        factor = SECONDS.get(self.unit.text.lower()) if self.unit else None
        return None if factor is None else self.number * factor


@dataclass(frozen=True, slots=True)
class Setting:
    """One word of a QoS, with its value if it has one: `depth 1`, `liveliness automatic`."""

    name: Name
    span: Span
    word: Name | None = None
    amount: Amount | None = None


@dataclass(frozen=True, slots=True)
class Item:
    """One use of an interface."""

    verb: Verb
    interface: Name
    span: Span
    marker: Name | None = None
    concurrent: bool = False
    qos: tuple[Setting, ...] = ()
    concurrent_at: Span | None = None
    each: Span | None = None
    """Set if named instances provide it."""
    policies: tuple[tuple[Name, Name], ...] = ()
    """Actions, each with what happens to a goal that arrives while another one is active."""


@dataclass(frozen=True, slots=True)
class Clause:
    """The content of a clause: its kind, the names in it, and its amount."""

    kind: str
    """Its first word in lower case; `legacy` for those of older generators, whose first name is that word."""
    span: Span
    names: tuple[Name, ...] = ()
    amount: Amount | None = None


@dataclass(frozen=True, slots=True)
class Timer:
    """A method that is called every period: `timer poll 20 ms;`."""

    name: Name
    period: Amount

    @property
    def method(self) -> str:
        return f"timer_{self.name}"


@dataclass(frozen=True, slots=True)
class Component:
    source: Source
    imports: tuple[Name, ...]
    name: Name
    span: Span
    items: tuple[Item, ...] = ()
    clauses: tuple[Clause, ...] = ()
    """All but the communications."""
    doc: str = ""
    skipped: frozenset[str] = frozenset()
    """The words that syntax errors left out of the model."""
    implied: tuple[Item, ...] = ()
    """The ports that an option adds."""

    def all(self, kind: str) -> list[Clause]:
        return [clause for clause in self.clauses if clause.kind == kind]

    @property
    def ports(self) -> tuple[Item, ...]:
        """All uses of interfaces."""
        return *self.implied, *self.items

    @property
    def agent(self) -> Name | None:
        """The option `agmagent`."""
        options = (name for clause in self.all("options") for name in clause.names)
        return next((name for name in options if name.text.lower() == "agmagent"), None)

    @property
    def implied_imports(self) -> tuple[str, ...]:
        """The files that are imported without being named."""
        return AGM if self.agent else ()

    @property
    def unnamed_agent_ports(self) -> list[tuple[Verb, str]]:
        """What the option `agmagent` adds to the ports."""
        named = {(item.verb, item.interface.text) for item in self.ports}
        return [each for each in AGENT if each not in named] if self.agent else []

    @property
    def language(self) -> Name | None:
        return self._name("language")

    @property
    def params(self) -> Name | None:
        """The path of its PDSL file."""
        return self._name("params")

    @property
    def statemachine(self) -> Name | None:
        """The path of the file of its state machine."""
        return self._name("statemachine")

    @property
    def period(self) -> Amount | None:
        return next((clause.amount for clause in self.all("period")), None)

    @property
    def timers(self) -> list[Timer]:
        clauses = ((clause.names, clause.amount) for clause in self.all("timer"))
        return [Timer(names[0], amount) for names, amount in clauses if names and amount]

    def _name(self, kind: str) -> Name | None:
        return next((clause.names[0] for clause in self.all(kind)), None)
