"""Other hosts: reached over SSH, given what they need, and asked to start processes.

addresses    at which number a host is reached
trusting     the known keys of hosts, and where they are recorded
ssh          one connection and one channel to each host; what goes wrong with that, for people
bundle       what is sent: an archive with a name that follows from what is in it
bootstrap    the program that receives it there, which is sent as an argument: nothing is installed
lines        what the two sides tell each other afterwards, a line each
remote       the agent of a host, as `run.py` sees it; the program it talks to is `deploy/agent.py`
fleet        the agents of a plan
"""
