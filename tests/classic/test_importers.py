"""Networks of other tools become DDSL; of what it cannot hold a comment tells, with its line."""

from __future__ import annotations

import re
import resource
import signal
from pathlib import Path
from xml.sax.saxutils import quoteattr

import pytest

from robocomp_py.classic.importers import to_ddsl
from robocomp_py.cli.rc import main as rc
from robocomp_py.cli.rcdeploy import main as rcdeploy
from robocomp_py.deploy.planner import make_plan
from robocomp_py.dsl.ddsl.parser import parse
from robocomp_py.dsl.diagnostics import Report
from robocomp_py.dsl.source import Source
from robocomp_py.dsl.workspace import Workspace
from tests.hostile import NASTY

Said = pytest.CaptureFixture[str]

LASER = """Component laserComp { Communications { implements Laser; }; language python; };"""
DRIVER = """import "Laser.idsl";
Component driver { Communications { requires Laser; }; language python; };"""


def node(alias: str, *inside: str, endpoint: str = "") -> str:
    return f'<node alias="{alias}" endpoint="{endpoint}">{"".join(inside)}</node>'


def up(command: str) -> str:
    return f'<upCommand command="{command}"/>'


def rcmanager(*nodes: str) -> str:
    return "<rcmanager>\n" + "\n".join(nodes) + "\n</rcmanager>\n"


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """A folder with the components `laser` and `driver`, as their users have them."""
    for name, text in (("laser", 'import "Laser.idsl";\n' + LASER), ("driver", DRIVER)):
        (tmp_path / "robot" / name / "etc").mkdir(parents=True)
        (tmp_path / "robot" / name / f"{name}.cdsl").write_text(text)
        (tmp_path / "robot" / name / "etc" / "config").write_text("")
    return tmp_path / "robot"


def imported(text: str, folder: Path, name: str = "net.xml") -> str:
    """The DDSL for a file in that folder."""
    report = Report()
    path = folder / name
    found = to_ddsl(Source(path, text), folder, report, {"HOME": "/nobody"})
    assert found is not None, report.diagnostics
    return found


def clauses(text: str, name: str) -> list[str]:
    """What is said of an instance, comments included; what stands on several lines, on one."""
    block = text.partition(f"    Component {name}")[2].partition("\n    {\n")[2].partition("\n    };")[0]
    joined = re.sub(r"\n( *//     | {12,})", " ", block)
    return [line.strip() for line in joined.splitlines()]


def test_components_are_found_where_they_are_started(robot: Path) -> None:
    text = imported(
        rcmanager(
            node(
                "eyes", f'<workingDir path="{robot}/laser"/>', up("src/laser.py etc/config"), endpoint="l:tcp -p 10003"
            ),
            node(
                "driver", '<dependence alias="eyes"/>', up(f"rcremote localhost x {robot}/driver python src/driver.py")
            ),
        ),
        robot,
    )
    assert text.partition("\n\n")[2].splitlines() == [
        'import "laser/laser.cdsl";',
        'import "driver/driver.cdsl";',
        "",
        "Deployment net",
        "{",
        "    Component eyes : laserComp",
        "    {",
        "        // line 2: it was started by `src/laser.py etc/config`",
        '        config "laser/etc/config";',
        "        port 10003;",
        "    };",
        "",
        "    Component driver",
        "    {",
        "        // line 3: it was started by `python src/driver.py`",
        "        dependences eyes;",
        "    };",
        "};",
    ]


@pytest.mark.parametrize("width", [*range(65, 76), 200])
def test_an_imported_network_is_laid_out_as_by_the_formatter(robot: Path, width: int) -> None:
    long = f"--one {'x' * (width - len(str(robot)))}"
    text = imported(
        rcmanager(
            node(
                "eyes", f'<workingDir path="{robot}/laser"/>', up("src/laser.py etc/config"), endpoint="l:tcp -p 10003"
            ),
            node("sim", f'<workingDir path="{robot}"/>', '<dependence alias="eyes"/>', up(f"./bin/sim {long}")),
        ),
        robot,
    )
    (robot / "net.ddsl").write_text(text)
    assert rc(["fmt", "--check", str(robot / "net.ddsl")]) == 0


def test_of_two_that_could_be_meant_the_configuration_tells_which(robot: Path) -> None:
    (robot / "driver" / "etc" / "config").write_text("LaserProxy = laser:tcp -h localhost -p 10004 # the left one\n")
    text = imported(
        rcmanager(
            node("a", f'<workingDir path="{robot}/laser"/>', up("src/laser.py"), endpoint="l:tcp -p 10003"),
            node("b", f'<workingDir path="{robot}/laser"/>', up("src/laser.py"), endpoint="l:tcp -p 10004"),
            node("driver", f'<workingDir path="{robot}/driver"/>', up("src/driver.py etc/config")),
        ),
        robot,
    )
    assert "requires Laser from b;" in clauses(text, "driver")


