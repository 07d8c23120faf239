"""The page of `rc monitor` in Chromium, beside a network whose processes are killed."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from robocomp_py.testing.patience import SOON
from tests.browser import Browser, browsing, started

FILES = {
    "Tick.idsl": """\
module Ticks
{
    interface TickPub { void tick(int number); };
    interface TockPub { void tock(int number); };
    interface Ask { int next(int number); };
};
""",
    "clockwork/clockwork.cdsl": """\
import "../Tick.idsl";
Component clockwork { Communications { publishes TickPub, TockPub; implements Ask; }; language python; };
""",
    "hearer/hearer.cdsl": """\
import "../Tick.idsl";
Component hearer { Communications { subscribesTo TickPub; requires Ask; }; language python; };
""",
    "net.ddsl": """\
import "clockwork/clockwork.cdsl";
import "hearer/hearer.cdsl";
Deployment ticking { Component clockwork : clockwork { }; Component hearer : hearer { }; };
""",
    "clockwork/specificworker.py": """\
from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    def compute(self) -> None:
        self.tickpub_proxy.tick(1)
        self.tockpub_proxy.tock(1)

    def Ask_next(self, number: int) -> int:
        return number + 1
""",
    "hearer/specificworker.py": """\
from .generic.genericworker import GenericWorker


class SpecificWorker(GenericWorker):
    def compute(self) -> None:
        self.ask_proxy.next(1)

    def TickPub_tick(self, number: int) -> None:
        pass
""",
}


def component(folder: Path, name: str) -> Any:
    return started(folder, "rc", "run", name)


def text_of(row: str, column: str) -> str:
    """A script: the text of a cell in the first row of that name; "" if there is none."""
    return (
        f"[...document.querySelectorAll('tbody tr')].filter(row => row.cells[0].textContent === {row!r})"
        f".map(row => [...row.cells].find(cell => cell.dataset.label === {column!r})?.textContent)[0]"
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    with started(tmp_path, "rcgen", "net.ddsl", "--middleware", "zeromq", stdout=subprocess.DEVNULL) as generating:
        assert generating.wait(SOON * 5) == 0
    (tmp_path / "browser").mkdir()
    return tmp_path


@contextmanager
def opened(folder: Path, *words: str) -> Iterator[Browser]:
    """The page of a monitor of the network."""
    command = ("rc", "monitor", "net.ddsl", "--every", "0.3", *words)
    with started(folder, *command, stdout=subprocess.PIPE) as monitor:
        assert monitor.stdout
        with browsing(folder / "browser", monitor.stdout.readline().strip()) as browser:
            yield browser


@pytest.mark.tool
@pytest.mark.timeout(600)
def test_the_page_follows_what_runs(folder: Path) -> None:
    with opened(folder) as browser:
        browser(wait="document.querySelectorAll('#picture rect.missing').length === 2")
        with component(folder, "clockwork") as clockwork, component(folder, "hearer"):
            browser(wait="document.querySelectorAll('#picture rect.missing').length === 0")
            # rates and durations of a topic and of a query
            for row in ("TickPub/tick", "Ask/next"):
                browser(wait=f"parseFloat({text_of(row, 'per s')}) > 0")
                browser(wait=f"parseFloat({text_of(row, 'p99 ms')}) > 0")
            # a topic without a subscriber
            assert browser(wait=text_of("TockPub/tock", "state")) == "no subscriber"
            browser(wait=f"parseFloat({text_of('TockPub/tock', 'per s')}) > 0")
            browser(wait="document.querySelectorAll('#picture circle.end').length === 1")
            texts = "[...document.querySelectorAll('#picture text.figures')].map(each => each.textContent).join()"
            before = browser(wait=texts)
            browser(wait=f"{texts} !== {json.dumps(before)}")
            # a process is killed
            clockwork.kill()
            browser(wait=f"{text_of('clockwork', 'state')} === 'missing'")
            shape = "document.querySelector('#picture rect.missing')"
            assert browser(wait=f"{shape} && {shape}.querySelector('title').textContent") == "clockwork"
            assert browser(wait=f"getComputedStyle({shape}).stroke") == "rgb(224, 0, 43)"
        assert browser(complaints=True) == []
        own = browser(wait="location.origin + '/'")
        asked = browser(requests=True)
    assert asked
    assert all(each.startswith((own, "data:")) for each in asked)


@pytest.mark.tool
@pytest.mark.timeout(600)
def test_the_page_is_of_use_on_a_narrow_screen_and_by_keyboard(folder: Path) -> None:
    with opened(folder) as browser:
        browser(width=320)
        browser(wait="document.querySelectorAll('#connections tbody tr').length === 2")
        assert browser(wait="[document.documentElement.scrollWidth]") == [320]
        reached = []
        for _ in range(8):
            browser(press="Tab")
            reached += [browser(wait="document.activeElement.id || document.activeElement.textContent")]
        assert reached[:4] == ["zoom", "filter", "wrong", "picture"]
        assert reached[4:] == ["clockwork", "hearer", *reached[6:]]
        assert set(reached[6:]) == {"TickPub/tick", "Ask/next"}
        browser(press="Enter")  # shows the connection in the picture
        browser(wait="document.querySelectorAll('#picture path.chosen').length === 1")
        assert browser(wait="[getComputedStyle(document.activeElement).outlineStyle]") == ["solid"]


@pytest.mark.tool
@pytest.mark.timeout(600)
def test_a_process_is_stopped_and_started_from_the_page(folder: Path) -> None:
    with (
        started(folder, "rcdeploy", "up", "net.ddsl", "--middleware", "zeromq"),
        opened(folder, "--allow-control") as browser,
    ):

        def process() -> str:
            return text_of("clockwork", "process")

        browser(wait=f"{text_of('clockwork', 'state')} === 'compute'")
        first = browser(wait=process())
        browser(click="button[aria-label='restart clockwork']")
        browser(wait=f"{process()} && {process()} !== {first!r}")
        browser(click="button[aria-label='stop clockwork']")
        browser(wait=f"{text_of('clockwork', 'state')} === 'missing'")
        browser(click="button[aria-label='start clockwork']")
        browser(wait=f"{text_of('clockwork', 'state')} === 'compute'")
        assert browser(dialogs=True) == ["restart clockwork?", "stop clockwork?", "start clockwork?"]
        assert browser(complaints=True) == []
