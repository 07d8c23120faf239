"""Transport `shm`: shared memory of one machine, on iceoryx2.

    a publication        its publisher's topic → its subscribers
    a request, command   the queue of the transport that serves
    a reply              the queue of the thread that waits for it, or of its transport

Peers find each other in the directory of the run-time folder, not through iceoryx2. `samples` describes the layout of
a message; only `node` and `samples` use iceoryx2; large payloads lie in a `heap`. Decisions 11 and 41 give the reasons.

Threads. One thread (the leader of a `LeaderFollowers`) waits at the transport's wake-up pipe, which every sender
writes to, and handles what came in itself. For a synchronous call, the calling thread takes a line from a pool and
waits at the wake-up pipe of that line. iceoryx2 itself never waits, because it would hold the interpreter meanwhile.
"""
