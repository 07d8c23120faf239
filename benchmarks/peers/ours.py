"""Ours: a generated-style proxy, and a handler in another process."""

from __future__ import annotations

import os

from ..ours import Far, Near
from ..parties import Place
from .driver import drive, main, until_told


def far(folder: str, middleware: str, domain: str) -> None:
    end = Far(middleware, _place(folder, domain), lambda data: None)
    try:
        until_told()
    finally:
        end.close()


def near(folder: str, middleware: str, domain: str) -> None:
    end = Near(middleware, _place(folder, domain))
    try:
        drive(end.ask, folder)
    finally:
        end.close()


def _place(folder: str, domain: str) -> Place:
    os.environ["ROBOCOMP_RUNTIME_DIR"] = folder
    return Place(folder, int(domain), 10)


if __name__ == "__main__":
    main(far=far, near=near)
