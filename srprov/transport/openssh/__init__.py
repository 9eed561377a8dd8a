"""One SSH connection, as OpenSSH would make it: settings, host keys, login, algorithms and the way there.

`resolve.py` finds out how a host is reached, `connection.py` connects. What is imported here needs paramiko, except for
`resolve.py`, `ssh_config.py`, and `way.py` with `sockets.py`, which begin the way while paramiko is imported.
"""
