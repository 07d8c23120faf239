"""Transport `zenoh`: every component is a client of one router (see `session`).

    rc/<domain>/<channel>                 publications and commands: payload in CDR, our header as the attachment
    rc_to/<domain>/<transport>/<number>   the same, to one link: a request to its server, an answer to who asked
    rc_lv/<domain>/…/<link>/<channel>     a liveliness token for each link: who is there (`Token`)
    rc_ack/<domain>/<transport>/<number>  to a link: "this message of yours was taken"
    rc_ask/<domain>/<transport>/<number>  of a link: `/text`, its contract; `/history`, its latched messages

A link's id, which is also the client or source of its headers, is 40 bits of its transport and 24
of its own number, so whoever has got a message from it knows where to answer, to acknowledge and
to ask. Calls are two such messages, which is quicker than a query of Zenoh's; for programs that
know only those, `rc/<domain>/<channel>` of a server answers them, too.

Zenoh drops messages, or closes the connection, where a reader is slow. What must not be lost
(reliable publications, commands) is therefore sent only to readers that have room for it: they
acknowledge what they took, and a sender is at most so many messages ahead (`Credit`).

Threads. Callbacks run on Zenoh's own threads, and one that is slow delays everybody. So they only
queue what came in, and a `LeaderFollowers` does the rest. They must not log either: `logging` would have
`threading` take them for ours. What comes often goes without them: publications, and the answers
to who waits, lie in channels of Zenoh's until a thread of ours takes them (`Reader`, `asking`).

Priorities. Calls, answers and acknowledgements that are small, and all commands, overtake the rest.
"""