def test_what_is_made_is_a_network_that_can_be_planned(robot: Path) -> None:
    """Where all components are there, and generated, nothing is wrong with it."""
    components = Path(__file__).parents[2] / "components"
    ddsl = robot / "net.ddsl"
    ddsl.write_text(
        imported(
            rcmanager(
                node("world", f'<workingDir path="{components}/world2d"/>', up("python3 src/world.py")),
                node("wander", f'<workingDir path="{components}/wander"/>', up("python3 src/wander.py")),
            ),
            robot,
        )
    )
    workspace = Workspace()
    plan = make_plan(ddsl, workspace)
    assert plan is not None, [each.render() for each in workspace.report.diagnostics]
    assert {(process.name, process.component.lower()) for process in plan.processes} == {
        ("world", "world2d"),
        ("wander", "wander"),
    }


def test_other_programs_are_started_in_their_folder(robot: Path) -> None:
    text = imported(rcmanager(node("sim", f'<workingDir path="{robot}"/>', up("./bin/sim 'a b' etc/config"))), robot)
    assert clauses(text, "sim") == [
        f"// line 2: no .cdsl is in {robot}: write one with what it requires and implements, and import it",
        'path "/usr/bin/env";',
        f'args "--chdir={robot}", "./bin/sim", "a b", "etc/config";',
    ]


def test_a_program_that_is_not_written_in_python_goes_on_to_speak_ice(robot: Path) -> None:
    (robot / "cam" / "etc").mkdir(parents=True)
    (robot / "cam" / "etc" / "config").write_text("Laser.Endpoints=tcp -p 10007\n")
    communications = "Communications { implements Laser; };"
    (robot / "cam" / "cam.cdsl").write_text(f'import "Laser.idsl"; Component cam {{ {communications} language Cpp; }};')
    command = up("bin/cam etc/config")
    text = imported(rcmanager(node("cam", f'<workingDir path="{robot}/cam"/>', command)), robot)
    assert {"middleware ice;", 'config "cam/etc/config";', 'path "/usr/bin/env";'} <= set(clauses(text, "cam"))


def test_the_hosts_of_programs_are_carried_over(robot: Path) -> None:
    text = imported(
        rcmanager(
            node("a", up(f"rcremote 10.0.0.7 x {robot}/laser src/laser.py"), endpoint="l:tcp -h 10.0.0.7 -p 10003"),
            node("b", up("rcremote robot@base.local x /opt/sim ./sim --fast")),
            node("c", f'<workingDir path="{robot}/laser"/>', up("src/laser.py"), endpoint="l:tcp -h 10.0.0.7 -p 10004"),
            node(
                "d", f'<workingDir path="{robot}/laser"/>', up("src/laser.py"), endpoint="l:tcp -h localhost -p 10003"
            ),
        ),
        robot,
    )
    said = " ".join(text.split())
    assert 'host host_10_0_0_7 { address "10.0.0.7"; };' in said
    assert 'host base_local { address "base.local"; user "robot"; };' in said
    assert "// On several hosts, say who may take part: `security lan;`" in text
    assert {"host host_10_0_0_7;", "port 10003;"} <= set(clauses(text, "a"))
    assert {"host base_local;", 'args "--chdir=/opt/sim", "./sim", "--fast";'} <= set(clauses(text, "b"))
    assert {"host host_10_0_0_7;", "port 10004;"} <= set(clauses(text, "c"))
    assert {"ip localhost;", "port 10003;"} <= set(clauses(text, "d"))
    (robot / "net.ddsl").write_text(text)
    assert rc(["fmt", "--check", str(robot / "net.ddsl")]) == 0


def test_paths_of_another_machine_are_found_below_the_folder_the_file_is_in(robot: Path) -> None:
    text = imported(
        rcmanager(node("eyes", up("rcremote localhost t /home/x/src/robot/laser python a.py"))), robot / "laser"
    )
    assert 'import "laser.cdsl";' in text


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (up("cd x &amp;&amp; bin/laser"), "only a shell understands `cd x && bin/laser`"),
        (up("bin/laser 'a"), "only a shell understands"),
        (up("bin/laser &quot;a\\&quot;b&quot;"), "has quotes, which DDSL cannot express"),
        ("", "nothing says how it is started"),
        ('<dependence alias="ghost"/>', "it depends on `ghost`, which does not exist"),
        ('<dependence alias="eyes"/>', "it depends on `eyes`, which depends on it: left out"),
        ("<speed/>", "<speed> is not understood"),
        (up("rcremote -oProxyCommand=x t /x bin/laser"), "-oProxyCommand=x is not the address of a host"),
        (up("rcremote a;b@10.0.0.7 t /x bin/laser"), "a;b@10.0.0.7 is not the address of a host"),
        (up("rcremote a/b@10.0.0.7 t /x bin/laser"), "a/b@10.0.0.7 is not the address of a host"),
    ],
)
def test_what_cannot_be_carried_over_is_said_with_its_line(given: str, said: str, tmp_path: Path) -> None:
    text = imported(rcmanager("", node("eyes", given)), tmp_path)
    assert any(line.startswith("// line 3: ") and said in line for line in clauses(text, "eyes"))


