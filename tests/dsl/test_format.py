"""How files look when they are formatted."""

from __future__ import annotations

from pathlib import Path
from textwrap import dedent

import pytest

from robocomp_py.cli.rcgen import main as rcgen
from robocomp_py.dsl.diagnostics import DslError, Report
from robocomp_py.dsl.format import LANGUAGES, format_text
from robocomp_py.dsl.idsl.model import Struct
from robocomp_py.dsl.idsl.parser import parse as parse_idsl
from robocomp_py.dsl.source import Source
from robocomp_py.dsl.workspace import ENDINGS, SHIPPED

ROOT = Path(__file__).parents[2]
OURS = [*SHIPPED.iterdir(), *(ROOT / "components").rglob("*")]


def expect(language: str, text: str, result: str) -> None:
    """That a text becomes that one, which is left as it is."""
    wanted = dedent(result).lstrip("\n")
    assert format_text(dedent(text), language) == wanted
    assert format_text(wanted, language) == wanted


def expect_inside(text: str, result: str) -> None:
    """The same of what is in an IDSL module."""
    inside = "".join(f"    {line}\n" if line else "\n" for line in dedent(result).strip("\n").split("\n"))
    expect("idsl", f"module M {{\n{dedent(text)}\n}};", f"module M\n{{\n{inside}}};\n")


def docs(text: str) -> list[str]:
    """What documents the first struct of a file, and its fields."""
    file = parse_idsl(Source(Path("m.idsl"), text), Report())
    assert file is not None
    struct = file.definitions[0]
    assert isinstance(struct, Struct)
    return [struct.doc, *(field.doc for field in struct.fields)]


# Statements and blocks.


def test_a_file_of_interfaces_in_our_style() -> None:
    expect(
        "idsl",
        """
        import "A.idsl" ; import"B.idsl";
        module   M{
        \tsequence <int>Ints ;
        \tdictionary<string,Ints>ByName;
        \tenum Side{left,right=2};
          exception Failed extends B :: Failed{ string what="none" ; }
        \tinterface Arm
        \t{
        \t\t[ query ]idempotent  Ints  get( int a,out Ints b )throws Failed ,B::Late;


        \t\tvoid stop ( ) ;
        \t};
        }
        """,
        """
        import "A.idsl";
        import "B.idsl";

        module M
        {
            sequence<int> Ints;
            dictionary<string, Ints> ByName;
            enum Side { left, right = 2 };

            exception Failed extends B::Failed
            {
                string what = "none";
            };

            interface Arm
            {
                [query] idempotent Ints get(int a, out Ints b) throws Failed, B::Late;

                void stop();
            };
        };
        """,
    )


def test_a_component_in_our_style() -> None:
    expect(
        "cdsl",
        """
        IMPORT "Laser.idsl"; // beams
        component arm{
        communications{
        Requires Laser(ice),Laser qos( sensor_data,deadline 5ms,),;
        SUBSCRIBESTO LaserPub concurrent qos(depth 1) ;
        };
        language   Cpp11 ;gui qt( QWidget );options dsr,agmagent;
        stateMachine "a.smdsl" Visual;
        period 50 ms;TIMER poll  20ms ;
        }
        """,
        """
        import "Laser.idsl"; // beams

        Component arm
        {
            Communications
            {
                requires Laser(ice), Laser qos(sensor_data, deadline 5 ms);
                subscribesTo LaserPub concurrent qos(depth 1);
            };
            language Cpp11;
            gui qt(QWidget);
            options dsr, agmagent;
            statemachine "a.smdsl" visual;
            period 50 ms;
            timer poll 20 ms;
        };
        """,
    )


def test_parameters_in_our_style() -> None:
    expect(
        "pdsl",
        """
        ComponentParams arm{device "where" string "/dev/a" mandatory;
        speed float 0.5 -1 : 2;mode enum walk{walk,"stand still"}T;
        List motors "all" [ 1 : 6 ]{id int 0;List none{};}}
        """,
        """
        ComponentParams arm
        {
            device "where" string "/dev/a" mandatory;
            speed float 0.5 -1:2;
            mode enum walk { walk, "stand still" } T;

            List motors "all" [1:6]
            {
                id int 0;
                List none { };
            };
        };
        """,
    )


def test_a_deployment_in_our_style() -> None:
    expect(
        "ddsl",
        """
        import "a.cdsl"; Deployment net{middleware zenoh;namespace a / b;
        Component x:a{ip ::1;args "a","b";requires Laser from y;process p;qos publishes X( reliable,deadline 5 ms,) ;}
        Component y:a{};Component z:a{existing "z";notifies;}}
        """,
        """
        import "a.cdsl";

        Deployment net
        {
            middleware zenoh;
            namespace a/b;

            Component x : a
            {
                ip ::1;
                args "a", "b";
                requires Laser from y;
                process p;
                qos publishes X(reliable, deadline 5 ms);
            };
            Component y : a { };

            Component z : a
            {
                existing "z";
                notifies;
            };
        };
        """,
    )


