"""Transport `zeromq`: a socket for every topic that is published, one for all operations that are served.

    a publication          XPUB → SUB
    a request, a command   DEALER → ROUTER
    a reply                ROUTER → DEALER

The frames are described in `frames` and in docs/reference/protocol-zeromq.md. Who serves what, and where, stands in the
directory of the run-time folder, beside the sockets' `ipc://` files. A late subscriber of a latched topic also
subscribes to a name of its own, and gets under it what it missed.

Threads. Who asks and waits has a connection to itself, taken out of a pool, and speaks ZMTP on it (`zmtp.Stream`).
Served channels have receiving threads of their own, which wait inside that socket (`server.Router`). For all else one thread (the
leader of a `LeaderFollowers`) sleeps on many descriptors: of subscriptions (`zmtp.Feed`), and of those ZeroMQ sockets
that several threads use, which they may only under a lock, and nobody must sleep holding it (`sockets.Socket`).
"""
