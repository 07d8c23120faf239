"""Transport `zenoh`: every component is a client of one router (see `session`).

    rc/<domain>/<channel>                 publications and commands: payload in CDR, our header as the attachment
    rc_to/<domain>/<transport>/<number>   the same, to one link: a request to a server, a reply to a client
    rc_lv/<domain>/…/<link>/<channel>     a liveliness token for each link (`Token`), for discovery
    rc_ack/<domain>/<transport>/<number>  acknowledgements to a link: "I have taken your messages up to this one"
    rc_ask/<domain>/<transport>/<number>  inquiries to a link: `/text` (its contract), `/history` (latched messages)

A link's id consists of 40 bits that identify its transport and 24 bits that number the link. It is
also the client or source in headers, so the receiver of a message knows where to send a reply, an
acknowledgement or an inquiry. A call is two such messages, which is faster than a Zenoh query. A
server also answers Zenoh queries at `rc/<domain>/<channel>`, for programs that send only those.

Zenoh drops messages, or closes the connection, if a reader is slow. Reliable publications and
commands must not be lost, so readers acknowledge them, and a sender waits when a limited number of
its messages is unacknowledged (`Credit`).

Threads. Callbacks run on Zenoh's own threads, where a slow one delays every link. So they only queue
what arrives, and a `LeaderFollowers` does the rest. They must not log: `logging` would register
Zenoh's threads with `threading`. Frequent messages need no callback: publications, and the replies
to blocking calls, stay in a Zenoh channel until one of our threads reads it (`Reader`, `client`).

Priorities. Small requests, replies and acknowledgements, and all commands, overtake other messages.
"""
