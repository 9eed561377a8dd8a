"""Sessions in other processes of this machine: the seam along which they are sharded, and nothing else is.

A worker process holds the connections of its robots and does what costs a processor there: key exchanges, framing,
heartbeats, the engine's streams, copies. All that is decided stays in this process, which sees a `FarSession` per robot
(`far_session.py`) where it would see an `SshSession`. `link.py` carries calls both ways, `post.py` their bytes over a
socket pair, `sealed.py` their values, `served.py` answers them, `worker.py` is the other process, and `processes.py`
starts and ends it.
"""
