"""Mistakes in state machines."""

from __future__ import annotations

from .seed import Seed

RIGHT = {
    "patrol.smdsl": """\
patrol
{
    states drive, avoid, charge;
    initial_state begin;
    end_state done;
    transitions
    {
        begin => drive;
        drive => avoid, charge, done;
        avoid => drive;
        charge => drive;
    };
};

: drive parallel
{
    states look, steer;
};

: charge
{
    states dock;
    initial_state seek;
    end_state full;
    transitions
    {
        seek => dock;
        dock => full;
    };
};
""",
    "patrol.cdsl": """\
Component patrol
{
    language python;
    statemachine "patrol.smdsl";
};
""",
}

_FILE = "patrol.smdsl"

SEEDS = [
    Seed("a state misspelt", "unknown-state", _FILE, {"begin => drive;": "begin => «drvie»;"}),
    Seed("a source misspelt", "unknown-state", _FILE, {"avoid => drive;": "«aviod» => drive;"}),
    Seed("a parent misspelt", "unknown-state", _FILE, {": charge\n": ": «chrage»\n"}),
    Seed("an arrow of C++", "syntax", _FILE, {"seek => dock": "seek «-»> dock"}),
    Seed("a semicolon forgotten", "syntax", _FILE, {"begin => drive;": "begin => driv«e»"}),
    Seed("a comma forgotten", "syntax", _FILE, {"drive, avoid, charge;": "drive, avoi«d» charge;"}),
    Seed("a keyword misspelt", "syntax", _FILE, {"    states dock": "    «sates» dock"}),
    Seed(
        "the initial state forgotten",
        "no-initial-state",
        _FILE,
        {
            "    initial_state begin;\n": "",
            "patrol\n{": "«patrol»\n{",
            "begin => drive;\n": "",
        },
    ),
    Seed(
        "an initial state among the others",
        "duplicate",
        _FILE,
        {"states drive": "states drive, «begin»"},
    ),
    Seed("a state twice", "duplicate", _FILE, {"look, steer": "look, steer, «look»"}),
    Seed(
        "a transition twice",
        "repeated-transition",
        _FILE,
        {"drive => avoid, charge": "drive => avoid, charge, «avoid»"},
        "warning",
    ),
    Seed(
        "a way out of the end",
        "leaves-end-state",
        _FILE,
        {"charge => drive;": "charge => drive;\n        «done» => drive;"},
    ),
    Seed(
        "a parallel state that begins somewhere",
        "clause-of-parallel",
        _FILE,
        {": drive parallel\n{\n": ": drive parallel\n{\n    initial_state «aim»;\n"},
    ),
    Seed(
        "a state that nothing leads to",
        "unreachable-state",
        _FILE,
        {"states drive, avoid": "states drive, «sleep», avoid"},
        "warning",
    ),
    Seed("the machine misspelt", "missing-file", "patrol.cdsl", {'"patrol.smdsl"': '"«patrl.smdsl»"'}),
]

TOGETHER = {
    "a state misspelt",
    "a source misspelt",
    "an arrow of C++",
    "a keyword misspelt",
    "a state twice",
    "a transition twice",
    "a way out of the end",
    "a parallel state that begins somewhere",
    "the machine misspelt",
}
