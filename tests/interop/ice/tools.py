"""A program with Ice alone, which asks and serves as the components that RoboComp generates do.

    tools.py serve ENDPOINT    a workshop; says `ready PROXY`, and at its end what was tidied
    tools.py stay ENDPOINT     the same, until it is ended
    tools.py ask PROXY         asks a workshop, and prints what it was told, a line of JSON each
    tools.py probe PROXY       the same, by what Ice has beside calls: types, facets, contexts, one way, wrong names

Run in the folder with what slice2py made of the Slice of `rcgen Workshop.idsl --to slice`.
"""

from __future__ import annotations

import json
import sys

sys.path.insert(0, ".")

import Ice
import RoboCompWorkshop as workshop

HAMMER = workshop.Tool("hammer", workshop.Quality.good, 1.5)
NOTHING = b"\6\0\0\0\1\1"
SAW = workshop.Tool("Säge", workshop.Quality.bad, 0.25)


class Workshop(workshop.Workshop):
    """The same as the component `workshop`, written as for RoboComp."""

    def __init__(self):
        self.shelves = []

    def divide(self, dividend, divisor, current=None):
        if divisor == 0:
            raise workshop.Trouble("division by zero")
        return dividend // divisor, dividend % divisor

    def tools(self, least, current=None):
        found = [each for each in (HAMMER, SAW) if each.quality.value >= least.value]
        return found, {each.name: 1 for each in found}, [each.weight for each in found]

    def borrow(self, tool, current=None):
        if tool.name != "hammer":
            raise workshop.Missing("not there", tool, 7)

    def polish(self, raw, twice, current=None):
        return bytes(reversed(raw)) * (2 if twice else 1)

    def fail(self, how, current=None):
        raise RuntimeError(how)

    def tidy(self, shelf, current=None):
        self.shelves.append(shelf)

    def tidied(self, current=None):
        return len(self.shelves)


def tell(*values):
    print(json.dumps(values), flush=True)


def plain(value):
    """A value of Ice's as JSON has it."""
    if isinstance(value, workshop.Tool):
        return [value.name, str(value.quality), value.weight]
    return [plain(each) for each in value] if isinstance(value, (list, tuple)) else value


def attempt(call):
    """What a call returns, or what it raises, with its fields."""
    try:
        return plain(call())
    except workshop.Missing as exc:
        return ["Missing", exc.what, plain(exc.tool), exc.shelf]
    except workshop.Trouble as exc:
        return ["Trouble", exc.what]
    except Ice.UnknownException as exc:
        kind, _, reason = exc.unknown.splitlines()[0].partition(": ")
        return ["UnknownException", kind, reason]
    except Ice.Exception as exc:
        return [type(exc).__name__]


def ask(proxy):
    there = workshop.WorkshopPrx.checkedCast(proxy)
    tell("divide", attempt(lambda: there.divide(17, 5)))
    tell("divide by zero", attempt(lambda: there.divide(1, 0)))
    tell("tools", attempt(lambda: there.tools(workshop.Quality.bad)))
    tell("good tools", attempt(lambda: there.tools(workshop.Quality.good)))
    tell("borrow", attempt(lambda: there.borrow(HAMMER)))
    tell("borrow what is missing", attempt(lambda: there.borrow(SAW)))
    tell("polish", list(there.polish(bytes(range(5)), True)))
    tell("a megabyte", there.polish(bytes(900_000), False) == bytes(900_000))
    tell("fail", attempt(lambda: there.fail("on purpose")))
    there.tidy(1)  # two-way, as programs do that know of no commands
    workshop.WorkshopPrx.uncheckedCast(proxy.ice_oneway()).tidy(2)
    while there.tidied() < 2:  # another connection: it may be overtaken
        pass
    tell("tidied", there.tidied())


def probe(proxy):
    there = workshop.WorkshopPrx.uncheckedCast(proxy)
    tell("ids", there.ice_ids())
    tell("is a workshop", there.ice_isA("::RoboCompWorkshop::Workshop"))
    tell("is another", there.ice_isA("::RoboCompLaser::Laser"))
    tell("id", there.ice_id())
    tell("by a facet", attempt(lambda: workshop.WorkshopPrx.uncheckedCast(there.ice_facet("x")).divide(7, 2)))
    tell("with a context", attempt(lambda: there.divide(7, 2, {"rc": "not yours", "other": "1"})))
    tell("fails with a context", attempt(lambda: there.fail("odd", {"rc": "not yours"})))
    tell("idempotent as normal", there.ice_invoke("tidied", Ice.OperationMode.Idempotent, NOTHING)[0])
    tell("one way", attempt(lambda: there.ice_oneway().ice_invoke("tidied", Ice.OperationMode.Normal, NOTHING)[0]))
    nobody = there.ice_identity(Ice.stringToIdentity("nobody"))
    tell("another name", attempt(nobody.ice_ping))
    tell("another operation", attempt(lambda: there.ice_invoke("dance", Ice.OperationMode.Normal, NOTHING)))
    tell("nonsense", attempt(lambda: there.ice_invoke("divide", Ice.OperationMode.Normal, b"\7\0\0\0\1\1\0")))
    tell("divide", attempt(lambda: there.divide(17, 5)))


def main(act, where):
    with Ice.initialize(["--Ice.Default.Host=127.0.0.1"]) as communicator:
        if act in ("serve", "stay"):
            adapter = communicator.createObjectAdapterWithEndpoints("Workshop", where)
            servant = Workshop()
            proxy = adapter.add(servant, Ice.stringToIdentity("workshop"))
            adapter.activate()
            print("ready", proxy, flush=True)
            if act == "stay":
                communicator.waitForShutdown()
            sys.stdin.read()
            tell("tidied", servant.shelves)
        else:
            {"ask": ask, "probe": probe}[act](communicator.stringToProxy(where).ice_invocationTimeout(10_000))


main(*sys.argv[1:])
