"""Signatures of plan files and of bundles, by `ssh-keygen -Y`: beside PLAN lies PLAN.sig.

Who may sign stands in an `allowed_signers` file, see ssh-keygen(1). Runs ssh-keygen; reads the plan once, and checks
those very bytes.
"""

from __future__ import annotations

import subprocess
import tempfile

from srprov import regular_file
from srprov.codes import Code
from srprov.errors import RefusedError, UsageError
from srprov.planning.planfile import MAX_CHARACTERS

NAMESPACE = "srprov-plan"
"""What a signature is for: one that was made for something else is none."""
_SIGN_S = 120.0
"""A passphrase may be asked for, or a touch."""
_VERIFY_S = 20.0
_MOST_SIGNATURE = 64 * 1024
"""Bytes; one has less than a thousand."""


def signature(content: bytes, file: str, key: str, namespace: str = NAMESPACE) -> bytes:
    """Return the signature of what a file is to hold, by an SSH key, or the agent's when `key` is a public one.

    Raises:
        UsageError: It cannot be signed.
    """
    done = _ssh_keygen("sign", "-n", namespace, "-f", key, given=content, limit_s=_SIGN_S)
    if done.returncode != 0:
        raise UsageError(
            f"cannot sign {file}: {_said(done)}", hint="name a private SSH key with --sign", code=Code.SIGNATURE
        )
    return done.stdout


def verified(file: str, signers: str) -> bytes:
    """Return a plan file's bytes when one of the signers signed them.

    Raises:
        RefusedError: There is no signature, or none of theirs, or it is not of these bytes.
    """
    content = _read(file)
    said = _complaint(content, f"{file}.sig", signers)
    if said:
        hint = "have it signed by one of them: srprov plan EDF -o plan.json --sign KEY"
        raise RefusedError(f"{file} has no signature of {signers}: {said}", hint=hint, code=Code.SIGNATURE)
    return content


def _complaint(content: bytes, signature: str, signers: str) -> str:
    """Return why a signature is none of these bytes by one of the signers, or nothing."""
    try:
        signed = regular_file.read(signature, _MOST_SIGNATURE)
    except OSError as error:
        return f"{signature}: {error.strerror}"
    return signed_by(content, signed, signers, NAMESPACE)


def signed_by(content: bytes, signed: bytes, signers: str, namespace: str) -> str:
    """Return why `signed` is no signature of `content` by one of the signers, or nothing."""
    with tempfile.NamedTemporaryFile(prefix="srprov-", suffix=".sig") as copy:
        copy.write(signed)
        copy.flush()
        found = _ssh_keygen("find-principals", "-s", copy.name, "-f", signers)
        said = _said(found)
        for principal in found.stdout.decode("utf-8", "replace").splitlines() if found.returncode == 0 else ():
            about = ("-n", namespace, "-f", signers, "-I", principal, "-s", copy.name)
            done = _ssh_keygen("verify", *about, given=content)
            if done.returncode == 0:
                return ""
            said = _said(done)
        return said


def _read(file: str) -> bytes:
    try:
        return regular_file.read(file, MAX_CHARACTERS)
    except OSError as error:
        raise UsageError(f"cannot read {file}: {error.strerror}", hint="name a plan file", code=Code.NO_FILE) from error


def _ssh_keygen(
    verb: str, *words: str, given: bytes = b"", limit_s: float = _VERIFY_S
) -> subprocess.CompletedProcess[bytes]:
    command = ("ssh-keygen", "-Y", verb, *words)
    try:
        return subprocess.run(command, input=given, capture_output=True, timeout=limit_s, check=False)
    except FileNotFoundError as error:
        raise UsageError(
            "there is no ssh-keygen", hint="install OpenSSH's client, 8.2 or newer", code=Code.NOT_INSTALLED
        ) from error
    except subprocess.TimeoutExpired as error:
        raise RefusedError(
            f"no signature within {limit_s:g} s: ssh-keygen did not end", hint="try again", code=Code.SIGNATURE
        ) from error


def _said(done: subprocess.CompletedProcess[bytes]) -> str:
    return " ".join((done.stderr or done.stdout).decode("utf-8", "replace").split())[:300] or f"exit {done.returncode}"
