"""Which file a new host key may be written to by an inventory's word, which may be a stranger's.

Takes settings; looks at the file system. To other programs such a line is another thing: to sshd, in a file of
authorized keys, that whoever has this key may log in here.
"""

from __future__ import annotations

import os
import re
import stat

from srprov.transport.openssh.settings import SshSettings

_NAME = re.compile("known[._-]?hosts", re.IGNORECASE)


def place(settings: SshSettings) -> tuple[str, str]:
    """Return the file that a new key is written to, and why that is none: then it is `/dev/null`, as without a file."""
    file = next(iter(settings.known_hosts), os.devnull)
    why = _why_not(file) if settings.known_hosts_named and file != os.devnull else ""
    return (os.devnull, f"it is not written to {file}, which {why}") if why else (file, "")


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
