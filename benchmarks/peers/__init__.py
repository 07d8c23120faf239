"""Other frameworks, each doing the same work in the fastest way that its own documentation proposes.

A module here is a program of two processes: `python -m benchmarks.peers.NAME far FOLDER …` answers an
array with the same array, `near` asks, measures, and tells what it found (`driver`). They meet in a
folder of their own or on the loopback interface, and end with who started them.
"""
