"""RevokedHostKeys of ssh_config: whether a robot shows a key that is in such a file, or may be.

Takes the file and the key; reads a list of public keys, and has `ssh-keygen -Q` read a KRL.
"""

from __future__ import annotations

import base64
import subprocess
import tempfile

from srprov import regular_file
from srprov.codes import Code
from srprov.errors import HostKeyError

_KRL = b"SSHKRL\n\0"
_LIMIT_S = 10


def check(name: str, file: str, kind: str, blob: bytes) -> None:
    """Refuse a key that the file has; as ssh does, also any key where the file cannot be read.

    Raises:
        HostKeyError: It is revoked, or nobody knows.
    """
    key = base64.b64encode(blob)
    try:
        content = regular_file.read(file)
        is_revoked = _in_krl(content, kind, key) if content.startswith(_KRL) else key in content.split()
    except (OSError, ValueError, subprocess.TimeoutExpired) as error:
        wrong = f"nobody knows whether its host key is revoked: {file} cannot be read ({error})"
        raise HostKeyError(name, wrong, hint="correct RevokedHostKeys", code=Code.HOST_KEY_CHANGED) from None
    if is_revoked:
        wrong, hint = f"its host key is revoked by {file}", "do not connect; ask who revoked it"
        raise HostKeyError(name, wrong, hint=hint, code=Code.HOST_KEY_CHANGED)


def _in_krl(content: bytes, kind: str, key: bytes) -> bool:
    with tempfile.NamedTemporaryFile() as krl, tempfile.NamedTemporaryFile() as shown:
        krl.write(content)
        shown.write(b"%s %s\n" % (kind.encode(), key))
        krl.flush()
        shown.flush()
        done = subprocess.run(
            ["ssh-keygen", "-Q", "-f", krl.name, shown.name],
            capture_output=True, text=True, timeout=_LIMIT_S, stdin=subprocess.DEVNULL, check=False,
        )  # fmt: skip
    if done.returncode and "REVOKED" not in done.stdout:
        raise ValueError(" ".join(done.stderr.split())[-200:])
    return bool(done.returncode)
