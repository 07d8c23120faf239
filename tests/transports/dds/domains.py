"""Domains of DDS for the tests of one process: those that another one runs on this host do not meet them."""

from __future__ import annotations

import os

_WHICH = "ROBOCOMP_TEST_DOMAIN"
"""Environment: also the processes that a test starts are to find them."""

DOMAIN = int(os.environ.setdefault(_WHICH, str(10 + 2 * (os.getpid() % 25))))
"""From 10 to 58: others are what some test is about."""

ANOTHER_DOMAIN = DOMAIN + 1
