"""Transport `zeromq`: a socket for every topic that is published, one for all operations that are served.

    a publication          XPUB → SUB
    a request, a command   DEALER → ROUTER
    a reply                ROUTER → DEALER

How these look is in `frames`. Who serves what, and where, stands in the directory of the run-time
folder, beside the sockets' `ipc://` files. A late subscriber of a latched topic also subscribes to a
name of its own, and gets under it what it missed.

Threads. A ZeroMQ socket may be used by several threads only under a lock, and nobody must sleep
holding it. So one thread (the leader of a `Crew`) sleeps on the file descriptors of all sockets,
and everybody reads and writes under the socket's lock without waiting (`sockets.Socket`). There are two
exceptions, which are quicker. A synchronous call: its thread takes a socket out of a pool, has it to
itself, and receives the answer itself. And what is served: a crew of its own waits inside that socket
(`serving.Router`).
"""

from .transport import ZeroMQTransport

__all__ = ["ZeroMQTransport"]
