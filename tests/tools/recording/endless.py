"""Records numbers until it is killed: `python -m tests.tools.recording.endless FOLDER KEEP`; KEEP 0 is one file."""

from __future__ import annotations

import sys
import time
from itertools import count
from pathlib import Path

from robocomp_py.tools.recording.bag import Options
from robocomp_py.tools.recording.writer import Recorder
from tests.tools.recording.recordings import news, told

SPLIT = 1_500_000


def main(folder: Path, keep: int) -> None:
    options = Options(split_octets=SPLIT, keep=keep) if keep else Options()
    with Recorder(folder, options) as recorder:
        track = recorder.track(told)
        for number in count():
            track.put(news(number, f"{number:06}" * 3000), number + 1, number + 1)
            while recorder.waiting > 1_000_000:
                time.sleep(0.001)


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
