"""What authors get to read, to the letter: place, source line, caret, remedy."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from robocomp_py.dsl.diagnostics import Diagnostic, DslError, Report, Severity, did_you_mean, ordered
from robocomp_py.dsl.source import Source

from .texts import FOLDER, rendered, workspace

pytestmark = pytest.mark.usefixtures("standard_folders_are_empty")

MESSAGES = {
    "an unknown type": (
        "arm.idsl",
        "module Arm {\n    interface Arm {\n        void move(Jiont j);\n    };\n    struct Joint { };\n};",
        """\
arm.idsl:3:19: error[unknown-type]: unknown type `Jiont`
            void move(Jiont j);
                      ^^^^^
    did you mean `Joint`?""",
    ),
    "a first word that lacks a letter, where there is no room for it": (
        "net.ddsl",
        "eployment net { Component x {}; };",
        """\
net.ddsl:1:1: error[syntax]: unexpected `eployment`; expected `Deployment` or `import`
    eployment net { Component x {}; };
    ^^^^^^^^^
    did you mean `Deployment`?""",
    ),
    "two definitions": (
        "arm.idsl",
        "module Arm {\n\tstruct Joint { };\n\tenum Joint { elbow };\n};",
        """\
arm.idsl:3:7: error[duplicate]: `Joint` is already defined
    \tenum Joint { elbow };
    \t     ^^^^^
  arm.idsl:2:9: first defined here
    \tstruct Joint { };
    \t       ^^^^^""",
    ),
    "the type that the paper never defines": (
        "speech.idsl",
        "module Speech {\n    struct dataenableSynchronization { bool on; };\n"
        "    interface Speech { [command]void sync(dataenableSynchronizationin pin); };\n};",
        """\
speech.idsl:3:43: error[unknown-type]: unknown type `dataenableSynchronizationin`
        interface Speech { [command]void sync(dataenableSynchronizationin pin); };
                                              ^^^^^^^^^^^^^^^^^^^^^^^^^^^
    did you mean `dataenableSynchronization`?""",
    ),
    "a module that is not imported": (
        "arm.idsl",
        "module Arm { struct Joint { RoboCompLaser::TData scan; }; };",
        """\
arm.idsl:1:29: error[missing-import]: module `RoboCompLaser` is not imported
    module Arm { struct Joint { RoboCompLaser::TData scan; }; };
                                ^^^^^^^^^^^^^^^^^^^^
    add: import "Laser.idsl";""",
    ),
    "a module that is neither imported nor to be found": (
        "arm.idsl",
        "module RoboCompLaser { struct Joint { RoboCompCamera9::T image; }; };",
        """\
arm.idsl:1:39: error[missing-import]: module `RoboCompCamera9` is not imported
    module RoboCompLaser { struct Joint { RoboCompCamera9::T image; }; };
                                          ^^^^^^^^^^^^^^^^^^
    add: import "Camera9.idsl";""",
    ),
    "a module that is imported, but misspelt": (
        "arm.idsl",
        'import "Laser.idsl";\nmodule RoboCompArm { struct Joint { RoboCompLazer::TData data; }; };',
        """\
arm.idsl:2:37: error[missing-import]: module `RoboCompLazer` is not imported
    module RoboCompArm { struct Joint { RoboCompLazer::TData data; }; };
                                        ^^^^^^^^^^^^^^^^^^^^
    did you mean `RoboCompLaser`?""",
    ),
    "a module whose name is like an imported one's, and can be imported": (
        "arm.idsl",
        'import "LaserPub.idsl";\nmodule RoboCompArm { struct Joint { RoboCompLaser9::TData data; }; };',
        """\
arm.idsl:2:37: error[missing-import]: module `RoboCompLaser9` is not imported
    module RoboCompArm { struct Joint { RoboCompLaser9::TData data; }; };
                                        ^^^^^^^^^^^^^^^^^^^^^
    add: import "Laser9.idsl";""",
    ),
    "a module of another language": (
        "arm.idsl",
        "module Arm { struct Joint { boost::optional data; }; };",
        """\
arm.idsl:1:29: error[missing-import]: module `boost` is not imported
    module Arm { struct Joint { boost::optional data; }; };
                                ^^^^^^^^^^^^^^^""",
    ),
    "a type of another language's module": (
        "arm.idsl",
        "module Arm { struct Joint { std::string name; }; };",
        """\
