"""`python -m benchmarks [--only NAME]`: how fast it is, beside the raw libraries, measured here and now."""

from __future__ import annotations

import argparse
import os
import tempfile

from . import roundtrip


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--only", action="append", metavar="MIDDLEWARE", help="measure this one; may be repeated")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="rc-") as folder:
        os.environ["ROBOCOMP_RUNTIME_DIR"] = folder
        print("query round trip")
        roundtrip.run(options.only or ["inproc", "zeromq", "zenoh"])


if __name__ == "__main__":
    main()
