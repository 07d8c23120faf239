"""`rc rename`: a name changed in models and in the code that uses it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from robocomp_py.cli.rc import main as rc
from robocomp_py.cli.rcdeploy import main as rcdeploy
from robocomp_py.cli.rcgen import main as rcgen

from ..codegen.generated import snapshot

FILES = {
    "Vault.idsl": "module RoboCompVault { interface Vault { int size(); void store(string item); }; };\n",
    "vault/vault.cdsl": 'import "../Vault.idsl";\nComponent vault { Communications { implements Vault; }; '
    'language python; statemachine "vault.smdsl"; params "vault.pdsl"; };\n',
    "vault/vault.smdsl": "vault { states open; initial_state shut; transitions { shut => open; open => shut; }; };\n",
    "vault/vault.pdsl": 'ComponentParams vault { limit "most" int 5; };\n',
    "user/user.cdsl": 'import "../Vault.idsl";\n'
    "Component user { Communications { requires Vault, Vault; }; language python; };\n",
    "net.ddsl": 'import "vault/vault.cdsl"; import "user/user.cdsl";\n'
    "Deployment net { Component vault {}; Component user { requires Vault from vault; }; };\n",
}
VAULT = """\
from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    def Vault_size(self) -> int:
        return min(self.params.limit, 1)   # layout stays

    def Vault_store(self, item: str) -> None:
        print(self.Vault_size(), "size")

    def sm_shut(self) -> None:
        self.t_shut_to_open()

    def sm_open(self) -> None:
        self.t_open_to_shut.emit()
"""
USER = """\
from .generic import RoboCompVault
from .generic.genericworker import GenericWorker


def fill(vault: RoboCompVault.VaultProxy, array) -> int:
    return vault.size() + array.size


class SpecificWorker(GenericWorker):
    def initialize(self) -> None:
        self.other, self.size = None, 1
        self.second = self.vault1_proxy

    def compute(self) -> None:
        self.size += self.vault_proxy.size(deadline=1) + self.second.size()
        near = self.vault_proxy
        near.sizeAsync()
        unknown().size()
"""
USED = """\
def test_it(worker):
    with ComponentTest(worker, vault={"size": lambda: 3, "store": None}, vault1={'size': lambda: 4}) as component:
        assert component.received("vault.size") == []


fakes: VaultFakes = {"size": lambda: 3}
others = VaultFakes(size=lambda: 3)
"""


@pytest.fixture
def robot(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Path:
    """A network with code that uses everything that can be renamed."""
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    assert rcgen(["net.ddsl"]) == 0
    for name, text in (
        ("vault/specificworker.py", VAULT),
        ("user/specificworker.py", USER),
        ("user/tests/used.py", USED),
    ):
        (tmp_path / name).write_text(text)
    capsys.readouterr()
    return tmp_path


def is_whole(folder: Path) -> bool:
    """Whether the network is generated and checked without anything left to do."""
    return rcgen(["net.ddsl"]) == 0 and rcdeploy(["plan", "net.ddsl"]) == 0 and rc(["lint", str(folder)]) == 0


def test_an_operation_is_renamed_in_models_handlers_proxies_and_tests(
    robot: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert rc(["rename", "--yes", "Vault.idsl", "Vault.size", "count"]) == 0
    said = capsys.readouterr().out
    assert "\n-    def Vault_size(self) -> int:\n+    def Vault_count(self) -> int:\n" in said
    assert "not changed: user/specificworker.py:18: unknown().size()\n" in said
    assert "4 files changed\nrun: rcgen user/user.cdsl vault/vault.cdsl\n" in said
    assert (robot / "Vault.idsl").read_text() == FILES["Vault.idsl"].replace("size", "count")
    assert (robot / "vault/specificworker.py").read_text() == VAULT.replace("Vault_size", "Vault_count")
    user = USER.replace("vault.size()", "vault.count()").replace("proxy.size(", "proxy.count(")
    user = user.replace("second.size()", "second.count()").replace("sizeAsync", "countAsync")
    assert (robot / "user/specificworker.py").read_text() == user
    assert (robot / "user/tests/used.py").read_text() == USED.replace("size", "count")
    assert is_whole(robot)


def test_a_state_and_a_parameter_are_renamed(robot: Path) -> None:
    assert rc(["rename", "--yes", "vault/vault.smdsl", "shut", "closed"]) == 0
    assert rc(["rename", "--yes", "vault/vault.pdsl", "limit", "most"]) == 0
    renamed = VAULT.replace("shut", "closed").replace("params.limit", "params.most")
    assert (robot / "vault/specificworker.py").read_text() == renamed
    (robot / "vault/etc/config.toml").unlink()  # which has the old name, as it is told
    assert is_whole(robot)


def test_a_timer_is_renamed(robot: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model, code = robot / "user/user.cdsl", robot / "user/specificworker.py"
    model.write_text(FILES["user/user.cdsl"].replace("language python;", "language python; timer poll 1 s;"))
    timed = USER + "\n    def timer_poll(self) -> None:\n        self.timers.poll.period = 0.5\n"
    code.write_text(timed)
    (robot / "user/etc/config.toml").write_text("[timers]\npoll = 2.0\n")
    assert rcgen(["net.ddsl"]) == 0
    assert rc(["rename", "--yes", "user/user.cdsl", "poll", "look"]) == 0
    assert "user/etc/config.toml" in capsys.readouterr().out
    assert "timer look 1 s;" in model.read_text()
    assert code.read_text() == timed.replace("poll", "look")
    (robot / "user/etc/config.toml").unlink()
    assert is_whole(robot)


def test_an_interface_is_renamed(robot: Path) -> None:
    assert rc(["rename", "--yes", "Vault.idsl", "Vault", "Safe"]) == 0
    user = (robot / "user/specificworker.py").read_text()
    assert "def fill(vault: RoboCompVault.SafeProxy, array)" in user
    assert "self.safe_proxy.size(deadline=1)" in user
    assert "def Safe_size(self)" in (robot / "vault/specificworker.py").read_text()
    assert 'safe={"size": lambda: 3' in (robot / "user/tests/used.py").read_text()
    assert is_whole(robot)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (
            ["Vault.idsl", "Vault.size", "count"],
            "nothing was changed: cannot ask, since stdin is not a terminal; use --yes",
        ),
        (["--yes", "Vault.idsl", "Vault.size", "class"], "`class` is a keyword of Python; nothing was changed"),
        (["--yes", "Vault.idsl", "Vault.sise", "x"], "unknown name `Vault.sise`; did you mean `Vault.size`?"),
        (["--yes", "Vault.idsl", "Vault.size", "store"], "`size` cannot be called `store`"),
        (["--yes", "Vault.idsl", "Vault.size", "taken"], "vault/specificworker.py has the name `Vault_taken` already"),
    ],
)
def test_what_cannot_be_renamed_changes_nothing(
    robot: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], says: str
) -> None:
    path = robot / "vault" / "specificworker.py"
    path.write_text(f"{VAULT}\n    def Vault_taken(self): ...\n")
    before = snapshot(robot)
    assert rc(["rename", *arguments]) == 1
    assert says in capsys.readouterr().err
    assert snapshot(robot) == before


RING = """\
class SpecificWorker(GenericWorker):
    def initialize(self) -> None:
        self.vault.add("front", Small())
        self.vault.add(handler=Small(), name="front")
        for name in ("front", "back"):
            self.report.add(name)

    def compute(self) -> None:
        if "front" in self.vault and self.vault["front"].instance == "front":
            self.report['front'].told(1)
        self.vault.remove('front')
        front = {"front": 1}["front"]