arm.idsl:1:29: error[missing-import]: module `std` is not imported
    module Arm { struct Joint { std::string name; }; };
                                ^^^^^^^^^^^
    did you mean `string`?""",
    ),
    "two interfaces that differ in case only": (
        "arm.idsl",
        "module Arm {\n    interface arm { };\n    interface Arm { };\n};",
        """\
arm.idsl:3:15: error[duplicate]: `Arm` and `arm` both need the name `ARM_INTERFACE` in Python
        interface Arm { };
                  ^^^
    rename one of them
  arm.idsl:2:15: first here
        interface arm { };
                  ^^^""",
    ),
    "two components that offer one name": (
        "two.ddsl",
        "Deployment two\n{\n    Component north { offers laser : Laser; };\n"
        "    Component south { offers laser : Laser; };\n};",
        """\
two.ddsl:4:30: error[duplicate]: `laser` is offered by `north`, too
        Component south { offers laser : Laser; };
                                 ^^^^^
    rename one of them, or put each component into a `System` of its own
  two.ddsl:3:30: first here
        Component north { offers laser : Laser; };
                                 ^^^^^""",
    ),
    "two handlers of one name": (
        "arm.cdsl",
        'import "M.idsl"; import "N.idsl";\nComponent arm { Communications { implements A, A_B; }; language python; };',
        """\
arm.cdsl:2:48: error[same-attribute]: `c` of `A_B` and `B_c` of `A` are both called `A_B_c` in Python
    Component arm { Communications { implements A, A_B; }; language python; };
                                                   ^^^
    rename one
  arm.cdsl:2:45: first here
    Component arm { Communications { implements A, A_B; }; language python; };
                                                ^""",
    ),
    "half a range of a list": (
        "arm.pdsl",
        "ComponentParams arm {\n    List motors [1:] { id int 0; };\n};",
        """\
