"""What is private to argparse, in one place. Written for Python 3.11 to 3.14."""

from __future__ import annotations

import argparse


def help_of_commands(action: argparse.Action) -> dict[str, str]:
    """The help of each command of a parser with subcommands, by name.

    argparse prints it and does not return it. If it keeps it elsewhere one day, this is empty: completion then shows
    names without help.
    """
    return {each.dest: each.help or "" for each in getattr(action, "_choices_actions", ())}
