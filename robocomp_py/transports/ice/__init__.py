"""Transport `ice`: queries and commands to and from programs that speak ZeroC Ice 3.7, topics through IceStorm.

    an interface that is served   an object in an adapter of its own: its identity is the port's name in lower case
    a request, a command          an invocation, two-way or one-way; the payload is its encapsulation, untouched
    a publication                 an invocation of a topic of IceStorm's

Which context our requests carry, and how they may end beside a result, is in `messages`, and on the page
docs/reference/protocol-ice.md. No Slice is loaded.
Those of this host find each other in the directory of the run-time folder,
whose entries hold proxies; others are told which objects are where (`proxies`), and where ours are to be (`endpoints`).

Threads. One of Ice's reads requests, and one reads answers. Both leave what they got to a `LeaderFollowers`, in
order: they must neither wait nor log, since `logging` would have `threading` take them for ours. Who asks and waits
does so inside Ice, on a connection to itself, taken out of a pool (`client.Stream`): nothing lies between the answer
and who waits for it, and closing that connection calls back who waits.
"""