arm.pdsl:2:20: error[syntax]: unexpected `]`; expected a number
        List motors [1:] { id int 0; };
                       ^
    a list's range has two whole numbers: `List motors [1:6] { … };`""",
    ),
    "a range in brackets": (
        "arm.pdsl",
        "ComponentParams arm {\n    List motors [1:2] { speed float 1 [0:2]; };\n};",
        """\
arm.pdsl:2:39: error[syntax]: unexpected `[`; expected a number, `;`, `T`, `dynamic` or `mandatory`
        List motors [1:2] { speed float 1 [0:2]; };
                                          ^
    a range has no brackets: `speed float 0.5 0:2;`""",
    ),
    "a type of another language": (
        "arm.idsl",
        "module Arm { struct Joint { char name; }; };",
        """\
arm.idsl:1:29: error[unknown-type]: unknown type `char`
    module Arm { struct Joint { char name; }; };
                                ^^^^
    did you mean `byte`?""",
    ),
    "a missing semicolon": (
        "arm.idsl",
        "module Arm {\n    struct Joint {\n        float angle\n        float speed;\n    };\n};",
        """\
arm.idsl:3:19: error[syntax]: expected `;` before `float`
            float angle
                      ^
    add `;` here""",
    ),
    "a misspelt keyword": (
        "arm.idsl",
        "module Arm {\n    strut Joint { };\n};",
        """\
arm.idsl:2:5: error[syntax]: unexpected `strut`; expected `[`, `const`, `dictionary`, `enum`, `exception`, \
`interface`, `sequence`, `struct` or …
        strut Joint { };
        ^^^^^
    did you mean `struct`?""",
    ),
    "a block that is not closed": (
        "arm.idsl",
        "module Arm {\n    struct Joint {\n        float angle;\n    struct Hand { };\n};",
        """\
arm.idsl:4:5: error[syntax]: unexpected `struct` in a block
        struct Hand { };
        ^^^^^^
    add `};` above it, to close the block before""",
    ),
    "a file that is not finished": (
        "arm.idsl",
        "module Arm\n{\n    struct Joint { };\n",
        """\
arm.idsl:3:21: error[syntax]: the file ends too early; expected `[`, `const`, `dictionary`, `enum`, `exception`, \
`interface`, `sequence`, `struct` or …
        struct Joint { };
                        ^
  arm.idsl:2:1: this `{` is not closed
    {
    ^""",
    ),
    "a wrong bracket": (
        "arm.idsl",
        "module Arm { struct Joint [ }; };",
        """\
arm.idsl:1:27: error[syntax]: unexpected `[`; expected `{`
    module Arm { struct Joint [ }; };
                              ^
    write `{` instead""",
    ),
    "an array as in C": (
        "arm.idsl",
        "module Arm { struct Joint { float raw[16]; }; };",
        """\
arm.idsl:1:38: error[syntax]: unexpected `[`; expected `;` or `=`
    module Arm { struct Joint { float raw[16]; }; };
                                         ^
    arrays are sequences: define `sequence<float> Values;`, then use `Values`""",
    ),
    "an input marked as such": (
        "arm.idsl",
        "module Arm { interface Arm { void move(in int x); }; };",
        """\
arm.idsl:1:47: error[syntax]: unexpected `x`; expected `)`, `,` or `=`
    module Arm { interface Arm { void move(in int x); }; };
                                                  ^
    inputs have no `in`; remove it""",
    ),
    "a stray word": (
        "arm.cdsl",
        "Component arm {\n    foo Communications { };\n    language python;\n};",
        """\
arm.cdsl:2:5: error[syntax]: unexpected `foo`; expected `Communications`, `gui`, `language`, `options`, `params`, \
`period`, `statemachine`, `timer` or …
        foo Communications { };
        ^^^
    remove it""",
    ),
    "a keyword that lacks a letter": (
        "arm.cdsl",
        "Component arm {\n    languge python;\n    language python;\n};",
        """\
arm.cdsl:2:5: error[syntax]: unexpected `languge`; expected `Communications`, `gui`, `language`, `options`, \
`params`, `period`, `statemachine`, `timer` or …
        languge python;
        ^^^^^^^
    did you mean `language`?
arm.cdsl:3:5: error[duplicate]: `language` is given twice
        language python;
        ^^^^^^^^^^^^^^^^
  arm.cdsl:2:5: first here
        languge python;
        ^^^^^^^^^^^^^^^""",
    ),
    "a port that nothing can come to": (
        "arm.cdsl",
        'import "Laser.idsl";\nComponent arm { Communications { subscribesTo Laser; }; language python; };',
        """\
arm.cdsl:2:47: warning[empty-port]: this port is empty: no operation of `Laser` can be published, because all return \
something
    Component arm { Communications { subscribesTo Laser; }; language python; };
                                                  ^^^^^
    write `requires Laser;`, or remove it""",
    ),
    "parameters that are imported": (
        "arm.cdsl",
        'import "arm.pdsl";\nComponent arm { language python; };',
        """\
arm.cdsl:1:9: error[wrong-import]: `arm.pdsl` is a PDSL file; expected here: an IDSL file
    import "arm.pdsl";
            ^^^^^^^^
    the parameters of a component are not imported: write params "arm.pdsl"; inside of it""",
    ),
    "an enum of nothing": (
        "arm.idsl",
        "module Arm { enum Mode { }; struct Hand { Mode mode; }; };",
        """\
arm.idsl:1:19: error[empty-enum]: `Mode` has no enumerators, so it has no value
    module Arm { enum Mode { }; struct Hand { Mode mode; }; };
                      ^^^^
    give it one: `enum Mode { none };`""",
    ),
    "a merge conflict": (
        "arm.idsl",
        "<<<<<<< HEAD\nmodule Arm { struct Joint { float angle; }; };\n"
        "=======\nmodule Arm { struct Joint { double angle; }; };\n>>>>>>> other\n",
        """\
arm.idsl:1:1: error[syntax]: a merge conflict is not resolved here
    <<<<<<< HEAD
    ^^^^^^^^^^^^
    keep one of the two versions, and remove the lines of `<<<<<<<`, `=======` and `>>>>>>>`""",
    ),
    "several names in one clause": (
        "arm.ddsl",
        "Deployment arm { Component hall { offers front, back : Range; }; };",
        """\
arm.ddsl:1:47: error[syntax]: unexpected `,`; expected `:`
    Deployment arm { Component hall { offers front, back : Range; }; };
                                                  ^
    each name has a clause of its own: offers front : Laser; offers back : Laser;""",
    ),
    "an import without quotes": (
        "arm.idsl",
        "import Laser.idsl;\nmodule Arm { };",
        """\
arm.idsl:1:8: error[syntax]: unexpected `Laser`; expected a text in double quotes
    import Laser.idsl;
           ^^^^^
    the name of a file stands in double quotes: `import "Laser.idsl";`""",
    ),
    "a file that is included as in C": (
        "arm.idsl",
        '#include "Laser.idsl"\nmodule Arm { };',
        """\
arm.idsl:1:1: error[stray-directive]: there is no preprocessor
    #include "Laser.idsl"
    ^^^^^^^^^^^^^^^^^^^^^
    write `import "Laser.idsl";`""",
    ),
    "an operation without a type": (
        "arm.idsl",
        "module Arm {\n    interface Arm {\n        stop();\n    };\n};",
        """\
arm.idsl:3:13: error[syntax]: unexpected `(`; expected a name or `::`
            stop();
                ^
    an operation begins with the type that it returns: `void stop();`""",
    ),
    "an operation as in C++": (
        "arm.idsl",
        "module Arm { interface Arm { void stop() = 0; }; };",
        """\
arm.idsl:1:42: error[syntax]: unexpected `=`; expected `;`, `feedback` or `throws`
    module Arm { interface Arm { void stop() = 0; }; };
                                             ^
    remove `= 0`: operations have no body""",
    ),
    "a reference as in C++": (
        "arm.idsl",
        "module Arm { interface Arm { void say(string &text); }; };",
        """\
arm.idsl:1:46: error[syntax]: unexpected `&`; expected a name or `::`
    module Arm { interface Arm { void say(string &text); }; };
                                                 ^
    values are passed: remove the `&` or `*`""",
    ),
    "a parameter without a name": (
        "arm.idsl",
        "module Arm { interface Arm { void move(int, int speed); }; };",
        """\
arm.idsl:1:43: error[syntax]: unexpected `,`; expected a name
    module Arm { interface Arm { void move(int, int speed); }; };
                                              ^
    a parameter has a type and a name""",
    ),
    "an operation that is not finished": (
        "arm.idsl",
        "module Arm {\n    interface Arm {\n        void move(int angle\n        void stop();\n    };\n};",
        """\
arm.idsl:3:27: error[syntax]: expected `);` before `void`
            void move(int angle
                              ^
    add `);` here""",
    ),
    "a fraction where an integer is expected": (
        "arm.idsl",
        "module Arm { enum Mode { off = 0.5 }; };",
        """\
arm.idsl:1:32: error[syntax]: unexpected `0.5`; expected an integer
    module Arm { enum Mode { off = 0.5 }; };
                                   ^^^""",
    ),
    "the template's window": (
        "arm.cdsl",
        "Component arm\n{\n    gui Qt(QWidget//QDialog//QMainWindow);\n    language python;\n};",
        """\
arm.cdsl:3:18: error[syntax]: expected `);` before `language`
        gui Qt(QWidget//QDialog//QMainWindow);
                     ^
    the `//` starts a comment: add `);` in front of it
arm.cdsl:3:5: warning[ineffective-gui]: a `gui` has no effect yet
        gui Qt(QWidget//QDialog//QMainWindow);
        ^^^^^^^^^^^^^^^^""",
    ),
    "a point for a comma": (
        "arm.cdsl",
        'import "Laser.idsl";\nComponent arm { Communications { requires Laser. GotoPoint; }; language python; };',
        """\
arm.cdsl:2:48: error[syntax]: unexpected `.`; expected `(`, `,`, `;`, `concurrent`, `each` or `qos`
    Component arm { Communications { requires Laser. GotoPoint; }; language python; };
                                                   ^""",
    ),
    "a clause of an older RoboComp": (
        "arm.cdsl",
        "Component arm { language python; useQt qt4; };",
        """\
arm.cdsl:1:34: warning[legacy-clause]: `useQt` is from an older RoboComp and has no effect
    Component arm { language python; useQt qt4; };
                                     ^^^^^^^^^^
    write `gui Qt;`""",
    ),
    "an accent": (
        "arm.idsl",
        "module Arm { struct ángulo { }; };",
        """\
arm.idsl:1:21: error[syntax]: unexpected `á` (latin small letter a with acute)
    module Arm { struct ángulo { }; };
                        ^
    names are made of the letters a to z, digits and `_`""",
    ),
    "the template's language": (
        "arm.cdsl",
        "Component arm\n{\n    language Cpp//Cpp11//python;\n    period 5 ms;\n};",
        """\
arm.cdsl:3:16: error[syntax]: expected `;` before `period`
        language Cpp//Cpp11//python;
                   ^
    the `//` starts a comment: write one language, then `;`
arm.cdsl:3:14: warning[not-python]: `language Cpp`: a Python component is generated anyway
        language Cpp//Cpp11//python;
                 ^^^
    write `language python;`""",
    ),
    "an interface that is not imported": (
        "arm.cdsl",
        "Component arm { Communications { requires Laser; }; language python; };",
        """\
arm.cdsl:1:43: error[missing-import]: interface `Laser` is not imported
    Component arm { Communications { requires Laser; }; language python; };
                                              ^^^^^
    add: import "Laser.idsl";""",
    ),
    "a misspelt word of a QoS": (
        "arm.cdsl",
        'import "LaserPub.idsl";\n'
        "Component arm { Communications { publishes LaserPub qos(relible); }; language python; };",
        """\
arm.cdsl:2:57: error[bad-qos]: `relible` is not a QoS setting
    Component arm { Communications { publishes LaserPub qos(relible); }; language python; };
                                                            ^^^^^^^
    did you mean `reliable`?""",
    ),
    "a period without a unit": (
        "arm.cdsl",
        "Component arm { language python; period 50; };",
        """\
arm.cdsl:1:41: error[bad-period]: a period needs a unit
    Component arm { language python; period 50; };
                                            ^^
    write `period 50 ms;` (units: us, ms, s, min)""",
    ),
    "a timer without a unit": (
        "arm.cdsl",
        "Component arm { language python; timer poll 50; };",
        """\
arm.cdsl:1:45: error[bad-period]: a timer needs a unit
    Component arm { language python; timer poll 50; };
                                                ^^
    write `timer poll 50 ms;` (units: us, ms, s, min)""",
    ),
    "a parameter as in C": (
        "arm.pdsl",
        "ComponentParams arm {\n    float speed 0.5;\n};",
        """\
arm.pdsl:2:11: error[syntax]: unexpected `speed`; expected a text in double quotes, `bool`, `double`, `enum`, \
`float`, `int` or `string`
        float speed 0.5;
              ^^^^^
    the name comes first: `speed float 0.5;`""",
    ),
    "a default out of its range": (
        "arm.pdsl",
        "ComponentParams arm {\n    speed float 5 0:2;\n};",
        """\
arm.pdsl:2:17: error[bad-default]: 5 is not from 0 to 2
        speed float 5 0:2;
                    ^""",
    ),
    "a misspelt clause of a deployment": (
        "net.ddsl",
        "Deployment net { Component arm { dependence leg; }; Component leg { }; };",
        """\
net.ddsl:1:34: error[syntax]: unexpected `dependence`; expected `allow`, `args`, `config`, \
`dependences`, `env`, `existing`, `grace`, `host` or …
    Deployment net { Component arm { dependence leg; }; Component leg { }; };
                                     ^^^^^^^^^^
    did you mean `dependences`?""",
    ),
    "a host where its block belongs": (
        "net.ddsl",
        "Deployment net { host onboard; };",
        """\
net.ddsl:1:30: error[syntax]: unexpected `;`; expected `{`
    Deployment net { host onboard; };
                                 ^
    say where it is: host onboard { address "192.168.1.10"; };""",
    ),
    "a clause of the network in the block of a component": (
        "net.ddsl",
        "Deployment net { Component arm { escalation one_for_all; grace 5; }; };",
        """\
net.ddsl:1:34: error[syntax]: unexpected `escalation`; expected `allow`, `args`, `config`, \
`dependences`, `env`, `existing`, `grace`, `host` or …
    Deployment net { Component arm { escalation one_for_all; grace 5; }; };
                                     ^^^^^^^^^^
    write it for the network or for a `System`""",
    ),
    "a clause of a component in the block of a system": (
        "net.ddsl",
        'Deployment net { System arms { notifies; Component arm { existing "reach"; }; }; };',
        """\
net.ddsl:1:32: error[syntax]: unexpected `notifies`; expected `Component`, `System`, `escalation`, `host`, `restart` \
or `}`
    Deployment net { System arms { notifies; Component arm { existing "reach"; }; }; };
                                   ^^^^^^^^
    write it in the block of each component""",
    ),
    "a generated component that is to say when it is ready": (
        "net.ddsl",
        "Deployment net { Component arm { notifies; }; };",
        """\
net.ddsl:1:34: error[not-a-program]: `arm` is a generated component, which reports by itself when it is ready
    Deployment net { Component arm { notifies; }; };
                                     ^^^^^^^^^
    remove it, or name the program by `path` or `existing`""",
    ),
    "the word of a host in another case": (
        "net.ddsl",
        'Deployment net { Host onboard { address "10.0.0.1"; }; };',
        """\
net.ddsl:1:18: error[syntax]: unexpected `Host`; expected `Component`, `System`, `allow`, `clock`, `escalation`, \
`host`, `middleware`, `namespace` or …
    Deployment net { Host onboard { address "10.0.0.1"; }; };
                     ^^^^
    did you mean `host`?""",
    ),
    "the settings of a restart without parentheses": (
        "net.ddsl",
        "Deployment net { restart always 5; };",
        """\
net.ddsl:1:33: error[syntax]: unexpected `5`; expected `(` or `;`
    Deployment net { restart always 5; };
                                    ^
    settings have names and are written in parentheses: restart on_failure(intensity 5);""",
    ),
    "spaces in the name of an instance of a system": (
        "net.ddsl",
        "Deployment net { Component a { dependences left / arm; }; };",
        """\
net.ddsl:1:49: error[syntax]: unexpected `/`; expected `,` or `;`
    Deployment net { Component a { dependences left / arm; }; };
                                                    ^
    there are no spaces around the slash: left/arm""",
    ),
    "an address with dots but without quotes": (
        "net.ddsl",
        "Deployment net { host a { address robot.local; }; };",
        """\
net.ddsl:1:40: error[syntax]: unexpected `.`; expected `;`
    Deployment net { host a { address robot.local; }; };
                                           ^
    a name with dots or dashes needs double quotes: "robot.local\"""",
    ),
}