def test_a_state_machine_in_our_style() -> None:
    expect(
        "smdsl",
        """
        game{states play,rest;initial_state wait;transitions{wait=>play,rest;play=>wait;}}
        : play Parallel{states left;}
        """,
        """
        game
        {
            states play, rest;
            initial_state wait;
            transitions
            {
                wait => play, rest;
                play => wait;
            };
        };

        :play parallel
        {
            states left;
        };
        """,
    )


def test_a_keyword_that_is_used_as_a_name_keeps_its_case() -> None:
    expect_inside(
        "interface Module { void Interface(int STRUCT); };", "interface Module\n{\n    void Interface(int STRUCT);\n};"
    )
    text = "Component GUI\n{\n    Communications\n    {\n        requires Requires, Qos qos(Depth 1);\n    };\n};\n"
    expect("cdsl", text, text)


def test_clauses_of_older_generators_are_kept() -> None:
    expect(
        "cdsl",
        "Component a { robocompclasses { A,B }; Worker  isThread; RoboCompModules{}; useqt qt4; };",
        """
        Component a
        {
            robocompclasses { A, B };
            Worker isThread;
            RoboCompModules { };
            useqt qt4;
        };
        """,
    )


def test_semicolons_that_end_nothing_go() -> None:
    expect_inside("struct A { ; int x;; };;sequence<A> As; ;", "struct A\n{\n    int x;\n};\nsequence<A> As;")


def test_a_text_keeps_what_looks_like_something_else() -> None:
    expect_inside('const string x="a  //  /* {;,\t";', 'const string x = "a  //  /* {;,\t";')


# Lines that are too long.


def test_feedback_has_a_line_of_its_own_if_it_is_too_much() -> None:
    expect_inside(
        f"interface I {{ [action]int go(float {'a' * 40}) feedback ( float {'b' * 40} )throws Failed; }};",
        f"""
        interface I
        {{
            [action] int go(float {"a" * 40})
                feedback(float {"b" * 40})
                throws Failed;
        }};
        """,
    )


def test_an_operation_that_is_too_long_throws_on_a_line_of_its_own() -> None:
    expect_inside(
        f"interface I {{ void drive(float {'a' * 40}, float {'b' * 40}) throws Failed, HardwareFailedException; }};",
        f"""
        interface I
        {{
            void drive(float {"a" * 40}, float {"b" * 40})
                throws Failed, HardwareFailedException;
        }};
        """,
    )


def test_parameters_that_are_too_many_stand_below_each_other() -> None:
    expect_inside(
        f"interface I {{ void drive(float {'a' * 50}, float {'b' * 50}, out int c); }};",
        f"""
        interface I
        {{
            void drive(float {"a" * 50},
                       float {"b" * 50},
                       out int c);
        }};
        """,
    )


def test_parameters_that_were_broken_for_no_reason_are_on_one_line() -> None:
    expect_inside("interface I { void f(int a,\n   int b\n ); };", "interface I\n{\n    void f(int a, int b);\n};")


def test_what_a_component_requires_stands_below_each_other_if_it_is_too_much() -> None:
    names = [f"{letter * 30} qos(sensor_data, depth 1)" for letter in "ABC"]
    expect(
        "cdsl",
        f"Component c {{ Communications {{ subscribesTo {','.join(names)}; }}; }};",
        f"""
        Component c
        {{
            Communications
            {{
                subscribesTo {names[0]},
                             {names[1]},
                             {names[2]};
            }};
        }};
        """,
    )


def test_an_enumeration_that_is_too_long_has_one_member_a_line() -> None:
    long, other = "a" * 60, "b" * 60
    expect_inside(f"enum E {{ {long}, {other} }};", f"enum E\n{{\n    {long},\n    {other}\n}};")


@pytest.mark.parametrize("inside", ["a,\nb,", "a,\n\nb", "a, // first\nb", "a,\n/* second */\nb"])
def test_an_enumeration_stays_one_member_a_line_if_there_is_a_reason(inside: str) -> None:
    expect_inside(
        f"enum E {{ {inside} }};",
        "enum E\n{\n" + "".join(f"    {line}\n".replace("    \n", "\n") for line in inside.split("\n")) + "};",
    )


def test_an_enumeration_that_fits_is_on_one_line() -> None:
    expect_inside("enum E\n{\n  a,\n  b = 1\n};", "enum E { a, b = 1 };")


# Blank lines.


def test_several_blank_lines_become_one_and_those_at_the_ends_of_blocks_go() -> None:
    expect_inside("\n\nsequence<int> A;\n\n \n\nsequence<int> B;\n\n", "sequence<int> A;\n\nsequence<int> B;")


def test_a_blank_line_comes_above_a_block_and_above_what_describes_it() -> None:
    expect_inside(
        "sequence<int> A;\n// A place.\nstruct P\n{\n    int x;\n};\nsequence<P> Ps;",
        "sequence<int> A;\n\n// A place.\nstruct P\n{\n    int x;\n};\nsequence<P> Ps;",
    )


def test_a_comment_that_is_apart_from_a_block_stays_so() -> None:
    text = "sequence<int> A;\n// From here on: places.\n\nstruct P\n{\n    int x;\n};"
    expect_inside(text, text)


