"""Transport `zeromq`: a few sockets for all published topics, and one for all served operations.

    a publication          XPUB → SUB
    a request, a command   DEALER → ROUTER
    a reply                ROUTER → DEALER

The frames are described in `frames` and in docs/reference/protocol-zeromq.md. The directory of the run-time folder
tells which process serves which operation, and where, beside the sockets' `ipc://` files. A late subscriber of a
latched topic also subscribes to a name of its own, and gets under it what it missed.

Threads. A thread that makes a blocking call takes a connection from a pool, and speaks ZMTP on it (`zmtp.Stream`).
Served channels have receiving threads of their own, which wait inside that socket (`server.Router`). For everything
else one thread (the leader of a `LeaderFollowers`) waits on many descriptors: those of subscriptions (`zmtp.Feed`), and
those of shared ZeroMQ sockets. Threads use such a socket only under a lock, and no thread waits while it holds that
lock (`sockets.Socket`).
"""
