"""Messages that were not delivered."""

from __future__ import annotations

from collections.abc import Iterator

from .facts import Facts, Finding, Weight

NAME = "losses"
HELP = "messages that were lost, dropped, too late, or not understood"

_ADVICE = {
    "lost": "the receiver or the network is too slow; send less, or ask for `reliable`",
    "dropped": "it takes them too slowly; make its handlers faster, or its `depth` greater",
    "expired": "they came too late; compare clocks and load: rc doctor, rc hz",
    "malformed": "another program writes to this channel; to see which: rc info {channel}",
    "mismatched": "another contract is sent there; generate both sides anew: rc info {channel}",
}


def find(facts: Facts) -> Iterator[Finding]:
    for each in facts.components:
        for one in each.measures.operations if each.measures else ():
            for kind, advice in _ADVICE.items():
                number = getattr(one, kind)
                if number > 0:
                    sent = one.received + one.lost + one.dropped + one.expired + one.malformed
                    text = (
                        f"{number} of {max(sent, number)} messages of {one.channel} over {one.middleware} {_is(kind)}"
                    )
                    yield Finding(Weight.WARN, f"{each.name}: {text}", advice.format(channel=one.channel))


def _is(kind: str) -> str:
    return {"lost": "were lost", "dropped": "were dropped", "expired": "were too late"}.get(kind, f"were {kind}")
