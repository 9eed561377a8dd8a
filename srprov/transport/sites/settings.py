"""What is asked of a cluster before anything is said to it: TLS with certificates, and the same program at each end."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import srprov
from srprov import regular_file
from srprov.codes import Code
from srprov.errors import RefusedError, UsageError

_MOST_BYTES = 8 << 20
_INSTALL = "pip install 'distributed>=2026.1', here and at each site"
_CONFIGURATION = "look at the files in ~/.config/dask: is each of them YAML with `name: value` at its top?"


def checked_address(address: str) -> str:
    """Return the address of a scheduler.

    Raises:
        RefusedError: It is one without TLS.
        UsageError: It is none.
    """
    parts = urlsplit(address)
    if parts.scheme and parts.scheme != "tls":
        raise RefusedError(
            f"--engine {address[:100]}: only tls:// is spoken; what goes there has passwords and secrets in it",
            hint="give the scheduler certificates and name it as tls://HOST:PORT, see docs/sites.md",
            code=Code.PLAIN_CLUSTER,
        )
    try:
        whole = parts.scheme == "tls" and parts.hostname and parts.port and not (parts.path or parts.query)
    except ValueError:
        whole = False
    if not whole or parts.username is not None:
        raise UsageError(
            f"--engine {address[:100]!r} is no address of a scheduler",
            hint="write tls://HOST:PORT",
            code=Code.OPTION_VALUE,
        )
    return address


def import_distributed() -> Any:  # noqa: ANN401 - the module
    """Return Dask's library, told to print nothing by itself.

    Raises:
        UsageError: It is not installed, or its configuration cannot be read.
    """
    try:
        import dask

        loggers = ("", ".client", ".core", ".comm", ".worker", ".scheduler", ".nanny", ".batched", ".utils")
        quiet = {f"distributed{name}": "critical" for name in loggers}
        dask.config.set({"logging": {**quiet, "tornado": "critical", "tornado.application": "critical"}})
        import distributed
    except ImportError:
        raise UsageError("--engine needs Dask", hint=_INSTALL, code=Code.NOT_INSTALLED) from None
    except Exception as error:  # Dask reads its files when it is imported, and says of them what its YAML reader says
        why = " ".join(str(error).split())[:300]
        raise UsageError(f"Dask cannot be imported: {why}", hint=_CONFIGURATION, code=Code.SITE) from None
    return distributed


def security(role: str) -> Any:  # noqa: ANN401 - of a library without types
    """Return the certificates of a `client` or a `worker`, which Dask's own configuration names.

    Raises:
        UsageError: Dask is not installed; a certificate is missing, or cannot be used.
    """
    distributed = import_distributed()
    import dask

    for name in ("ca-file", f"{role}.cert", f"{role}.key"):
        key = f"distributed.comm.tls.{name}"
        path = dask.config.get(key, None)
        if not path or not Path(str(path)).is_file():
            variable = "DASK_" + key.upper().replace(".", "__").replace("-", "_")
            raise UsageError(
                f"a cluster is spoken to with certificates, and {key} of Dask's configuration "
                + (f"is no file: {path}" if path else "is not set"),
                hint=f"set it in {dask.config.PATH}/distributed.yaml, or by {variable}; see docs/sites.md",
                code=Code.SITE,
            )
    found = distributed.Security(require_encryption=True)
    try:
        found.get_connection_args(role)
    except (OSError, ValueError) as error:
        names = ("ca-file", f"{role}.cert", f"{role}.key")
        files = ", ".join(str(dask.config.get(f"distributed.comm.tls.{name}")) for name in names)
        raise UsageError(
            f"the certificates of Dask's configuration cannot be used: {error}",
            hint=f"look at {files}: are they readable, and is the key that of the certificate?",
            code=Code.SITE,
        ) from None
    return found


def reason(error: BaseException) -> str:
    """Return in one line why Dask could not do something; nothing when it does not say."""
    words = " ".join(str(error.__cause__ or error).split())
    return re.sub(r"\bin <[^>]*>: ", "", words)[:300]


def program_digest() -> str:
    """Return a hash of all of srprov's own files: what both ends say to each other is theirs alone."""
    root = Path(srprov.__file__).parent
    found = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        content = hashlib.sha256(regular_file.read(path, _MOST_BYTES)).hexdigest()
        found.update(f"{path.relative_to(root)} {content}\n".encode())
    return found.hexdigest()
