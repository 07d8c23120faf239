"""Virtual time: the components of a network in one process, one event at a time, in an order that repeats.

executor     which event is next; moves the clock on
transport    messages and calls between the components, in the order in which they were sent
monitor      the lock of a worker, for threads that take turns
stalls       finds code that waits for the machine meanwhile
record       what was said: its hash, and its lines for `diff`
"""
