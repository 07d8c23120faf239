"""What arguments mean to a shell that completes them.

The script that `rc completion` prints starts the program itself, with the words up to the cursor as its arguments and
the name of the shell in the variable `ROBOCOMP_COMPLETE`. The program then prints what may stand in the place of the
last word, one candidate a line, behind a tab what it is; and does nothing else.

An argument says by `completed` what its values are. Otherwise its choices, its type and its metavar tell: `FOLDER` is a
folder, `NET.ddsl` a file with this ending, and whatever is a `Path` is a file.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping, Sequence
from enum import StrEnum

ASKED = "ROBOCOMP_COMPLETE"
"""The variable that has the name of the shell."""


class What(StrEnum):
    """The names that a value is one of."""

    CHANNEL = "channel"
    """A topic, query or command of what runs."""
    TOPIC = "topic"
    """A topic that something publishes, or subscribes to."""
    CALLABLE = "callable"
    """A query or a command."""
    ACTION = "action"
    COMPONENT = "component"
    """A component that runs."""
    INSTANCE = "instance"
    """An instance of the network that a word before names, whether it runs or not."""
    DECLARED = "declared"
    """An instance in the file of a network that a word before names."""
    FIELD = "field"
    """A field that the operation or topic before takes, and its value: `NAME=VALUE`."""
    PARAMETER = "parameter"
    """A parameter of the component that a word before names."""
    SETTING = "setting"
    """Such a parameter that can be changed now, and its new value: `NAME=VALUE`."""
    RECORDED = "recorded"
    """A topic of the recording that a word before names."""
    CODE = "code"
    """One of a diagnostic."""
    MIDDLEWARE = "middleware"
    NETWORK = "network"
    """A network that `rcdeploy` runs, or a file *.ddsl."""
    HOST = "host"
    """This machine, or another host of a network that runs."""
    CHECK = "check"
    """One of `rc doctor`."""
    FOLDER = "folder"


Values = What | str | Mapping[str, str]
"""Names of a kind, the ending of files (`.mcap`), or words and what they mean."""


def completed(action: argparse.Action, *by: Values) -> argparse.Action:
    """Declare what the values of an argument are."""
    vars(action)["completed"] = by
    return action


def is_asked(arguments: Sequence[str] | None) -> bool:
    """Whether a shell asks this process to complete its own command line."""
    return arguments is None and ASKED in os.environ
