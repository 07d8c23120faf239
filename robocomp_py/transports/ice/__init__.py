"""Transport `ice`: queries and commands to and from programs that speak ZeroC Ice 3.7, topics through IceStorm.

    an interface that is served   an object in an adapter of its own: its identity is the port's name in lower case
    a request, a command          an invocation, two-way or one-way; the payload is its encapsulation, untouched
    a publication                 an invocation of a topic of IceStorm's

`messages` and docs/reference/protocol-ice.md describe the context of our requests and their outcomes besides a
result. No Slice is loaded.

Discovery. On one host, components find each other in the directory of the run-time folder, whose entries hold
proxies. Other objects are configured: where to find them (`proxies`), and where ours listen (`endpoints`).

Threads. One thread of Ice reads requests, another one reads replies. Both queue their input, in order, for a
`LeaderFollowers`. They must neither wait nor log: `logging` would register them with `threading`. A blocking call
waits inside Ice, on a connection of its own from a pool (`client.Connection`). So it gets its reply directly, and
closing that connection ends the wait.
"""
