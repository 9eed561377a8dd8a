"""A `Put` with a placeholder and the secret's value -> the script that writes it into a robot's memory. Pure.

The value travels in the text that the robot's shell reads from its standard input, and goes to `base64` by `echo`,
which every shell has built in: an argument of a program would stand in /proc, and bash may keep a here-document in a
file below /tmp. It is written nowhere but below a folder that only root may enter, on a file system in memory.
"""

from __future__ import annotations

import base64

from srprov.wire import Put, quote


def secret_script(put: Put, value: bytes) -> str:
    """Return the script; it fails, with nothing written, where the folder is on a disk."""
    folder = quote(put.path.rpartition("/")[0])
    refuse = f"echo {folder} is not in memory: /run has to be a tmpfs >&2; exit 1"
    checked = f"case $(stat -f -c %T {folder}) in tmpfs|ramfs) ;; *) {refuse};; esac"
    return put.script(f"{checked} && echo {base64.b64encode(value).decode('ascii')}")
