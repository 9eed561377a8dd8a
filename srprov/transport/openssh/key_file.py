"""Which file a new host key may be written to by an inventory's word, which may be a stranger's.

Takes settings; looks at the file system. To other programs such a line is another thing: to sshd, in a file of
authorized keys, that whoever has this key may log in here; to a shell, in a folder of which it runs all files, the
host's name is a program. So by an inventory's word no name stands in it that somebody chose.
"""

from __future__ import annotations

import ipaddress
import os
import re
import stat

from srprov.transport.openssh.settings import SshSettings

_NAME = re.compile("known[._-]?hosts", re.IGNORECASE)
_PLAIN = re.compile(r"[a-z0-9._:%_\[\]-]+", re.ASCII)
_AT_A_PORT = re.compile(r"\[(.*)\]:[0-9]+")


def place(settings: SshSettings) -> tuple[str, str]:
    """Return the file that a new key is written to, and why that is none: then it is `/dev/null`, as without a file."""
    file = next(iter(settings.known_hosts), os.devnull)
    why = _why_not(file) if settings.known_hosts_named and file != os.devnull else ""
    return (os.devnull, f"it is not written to {file}, which {why}") if why else (file, "")


def stands_plain(settings: SshSettings, name: str) -> bool:
    """Return whether a host's name may be written as it is, and not as a hash.

    One with a comma or a star would mean other robots. By an inventory's word only addresses are: a line that begins
    with `|1|` is nothing to any other program, whatever folder the inventory has it written to.
    """
    return bool(_PLAIN.fullmatch(name)) and (not settings.known_hosts_named or _is_address(name))


def _is_address(name: str) -> bool:
    """Return whether a name of known_hosts is an IP address, perhaps with its port."""
    at_a_port = _AT_A_PORT.fullmatch(name)
    try:
        address = ipaddress.ip_address(at_a_port[1] if at_a_port else name)
    except ValueError:
        return False
    return not (isinstance(address, ipaddress.IPv6Address) and address.scope_id)


def _why_not(file: str) -> str:
    """Return why a file is none that host keys are kept in, or nothing."""
    real = os.path.realpath(file)
    if not _NAME.search(os.path.basename(real)):
        leads = "" if real == os.path.abspath(file) else "leads to what "
        return f"{leads}is not called known_hosts"
    try:
        about = os.lstat(real)
    except OSError:  # it is made, or who writes to it says why not
        return ""
    if not stat.S_ISREG(about.st_mode):
        return "is no file"
    return "has another name (a hard link)" if about.st_nlink > 1 else ""