def test_what_only_the_window_showed_is_left_out_without_a_word(tmp_path: Path) -> None:
    window = '<xpos value="1"/><color value="#ff0000"/><downCommand command="killall x"/><configFile path="x"/>'
    text = imported(
        rcmanager("<generalInformation><editor path='x'/></generalInformation>", node("a", window)), tmp_path
    )
    assert "not understood" not in text
    assert "killall" not in text


def test_circles_of_dependences_are_opened_and_said(tmp_path: Path) -> None:
    a, b = node("a", '<dependence alias="b"/>', up("a")), node("b", '<dependence alias="a"/>', up("b"))
    text = imported(rcmanager(a, b), tmp_path)
    assert "dependences b;" in clauses(text, "a")
    assert "// line 3: it depends on `a`, which depends on it: left out" in clauses(text, "b")


def test_the_broker_of_topics_is_not_needed(tmp_path: Path) -> None:
    text = imported(rcmanager(node("IS", up("rcnode")), node("a", '<dependence alias="IS"/>', up("a"))), tmp_path)
    assert "// line 2: `IS` is the broker of IceStorm" in text
    assert "Component IS" not in text
    assert "dependences" not in text


def test_invalid_names_are_changed_and_stay_distinct(tmp_path: Path) -> None:
    nodes = (node("my eye", up("a")), node("my-eye", up("b")), node("2nd", '<dependence alias="my-eye"/>', up("c")))
    text = imported(rcmanager(*nodes), tmp_path)
    assert "// line 2: its name was `my eye`" in clauses(text, "my_eye")
    assert "dependences my_eye_2;" in clauses(text, "_2nd")


def test_names_keep_their_letters_without_accents(tmp_path: Path) -> None:
    text = imported(rcmanager(node("cámara-ñ", up("a"))), tmp_path)
    assert "// line 2: its name was `cámara-ñ`" in clauses(text, "camara_n")


def test_what_is_inside_of_something_that_is_not_understood_is_not_listed(tmp_path: Path) -> None:
    inside = "<foo><bar/></foo>"
    text = imported(rcmanager(node("a", up("a"), inside), inside), tmp_path)
    assert re.findall("<.*> is not understood", text) == ["<foo> is not understood"] * 2


def test_a_port_is_given_to_the_first_that_wants_it(tmp_path: Path) -> None:
    text = imported(rcmanager(node("a", endpoint="a:tcp -p 10001"), node("b", endpoint="b:tcp -p 10001")), tmp_path)
    assert "port 10001;" in clauses(text, "a")
    assert "// line 3: its port, 10001, is also the port of `a`" in clauses(text, "b")


@pytest.mark.parametrize("port", ["0", "65536", "9" * 5000])
def test_an_invalid_port_is_left_out(port: str, tmp_path: Path) -> None:
    text = imported(rcmanager(node("a", endpoint=f"a:tcp -p {port}")), tmp_path)
    assert any("is not from 1 to 65535" in line for line in clauses(text, "a"))
    assert "\n        port " not in text


def test_components_that_are_called_alike_are_said_to_be(robot: Path) -> None:
    (robot / "driver" / "driver.cdsl").write_text('import "Laser.idsl";\n' + LASER)
    folders = [f'<workingDir path="{robot}/{each}"/>' for each in ("laser", "driver")]
    text = imported(rcmanager(*(node(f"a{n}", each, up("src/a.py")) for n, each in enumerate(folders))), robot)
    assert "// line 3: laser/laser.cdsl also describes a `laserComp`: rename one of them" in clauses(text, "a1")


def test_no_comment_can_be_left(tmp_path: Path) -> None:
    """A name with the end of a line in it writes no clause."""
    text = imported(rcmanager(node("a&#10;};port 1;", up("x&#10;y;"))), tmp_path)
    for line in text.splitlines():
        assert line.lstrip().startswith("//") or "port 1" not in line
    workspace = Workspace(read=lambda _: text.encode())
    assert workspace.deployment(tmp_path / "x.ddsl") is not None
    assert not workspace.report.errors


# Files that are none.

