"""Transport `zeromq`: a socket for every topic that is published, one for all operations that are served.

    frames of a publication   channel · header · payload…            XPUB → SUB
    frames of a request       channel · header · payload…            DEALER → ROUTER
    frames of a reply         header · payload…                      ROUTER → DEALER

Who serves what, and where, stands in the directory of the run-time folder, beside the sockets'
`ipc://` files. A late subscriber of a latched topic also subscribes to a name of its own, and gets
under it what it missed.

Threads. A ZeroMQ socket may be used by several threads only under a lock, and nobody must sleep
holding it. So one thread (the leader of a `Crew`) sleeps on the file descriptors of all sockets,
and everybody reads and writes under the socket's lock without waiting (`sockets.Socket`). The exception
is a synchronous call: its thread takes a socket out of a pool, has it to itself, and receives the
answer itself.
"""

from .transport import ZeroMQTransport

__all__ = ["ZeroMQTransport"]
