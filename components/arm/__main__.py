"""Run this component with `python -m NAME`, or with `rc run PATH`."""

from robocomp_py.runtime.run import main

from .specificworker import SpecificWorker

if __name__ == "__main__":
    raise SystemExit(main(SpecificWorker))
