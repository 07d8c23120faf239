"""The fault matrix: what holds of calls, commands and topics while processes, networks and clocks fail.

    history      what happened, appended to files that survive their writers
    checker      pure: which promises a history breaks
    nemesis      pure: a seeded plan of faults: what, to which process, and when
    actors       the processes to which it is done
    laboratory   starts them, on this host or on several that are network namespaces, and does it to them
    rows         one fault each: what is done, what is measured, what must hold
    report       the table, and docs/explanation/fault-matrix.md

`python -m tests.faults --help`, or `make faults`.
"""
