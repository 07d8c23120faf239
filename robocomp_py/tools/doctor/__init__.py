"""`rc doctor`: collects facts of a machine and of what runs on it, and finds what is wrong with them.

`facts.py` has the facts, `collect.py` reads them, `checks.py` lists the checks. A check is a module with a NAME, a HELP
and a pure function `find`, which takes the facts.
"""