OTHERS = {
    "M.idsl": "module M { interface A { [command] void B_c(int x); }; };",
    "Laser9.idsl": "module RoboCompLaser9 { };",
    "N.idsl": "module N { interface A_B { [command] void c(int y); }; };",
}
"""What the files above import, beside what is shipped."""


@pytest.mark.parametrize("name", MESSAGES)
def test_a_message_is_clear(name: str) -> None:
    file, text, wanted = MESSAGES[name]
    found = workspace(**OTHERS, **{file: text})
    found.check(FOLDER / file)
    assert rendered(found) == wanted


# Diagnostics.

SOURCE = Source(Path("arm.idsl"), "one\ntwo three\r\nfour")


def test_lines_and_columns_count_from_one() -> None:
    places = [SOURCE.position(offset) for offset in (0, 3, 4, 8, 15, len(SOURCE.text))]
    assert places == [(1, 1), (1, 4), (2, 1), (2, 5), (3, 1), (3, 5)]
    assert [SOURCE.line(number) for number in (1, 2, 3)] == ["one", "two three", "four"]


def test_a_diagnostic_for_machines_ends_behind_its_last_character() -> None:
    diagnostic = Diagnostic("bad", "this is bad", SOURCE.span(8, 13), Severity.WARNING, "do better")
    assert diagnostic.to_json() == {
        "file": "arm.idsl",
        "line": 2,
        "column": 5,
        "end_line": 2,
        "end_column": 10,
        "severity": "warning",
        "code": "bad",
        "message": "this is bad",
        "hint": "do better",
    }
    assert json.dumps(diagnostic.to_json()).isascii()


def test_carets_end_with_the_line() -> None:
    [_, line, carets] = Diagnostic("bad", "this is bad", SOURCE.span(8, 19)).render().splitlines()
    assert (line.strip(), carets.strip()) == ("two three", "^^^^^")


def test_an_error_shows_all_its_diagnostics_in_the_order_of_the_file() -> None:
    report = Report()
    report.error("later", "later", SOURCE.span(8, 13))
    report.error("sooner", "sooner", SOURCE.span(0, 3))
    assert [each.code for each in ordered(report.diagnostics)] == ["sooner", "later"]
    shown = str(DslError(report.diagnostics))
    assert shown.index("sooner") < shown.index("later")


@pytest.mark.parametrize(
    ("name", "proposal"),
    [("Lazer", "did you mean `Laser`?"), ("laser", "did you mean `Laser`?"), ("Speech", ""), ("", "")],
)
def test_a_proposal_is_made_only_for_what_is_close(name: str, proposal: str) -> None:
    assert did_you_mean(name, ["Laser", "Camera"]) == proposal
