"""Add a method to an interface: what was said last can be asked, by all who have a voice to talk to."""

from __future__ import annotations

from robocomp_py.testing.components import ComponentTest, load_component

from ..project import Project, message

TITLE = "add a method to an interface"


def with_dsl(project: Project) -> None:
    project.replace(
        "Speech.idsl",
        "        [query] void say(datasayin pin, out dataresponse pout);\n",
        "        [query] void say(datasayin pin, out dataresponse pout);\n"
        "        // What was said so many texts ago; nothing if there were not so many.\n"
        "        [query] string said(int ago);\n",
    )
    project.generate("talker", "greeter")
    _both(project)


def by_hand(project: Project) -> None:
    for component in ("talker", "greeter"):
        module = f"{component}/generic/RoboCompSpeech.py"
        project.replace(module, "    BOOL,\n", "    BOOL,\n    INT32,\n")
        project.replace(
            module,
            "SPEECH_INTERFACE = Interface(\n",
            """\
_Speech_said: Operation[str] = Operation(
    "RoboCompSpeech::Speech",
    "said",
    inputs=(Field("ago", INT32),),
    outputs=(Field("ret", STRING),),
    pattern=Pattern.QUERY,
)
SPEECH_INTERFACE = Interface(
""",
        )
        project.replace(module, "    (_Speech_say,),\n", "    (_Speech_say, _Speech_said),\n")
    project.replace(
        "talker/generic/genericworker.py",
        "        IDSL: [query] void say(datasayin pin, out dataresponse pout)\n" + '        """\n',
        """\
        IDSL: [query] void say(datasayin pin, out dataresponse pout)
        \"\"\"

    @abstractmethod
    def Speech_said(self, ago: int) -> str:
        \"\"\"What was said so many texts ago; nothing if there were not so many.\"\"\"
""",
    )
    project.replace(
        "greeter/generic/RoboCompSpeech.py",
        "        return self._ask(_Speech_say, (pin,), deadline)\n",
        """\
        return self._ask(_Speech_say, (pin,), deadline)

    def said(self, ago: int, *, deadline: float | None = None) -> str:
        \"\"\"What was said so many texts ago; nothing if there were not so many.\"\"\"
        return self._ask(_Speech_said, (ago,), deadline)
""",
    )
    _both(project)


def _both(project: Project) -> None:
    """The specific parts: what the method does, and a use of it."""
    project.replace(
        "talker/specificworker.py",
        "        return dataresponse(ok=True, text=pin.text)\n",
        """\
        return dataresponse(ok=True, text=pin.text)

    def Speech_said(self, ago: int) -> str:
        return self.texts[-1 - ago] if 0 <= ago < len(self.texts) else ""
""",
    )
    project.replace(
        "greeter/specificworker.py",
        "        self.speech_proxy.say(datasayin(text=self.greeting))\n",
        """\
        if self.speech_proxy.said(0) != self.greeting:
            self.speech_proxy.say(datasayin(text=self.greeting))
""",
    )


def behaves(project: Project) -> None:
    """The talker remembers, and the greeter does not say again what was said last."""
    worker = load_component(project.root / "talker")
    with ComponentTest(worker) as talker:
        for text in ("one", "two"):
            talker.call("Speech.say", message(worker, "datasayin")(text=text))
        assert [talker.call("Speech.said", ago) for ago in (0, 1, 2)] == ["two", "one", ""]
    assert talker.fine
    said = ["", "Good morning"]
    with ComponentTest(
        load_component(project.root / "greeter"), speech={"said": lambda _: said.pop(0) if said else "Good morning"}
    ) as greeter:
        greeter.wait_for_computes(4)
        assert len(greeter.received("speech.say")) == 1
    assert greeter.fine
