"""What SMDSL and SCXML files mean."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robocomp_py.contract.statemachine import State, StateMachine, Transition
from robocomp_py.dsl.syntax import MAX_CHARACTERS
from robocomp_py.dsl.workspace import Workspace, read_file

from ..texts import FOLDER, rendered


def workspace(**texts: str) -> Workspace:
    files = {str(FOLDER / name): text for name, text in texts.items()}

    def read(path: Path) -> bytes:
        return files[str(path)].encode() if str(path) in files else read_file(path)

    return Workspace(read=read)


def machine(text: str, name: str = "arm.smdsl") -> StateMachine:
    found = workspace(**{name: text})
    made = found.statemachine(FOLDER / name)
    assert made is not None, rendered(found)
    assert found.report.diagnostics == [], rendered(found)
    return made


def scxml(text: str, attributes: str = "") -> StateMachine:
    head = f'<scxml xmlns="http://www.w3.org/2005/07/scxml" version="1.0" name="arm" {attributes}>'
    return machine(f"{head}{text}</scxml>", "arm.scxml")


ROUND = """
/* What RoboComp's generator wrote for every component. */
round {
    states compute;
    initial_state initialize;
    end_state finalize;
    transitions {
        initialize => compute;
        compute => compute, finalize;
    };
};
"""


def test_a_machine_begins_in_its_initial_state_and_ends_in_its_end_state() -> None:
    assert machine(ROUND) == StateMachine(
        "round",
        (State("initialize"), State("compute"), State("finalize", final=True)),
        "initialize",
        (
            Transition("initialize", "compute"),
            Transition("compute", "compute"),
            Transition("compute", "finalize"),
        ),
    )


def test_blocks_say_what_is_inside_of_states_however_deep_and_in_any_order() -> None:
    found = machine(
        "arm { initial_state moving; };"
        ":lifting { initial_state up; }; :moving parallel { states turning, lifting; }; :up { initial_state high; };"
    )
    up = State("up", (State("high"),), "high")
    moving = State("moving", (State("turning"), State("lifting", (up,), "up")), parallel=True)
    assert found == StateMachine("arm", (moving,), "moving")


@pytest.mark.parametrize(
    "text",
    [
        ROUND.replace("transitions", "transition"),
        ROUND.replace("states", "STATES")
        .replace("initial_state", "Initial_State")
        .replace("transitions", "Transitions"),
        ROUND.replace("\n", "\r\n"),
        "\ufeff" + ROUND,
        ROUND.replace("};", "}"),
        ROUND.replace("states compute;", "states compute, ;").replace("compute, finalize;", "compute, finalize, ;"),
        ROUND.replace("compute, finalize;", "compute; compute => finalize;"),
        ROUND.replace("initialize =>", "initialize=>"),
    ],
    ids=["transition", "case", "crlf", "bom", "braces alone", "commas", "one by one", "no spaces"],
)
def test_the_forms_that_files_are_written_in_are_read(text: str) -> None:
    assert machine(text) == machine(ROUND)


def test_keywords_may_be_names_of_states() -> None:
    found = machine("machine { states transitions, parallel; initial_state states; end_state end_state;"
                    " transitions { states => transitions, parallel, end_state; }; };")  # fmt: skip
    assert [state.name for state in found.states] == ["states", "transitions", "parallel", "end_state"]


def test_a_transition_may_lead_to_any_state_of_the_machine() -> None:
    found = machine(
        "arm { initial_state a; states b; transitions { a => d; }; }; :b { initial_state d; transitions { d => a; }; };"
    )
    assert found.transitions == (Transition("a", "d"), Transition("d", "a"))


ENDS = """
work {
    initial_state sweep;
    states grip;
    end_state done;
    transitions { sweep => grip; grip => done; };
};
:sweep { initial_state turn; end_state done; transitions { turn => done; }; };
:grip { initial_state close; states open; end_state done; transitions { close => open, done; open => done; }; };
"""


def test_end_states_of_one_name_belong_to_their_parents() -> None:
    assert machine(ENDS) == StateMachine(
        "work",
        (
            State("sweep", (State("turn"), State("sweep.done", final=True)), "turn"),
            State("grip", (State("close"), State("open"), State("grip.done", final=True)), "close"),
            State("done", final=True),
        ),
        "sweep",
        (
            Transition("sweep", "grip"),
            Transition("grip", "done"),
            Transition("turn", "sweep.done"),
            Transition("close", "open"),
            Transition("close", "grip.done"),
            Transition("open", "grip.done"),
        ),
    )


def test_a_transition_leads_to_the_end_state_around_its_source_wherever_it_is_written() -> None:
    moved = ENDS.replace("grip => done;", "grip => done; turn => done;").replace("transitions { turn => done; };", "")
    assert set(machine(moved).transitions) == set(machine(ENDS).transitions)


def test_end_states_of_one_name_share_a_method_and_triggers_have_the_name_of_the_file() -> None:
    found = machine(ENDS)
    assert found.methods() == ["sm_sweep", "sm_turn", "sm_done", "sm_grip", "sm_close", "sm_open"]
    assert {"t_turn_to_done", "t_close_to_done", "t_grip_to_done"} < found.triggers().keys()


def test_a_transition_to_one_of_several_end_states_that_are_not_around_its_source_is_refused() -> None:
    text = ENDS.replace("end_state done;\n    transitions { sweep => grip; grip", "transitions { sweep => grip; sweep")
    found = workspace(**{"arm.smdsl": text})
    assert found.statemachine(FOLDER / "arm.smdsl") is None
    (told,) = found.report.errors
    assert told.message == "there are end states `done` of `sweep` and of `grip`"


@pytest.mark.parametrize("wrong", ["states done;", "initial_state done;"])
def test_only_end_states_may_share_a_name(wrong: str) -> None:
    found = workspace(**{"arm.smdsl": f"{ENDS} :open {{ initial_state on; {wrong} }};"})
    assert found.statemachine(FOLDER / "arm.smdsl") is None
    assert "state `done` is defined twice" in rendered(found)


def test_a_transition_that_is_there_twice_is_there_once() -> None:
    found = workspace(**{"arm.smdsl": ROUND.replace("compute => compute", "compute => compute, compute")})
    assert found.statemachine(FOLDER / "arm.smdsl") == machine(ROUND)
    assert [each.code for each in found.report.diagnostics] == ["repeated-transition"]


def test_scxml_means_the_same() -> None:
    assert scxml(
        '<state id="initialize"><transition event="e" target="compute"/></state>'
        '<state id="compute"><transition event="e" target="compute"/>'
        '<transition event="e.*  f" target="finalize"/></state>'
        '<final id="finalize"/>'
    ) == StateMachine(
        "arm",
        machine(ROUND).states,
        "initialize",
        (
            Transition("initialize", "compute", ("e",)),
            Transition("compute", "compute", ("e",)),
            Transition("compute", "finalize", ("e.*", "f")),
        ),
    )


def test_scxml_names_the_initial_state_by_attribute_by_element_or_by_its_place() -> None:
    found = scxml(
        '<state id="one" initial="b"><state id="a"/><state id="b"><transition event="e" target="a"/></state></state>'
        '<state id="two"><initial><transition target="d"/></initial><state id="c"/><state id="d">'
        '<transition event="e" target="c"/></state></state>'
        '<state id="three"><transition event="e" target="one"/><transition event="f" target="two"/>'
        '<state id="f"/></state>',
        'initial="three"',
    )
    assert found.initial == "three"
    assert [state.initial for state in found.states] == ["b", "d", "f"]


def test_scxml_may_begin_deep_inside_of_a_state() -> None:
    found = scxml('<state id="a"><state id="b"/><state id="c"><transition event="e" target="b"/></state></state>',
                  'initial="c"')  # fmt: skip
    assert (found.initial, found.states[0].initial) == ("c", "b")


def test_what_others_put_into_scxml_is_left_alone() -> None:
    found = scxml(
        '<qt:editorinfo initialGeometry="1;2"><qt:more/></qt:editorinfo><state id="a" qt:color="red">'
        "<qt:state id='b'/></state>",
        'xmlns:qt="http://www.qt.io/2015/02/scxml-ext"',
    )
    assert found.states == (State("a"),)


def test_a_component_has_the_machine_that_stands_beside_it() -> None:
    found = workspace(**{
        "arm.cdsl": 'Component arm { language python; statemachine "machines/arm.smdsl" visual; };',
        "machines/arm.smdsl": ROUND,
    })  # fmt: skip
    linked = found.component(FOLDER / "arm.cdsl")
    assert linked is not None, rendered(found)
    assert (linked.component.machine, linked.statemachine) == (machine(ROUND), "arm.smdsl")


def test_a_component_with_an_invalid_state_machine_is_not_linked() -> None:
    found = workspace(**{
        "arm.cdsl": 'Component arm { language python; statemachine "arm.smdsl"; };', "arm.smdsl": "arm { };"
    })  # fmt: skip
    assert found.component(FOLDER / "arm.cdsl") is None
    assert [each.code for each in found.report.diagnostics] == ["no-initial-state"]


def test_a_missing_file_is_reported_with_a_suggestion(tmp_path: Path) -> None:
    (tmp_path / "arm.cdsl").write_text('Component arm { language python; statemachine "amr.smdsl"; };')
    (tmp_path / "arm.smdsl").write_text(ROUND)
    found = Workspace()
    assert found.component(tmp_path / "arm.cdsl") is None
    [told] = found.report.diagnostics
    assert (told.code, told.hint) == ("missing-file", "did you mean `arm.smdsl`?")


def test_places_in_scxml_are_those_of_what_is_wrong() -> None:
    text = '<scxml xmlns="http://www.w3.org/2005/07/scxml">\n  <!-- äöü --><state id="a">\n' \
           '    <transition event="é" target="b"/></state></scxml>'  # fmt: skip
    found = workspace(**{"arm.scxml": text})
    assert found.statemachine(FOLDER / "arm.scxml") is None
    [told] = found.report.diagnostics
    assert (told.code, told.span.text, told.span.source.position(told.span.start)) == ("unknown-state", "b", (3, 35))


def told(text: str, name: str) -> list[str]:
    """What is wrong with a file; all of it can be shown."""
    found = workspace(**{name: text})
    made = found.statemachine(FOLDER / name)
    assert (made is None) == bool(found.report.errors)
    assert all(each.render() and each.to_json() for each in found.report.diagnostics)
    return [each.code for each in found.report.diagnostics]


@pytest.mark.parametrize(
    ("inside", "hint"),
    [
        ('<transition event="e" target="zebra"/>', 'add it: `<state id="zebra"/>`'),
        ('<parallel id="both"/>', "put some into it, or make it a `<state>`"),
        ('<parallel id="both"><final id="end"/></parallel>', "make it a `<state>`"),
    ],
)
def test_hints_for_scxml_are_in_its_words(inside: str, hint: str) -> None:
    found = workspace(**{"arm.scxml": f'<scxml><state id="a">{inside}</state></scxml>'})
    assert found.statemachine(FOLDER / "arm.scxml") is None
    assert [each.hint for each in found.report.errors] == [hint]


def test_states_a_thousand_deep_are_refused() -> None:
    inside = "".join(f":s{n} {{ initial_state s{n + 1}; }};\n" for n in range(1000))
    assert set(told(f"arm {{ initial_state s0; }};\n{inside}", "arm.smdsl")) == {"too-deep"}
    tags = "".join(f'<state id="s{n}">' for n in range(1000)), "</state>" * 1000
    assert told(f"<scxml>{tags[0]}{tags[1]}</scxml>", "arm.scxml") == ["syntax"]


def test_a_huge_scxml_file_is_refused_without_being_parsed() -> None:
    assert told("<scxml>" + " " * MAX_CHARACTERS, "arm.scxml") == ["too-large"]


PIECES = (
    *("<scxml>", '<scxml xmlns="http://www.w3.org/2005/07/scxml">', "<scxml initial='a b'>", "</scxml>"),
    *('<state id="a">', '<state id="b"/>', "</state>", '<parallel id="p">', "</parallel>", '<final id="c"/>'),
    *("<initial>", "</initial>", '<transition target="a"/>', '<transition event="e" target="b"/>', "<history/>"),
    *("<!-- x -->", "<![CDATA[", "]]>", "&amp;", "&y;", "<?x?>", '<!DOCTYPE x [<!ENTITY y "z">]>', "<x:y/>"),
    *("é", "\0", "\ud800", "\n", "<", ">", '"'),
)


@given(st.lists(st.sampled_from(PIECES), max_size=25))
def test_any_scxml_is_understood_or_complained_about(pieces: list[str]) -> None:
    told("".join(pieces).encode("utf-8", "replace").decode(), "arm.scxml")
    told(f"<scxml>{''.join(pieces)}</scxml>".encode("utf-8", "replace").decode(), "arm.scxml")
