"""Runs this component: `python -m` with its name, or `rc run` with its path."""

from robocomp_py.runtime.run import main

from .specificworker import SpecificWorker

if __name__ == "__main__":
    raise SystemExit(main(SpecificWorker))
