"""Files that announce in their comments which diagnostics they must raise, and no others.

error[syntax]       on the line itself
warning[gui]@7      on line 7, where the line itself cannot hold a comment
"""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

from robocomp_py.dsl.diagnostics import Diagnostic

Complaint = tuple[int, str, str]
"""Line, severity, code."""

_ANNOUNCEMENT = re.compile(r"\b(error|warning)\[([a-z0-9-]+)\](?:@(\d+))?")


def announced(path: Path) -> Counter[Complaint]:
    """What a file announces."""
    found: Counter[Complaint] = Counter()
    for number, line in enumerate(path.read_text(encoding="latin-1").splitlines(), 1):
        for severity, code, elsewhere in _ANNOUNCEMENT.findall(line):
            found[int(elsewhere or number), severity, code] += 1
    return found


def complaint(diagnostic: Diagnostic) -> Complaint:
    line, _ = diagnostic.span.source.position(diagnostic.span.start)
    return line, str(diagnostic.severity), diagnostic.code