"""


def test_a_named_instance_is_renamed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    texts = {
        "Vault.idsl": FILES["Vault.idsl"],
        "Report.idsl": "module RoboCompVault { interface Report { [publish] void told(int number); }; };\n",
        "ring/ring.cdsl": 'import "../Vault.idsl"; import "../Report.idsl";\nComponent ring { Communications '
        "{ implements Vault each; publishes Report each; }; language python; };\n",
        "user/user.cdsl": FILES["user/user.cdsl"].replace("Vault, Vault", "Vault"),
        "net.ddsl": 'import "ring/ring.cdsl"; import "user/user.cdsl";\nDeployment net\n{\n'
        "    Component ring { offers front : Vault, Report; offers back : Report; };\n"
        "    Component user { requires Vault from ring/front; };\n"
        "    Component other : user { requires Vault from front; };\n};\n",
        "second.ddsl": 'import "ring/ring.cdsl";\nDeployment second { Component ring { offers front : Vault; }; };\n',
    }
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    assert rcgen(["net.ddsl"]) == 0
    (tmp_path / "ring/specificworker.py").write_text(RING)
    with (tmp_path / "ring/etc/config.toml").open("a") as config:
        config.write('\n[offers.front.Vault]\nmiddleware = "shm"\n')
    capsys.readouterr()
    assert rc(["rename", "--yes", "net.ddsl", "front", "nose"]) == 0
    told = capsys.readouterr().out
    network = (tmp_path / "net.ddsl").read_text()
    assert "offers nose : Vault, Report;" in network
    assert "from ring/nose;" in network
    assert "from nose;" in network
    assert (tmp_path / "ring/specificworker.py").read_text() == (
        RING.replace('add("front"', 'add("nose"')
        .replace('name="front"', 'name="nose"')
        .replace('"front" in', '"nose" in')
        .replace('vault["front"]', 'vault["nose"]')
        .replace("'front'", "'nose'")
    )
    left = [line.removeprefix("not changed: ") for line in told.splitlines() if line.startswith("not changed")]
    assert [line.partition(": ")[0] for line in left] == [
        *(f"ring/specificworker.py:{number}" for number in (5, 9, 12)),
        left[3].partition(": ")[0],
        "second.ddsl:2",
    ]
    assert left[3].startswith("ring/etc/config.toml:")


def test_an_action_is_renamed_with_its_policy_its_handler_and_its_classes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "Guide.idsl").write_text(
        "module RoboCompGuide { interface Guide { [action] void goTo(int x) feedback(int left); }; };\n"
    )
    ports = "implements Guide(goTo queue); requires Guide;"
    model = f'import "Guide.idsl"; Component robot {{ Communications {{ {ports} }}; language python; }};\n'
    (tmp_path / "robot.cdsl").write_text(model)
    assert rcgen(["robot.cdsl"]) == 0
    code = (tmp_path / "specificworker.py").read_text() + "\n    def ask(self):\n        self.guide_proxy.goTo(7)\n"
    (tmp_path / "specificworker.py").write_text(code)
    assert rc(["rename", "--yes", "Guide.idsl", "Guide.goTo", "drive"]) == 0
    assert "Guide(drive queue)" in (tmp_path / "robot.cdsl").read_text()
    renamed = (tmp_path / "specificworker.py").read_text()
    assert "def Guide_drive(" in renamed
    assert "RoboCompGuide.GuideDriveGoal" in renamed
    assert "self.guide_proxy.drive(7)" in renamed
