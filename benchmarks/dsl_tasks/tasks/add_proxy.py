"""Add a proxy: what the talker is told to say it passes on to another voice."""

from __future__ import annotations

from robocomp_py.testing.components import ComponentTest, load_component

from ..project import Project, message

TITLE = "add a proxy"


def with_dsl(project: Project) -> None:
    project.replace("talker/talker.cdsl", "implements Speech;\n", "implements Speech;\n        requires Speech;\n")
    project.generate("talker")
    _both(project)


def by_hand(project: Project) -> None:
    module, worker = "talker/generic/RoboCompSpeech.py", "talker/generic/genericworker.py"
    project.replace(module, "    Pattern,\n", "    Pattern,\n    Proxy,\n")
    text = (project.root / module).read_text()
    last = text.splitlines(keepends=True)[-3:]
    project.replace(
        module,
        "".join(last),
        "".join(last)
        + """\


class SpeechProxy(Proxy):
    interface = SPEECH_INTERFACE

    def say(self, pin: datasayin, *, deadline: float | None = None) -> dataresponse:
        \"\"\"Begin to say something.\"\"\"
        return self._ask(_Speech_say, (pin,), deadline)
""",
    )
    project.replace(
        worker,
        "        ports=(Port(Verb.IMPLEMENTS, RoboCompSpeech.SPEECH_INTERFACE),),\n",
        """\
        ports=(
            Port(Verb.IMPLEMENTS, RoboCompSpeech.SPEECH_INTERFACE),
            Port(
                Verb.REQUIRES,
                RoboCompSpeech.SPEECH_INTERFACE,
                proxy=RoboCompSpeech.SpeechProxy,
            ),
        ),
""",
    )
    project.replace(
        worker,
        '    middleware = "auto"\n',
        '    middleware = "auto"\n\n    speech_proxy: RoboCompSpeech.SpeechProxy\n',
    )
    _both(project)


def _both(project: Project) -> None:
    project.replace(
        "talker/specificworker.py",
        "        return dataresponse(ok=True, text=pin.text)\n",
        "        return self.speech_proxy.say(pin)\n",
    )


def behaves(project: Project) -> None:
    """The other voice is told, and what it answers is the answer."""
    worker = load_component(project.root / "talker")
    answer = message(worker, "dataresponse")(ok=True, text="the other one")
    with ComponentTest(worker, speech={"say": answer}) as talker:
        told = message(worker, "datasayin")(text="Good evening")
        assert talker.call("Speech.say", told) == answer
        assert talker.received("speech.say") == [(told,)]
    assert talker.fine
