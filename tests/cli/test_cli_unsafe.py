"""What is private to argparse is as it was, and nothing fails if it is not."""

from __future__ import annotations

import argparse

from robocomp_py.cli.unsafe import help_of_commands


def test_argparse_keeps_the_help_of_commands_where_it_is_looked_for() -> None:
    commands = argparse.ArgumentParser().add_subparsers()
    commands.add_parser("open", help="open it")
    commands.add_parser("close")
    assert help_of_commands(commands) == {"open": "open it"}


def test_without_it_there_is_no_help() -> None:
    assert help_of_commands(argparse.ArgumentParser().add_argument("name")) == {}