# Comments.


def test_comments_behind_lines_are_brought_into_one_column() -> None:
    expect_inside(
        "struct P {\n int a; // one\n float bcd;// two\n\n int e; // three\n};",
        "struct P\n{\n    int a;     // one\n    float bcd; // two\n\n    int e; // three\n};",
    )


def test_comments_in_one_column_stay_as_far_away_as_they_are() -> None:
    text = "int a;         // one\n    float bcd;     // two\n    string efghijklmnop;\n    int q;         // three"
    expect_inside(f"struct P\n{{\n    {text}\n}};", f"struct P\n{{\n    {text}\n}};")


def test_comments_behind_lines_of_very_different_lengths_are_left_where_they_are() -> None:
    text = f"interface I\n{{\n    void a(); // one\n    void b(int {'c' * 60}); // two\n}};"
    expect_inside(text, text)


def test_a_comment_behind_a_block_is_close_to_it() -> None:
    expect_inside("struct P { int x; };     // a place", "struct P\n{\n    int x;\n}; // a place")


def test_a_block_of_comments_has_no_blank_lines_at_its_ends() -> None:
    expect_inside("struct P {\n\n// nothing\n\n};", "struct P\n{\n    // nothing\n};")


def test_a_comment_behind_a_block_describes_that_and_nothing_in_it() -> None:
    text = "module M { struct P { int x; }; // a place\n };"
    assert docs(text) == docs(format_text(text, "idsl")) == ["a place", ""]


def test_a_comment_on_a_line_of_its_own_is_indented_as_what_follows() -> None:
    expect_inside(
        "\t\t// above\n  struct P { // behind\n// first\n int x;\n\n// last\n\n}; // end\n// below",
        "// above\nstruct P // behind\n{\n    // first\n    int x;\n\n    // last\n}; // end\n// below",
    )


def test_the_lines_of_a_comment_move_together() -> None:
    expect_inside(
        "  /* one\n       two\n     three */\n struct P { };\n/**\n* with stars\n\t\t*/\nstruct Q { };",
        "/* one\n     two\n   three */\nstruct P { };\n/**\n * with stars\n */\nstruct Q { };",
    )


def test_comments_amid_a_statement_stay_there() -> None:
    expect_inside(
        "interface I { void /* quick */ f(/*mm*/ int a, /* s */int b /*last*/ ) ; };",
        "interface I\n{\n    void /* quick */ f(/*mm*/ int a, /* s */ int b /*last*/);\n};",
    )


def test_a_comment_behind_a_parameter_ends_its_line() -> None:
    expect_inside(
        "interface I { void f(int a, // mm\n float b // s\n, int c); };",
        "interface I\n{\n    void f(int a,   // mm\n           float b, // s\n           int c);\n};",
    )


def test_a_semicolon_that_goes_does_not_turn_a_comment_into_documentation() -> None:
    text = "module M { struct A { int a;\n; // about nothing\nint b; }; };"
    assert docs(text) == docs(format_text(text, "idsl")) == ["", "", ""]
    assert "// about nothing\n\n" in format_text(text, "idsl")


# Files.


def test_lines_end_in_a_newline_and_there_is_no_byte_order_mark() -> None:
    assert format_text("\ufeffmodule M\r\n{\r\n // a\r\n};", "idsl") == "module M\n{\n    // a\n};\n"


def test_a_syntax_error_is_reported_with_its_place() -> None:
    with pytest.raises(DslError, match=r"arm\.idsl:1:27: error\[syntax\]: expected `;` before `}`"):
        format_text("\ufeffmodule M { struct P { int x } };", "idsl", Path("arm.idsl"))


def test_what_is_wrong_but_for_the_syntax_does_not_matter() -> None:
    expect_inside("struct A { Nobody x; };", "struct A\n{\n    Nobody x;\n};")


def test_every_language_can_be_formatted() -> None:
    assert {f".{each}" for each in LANGUAGES} == set(ENDINGS)


@pytest.mark.parametrize("path", [each for each in OURS if each.suffix in ENDINGS], ids=lambda path: path.name)
def test_what_we_ship_is_formatted(path: Path) -> None:
    text = path.read_text()
    assert format_text(text, path.suffix[1:]) == text


@pytest.mark.parametrize("name", ["Hello", "ANameThatIsLonger"])
def test_what_a_new_component_begins_with_is_formatted(name: str, tmp_path: Path) -> None:
    assert rcgen(["--new", name, "-o", str(tmp_path / "new")]) == 0
    models = [path for path in (tmp_path / "new").iterdir() if path.suffix in ENDINGS]
    assert len(models) == 3
    for path in models:
        assert format_text(path.read_text(), path.suffix[1:]) == path.read_text()


def test_a_file_as_long_as_can_be_is_formatted() -> None:
    lines = "".join(f"    int field{number}; // number {number}\n" for number in range(10_000))
    text = f"module M\n{{\n    struct S\n    {{\n{lines.replace('    int', '        int')}    }};\n}};\n"
    assert format_text(text.replace("        int", "\tint"), "idsl").count("\n") == text.count("\n")
