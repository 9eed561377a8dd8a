"""One SSH connection, as OpenSSH would make it: settings, host keys, login, algorithms and the way there.

`resolve.py` finds out how a host is reached, `connection.py` connects. What is imported here needs paramiko, except for
`resolve.py` and `ssh_config.py`.
"""
