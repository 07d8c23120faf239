"""Transport `dds`: Cyclone DDS; other vendors' tools see our topics, types and fields.

    rc/<channel>            publications, 1:n
    rc/<channel>Credit      how far the readers of a reliable topic are, to its publisher
    rc/<channel>Request     commands and requests, n:1
    rc/<channel>Reply       replies; every client has a partition of its own, and the server a writer in it

Who is there is told by the endpoints themselves: each carries its role and contract as USER_DATA
(`endpoints.Endpoints`). DDS itself acknowledges a sample when it has arrived, not when it was read,
and a reader without room would stop all others of its process; so a reliable topic counts: its
publisher sends no more than its readers have said they take (`Credit`).

Nothing is refused by a reader: what comes in is taken at once and waits here, so many of a link and
no more. Whom that concerns is told (`BUSY`), or finds it counted.

Threads. The leader of a `LeaderFollowers` waits for all readers and runs sinks and services itself. A
synchronous call waits for its reply on its own thread.
"""