WRONG = [
    (
        "net.xml",
        "<rcmanager>\n <node alias='a'>\n</rcmanager>",
        "net.xml:3:3: error[bad-import]: not valid XML: mismatched tag",
    ),
    ("net.xml", "", "net.xml:1:1: error[bad-import]: not valid XML: there is nothing in it"),
    (
        "net.xml",
        "<rcmanager>\n<node alias='a'>",
        "net.xml:2:17: error[bad-import]: not valid XML: it ends inside of <node>",
    ),
    (
        "net.xml",
        "\n<html/>",
        "net.xml:2:1: error[bad-import]: the first element is <html>; that of rcmanager is <rcmanager>",
    ),
    ("net.xml", "<rcmanager><node/></rcmanager>", "net.xml:1:12: error[bad-import]: this <node> has no alias"),
]


@pytest.mark.parametrize(("name", "text", "said"), WRONG)
def test_an_invalid_file_is_refused_with_its_position(
    name: str, text: str, said: str, tmp_path: Path, capsys: Said
) -> None:
    (tmp_path / name).write_text(text)
    assert rcdeploy(["--import", str(tmp_path / name)]) == 1
    assert said in capsys.readouterr().err


def test_entities_are_not_expanded(tmp_path: Path, capsys: Said) -> None:
    bomb = '<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;"><!ENTITY f SYSTEM "/etc/passwd">]>\n'
    (tmp_path / "net.xml").write_text(f"{bomb}<rcmanager><node alias='&b;&f;'/></rcmanager>")
    assert rcdeploy(["--import", str(tmp_path / "net.xml")]) == 1
    assert "net.xml:1:13: error[bad-import]: a document type is declared, which is not read" in capsys.readouterr().err


# The command.


def test_an_imported_network_is_never_written_over_a_file(tmp_path: Path, capsys: Said) -> None:
    (tmp_path / "net.xml").write_text(rcmanager(node("a", up("a"))))
    command = ["--import", str(tmp_path / "net.xml"), "-o", str(tmp_path / "net.ddsl")]
    assert rcdeploy(command) == 0
    (tmp_path / "net.ddsl").write_text("mine")
    assert rcdeploy(command) == 1
    assert "exists and was not changed" in capsys.readouterr().err
    assert (tmp_path / "net.ddsl").read_text() == "mine"


def test_a_file_that_cannot_be_written_completely_is_removed(tmp_path: Path, capsys: Said) -> None:
    (tmp_path / "net.xml").write_text(rcmanager(*(node(f"a{number}", up("a")) for number in range(1000))))
    output = tmp_path / "net.ddsl"
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, before[1]))
    try:
        assert rcdeploy(["--import", str(tmp_path / "net.xml"), "-o", str(output)]) == 1
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, ignored)
    assert "net.ddsl cannot be written: File too large" in capsys.readouterr().err
    assert not output.exists()


def test_without_a_name_it_is_printed(tmp_path: Path, capsys: Said) -> None:
    (tmp_path / "net.xml").write_text(rcmanager(node("a", up("a"))))
    assert rcdeploy(["--import", str(tmp_path / "net.xml")]) == 0
    assert "Deployment net\n{\n    Component a\n" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (
            ["--import", "net.ddsl"],
            1,
            "net.ddsl: no installed package imports this kind of file; known: rcmanager's XML (.xml)",
        ),
        (["--import", "gone.xml"], 1, "cannot be read"),
        (["--import", "a.xml", "-o", "net.txt"], 1, "a network is a .ddsl file"),
        (["--import", "a.xml", "net.ddsl"], 2, "imports and starts nothing"),
        (["net.ddsl", "-o", "x.ddsl"], 2, "-o is for --import"),
    ],
)
def test_wrong_arguments_of_an_import_are_explained(arguments: list[str], code: int, said: str, capsys: Said) -> None:
    try:
        found = rcdeploy(arguments)
    except SystemExit as exc:
        found = int(exc.code or 0)
    assert found == code
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("text", [each for each in NASTY if not re.search(r"[\x00-\x08\x0b\x0c\x0e-\x1f]", each)])
def test_what_is_imported_says_no_more_than_it_is_made_of(tmp_path: Path, text: str) -> None:
    said = quoteattr(f"a{text}z")
    xml = (
        f"<rcmanager><node alias={said} endpoint={said}><dependence alias={said}/><workingDir path={said}/>"
        f"<upCommand command={said}/></node>"
        f'<node alias="b"><upCommand command={quoteattr(f"rcremote {text} x /x run {text}")}/></node></rcmanager>'
    )
    report = Report()
    made = to_ddsl(Source(tmp_path / "net.xml", xml), tmp_path, report, {})
    assert made is not None, report.diagnostics
    wrong = Report()
    model = parse(Source(Path("net.ddsl"), made), wrong)
    assert wrong.errors == [], made
    assert model is not None
    assert len(model.instances) == 2
    assert model.imports == ()
    assert not any(each.existing for each in model.instances)
