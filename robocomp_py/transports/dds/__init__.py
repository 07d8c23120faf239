"""Transport `dds`: Cyclone DDS; other vendors' tools see our topics, types and fields.

    rc/<channel>            publications, 1:n
    rc/<channel>Credit      from the readers of a reliable topic to its publisher: how much each can take
    rc/<channel>Request     commands and requests, n:1
    rc/<channel>Reply       replies; every client has its own partition, in which the server has a writer

Discovery is that of DDS: each endpoint carries its role and contract as USER_DATA
(`endpoints.Endpoints`).

Flow control. DDS acknowledges a sample when it arrives, not when it was read, and a full reader would
block all other readers of its process. So the readers of a reliable topic grant credit, and its
publisher sends no more than that (`Credit`). Samples are taken from DDS at once and wait in bounded
queues of ours. If a queue is full, a request is answered with BUSY; other messages are dropped and counted.

Threads. The leader of a `LeaderFollowers` waits for all readers and runs sinks and services itself. A
synchronous call waits for its reply on its own thread.
"""
