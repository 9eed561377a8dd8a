"""Where a secret comes from -> its value, as a `Secret`.

Takes SecretSources; gives a Vault, or every problem at its line of the EDF. Reads the environment and files, and runs
the commands that the EDF names: without a shell, without a terminal, with a deadline. For plan and apply only, and only
what a service uses. A variable that was read leaves the environment, so that no program that srprov starts inherits it.
"""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Iterable, MutableMapping

from srprov import regular_file
from srprov.codes import Code
from srprov.definitions.model import Experiment
from srprov.definitions.program import read_both, stop
from srprov.definitions.secretmodel import SecretSource
from srprov.errors import DefinitionError, Diagnostic
from srprov.secret import Secret, Vault, redact

DEADLINE_S = 30.0
_LARGEST = 512_000
"""Bytes of a secret; Docker's own limit is about as high."""
_COMPLAINT = 2000
"""Characters of what a failed command complained about."""


def used(experiment: Experiment) -> tuple[SecretSource, ...]:
    """Return the sources of those secrets that some service lists, in name order."""
    names = {use.source for service in experiment.services.values() for use in service.secrets}
    return tuple(experiment.secrets[name] for name in sorted(names))


def resolve(
    sources: Iterable[SecretSource], environ: MutableMapping[str, str] | None = None, deadline_s: float = DEADLINE_S
) -> Vault:
    """Read every value.

    Raises:
        DefinitionError: With every variable, file and command that gave none.
    """
    variables = os.environ if environ is None else environ
    found: dict[str, Secret] = {}
    problems = []
    wanted = tuple(sources)
    taken = {source.env: variables.get(source.env) for source in wanted if source.env}
    for name in taken:
        variables.pop(name, None)
    for source in wanted:
        try:
            found[source.name] = Secret(_value(source, taken, variables, deadline_s))
        except (ValueError, OSError) as error:
            why = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
            message = f"secret '{source.name}': {redact(why)}"
            problems.append(
                Diagnostic(
                    source.location, message, f"secrets.{source.name}", source.excerpt, _hint(source), code=Code.SECRET
                )
            )
    if problems:
        raise DefinitionError(problems)
    return Vault(found)


def _hint(source: SecretSource) -> str:
    if source.env:
        return f"set {source.env} where srprov runs"
    return f"it is looked for at {source.file}" if source.file else "try the command by hand"


def _value(
    source: SecretSource, taken: dict[str, str | None], environ: MutableMapping[str, str], limit_s: float
) -> str:
    """Return the value as text; bytes that are no UTF-8 become surrogates, and leave as they were."""
    if source.env:
        given = taken[source.env]
        if given is None:
            raise ValueError(f"the controller's environment has no '{source.env}'")
        return given
    if source.file:
        content = regular_file.read(source.file, _LARGEST, real=True)
    else:
        content = _run(source, environ, limit_s)
        content = content[: -2 if content.endswith(b"\r\n") else -1] if content.endswith(b"\n") else content
    if len(content) > _LARGEST:
        raise ValueError(f"is larger than {_LARGEST} bytes")
    return content.decode("utf-8", "surrogateescape")


def _run(source: SecretSource, environ: MutableMapping[str, str], limit_s: float) -> bytes:
    """Run a command and return what it printed; its error output is shown only when it fails."""
    program = source.command[0]
    process = subprocess.Popen(
        source.command,
        cwd=source.folder or None,
        env=dict(environ),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )
    end = time.monotonic() + limit_s
    try:
        out, err = read_both(process, end, _LARGEST + 1)
        if len(out) > _LARGEST:
            return out  # the caller says so; the rest of it is not waited for
        code = process.wait(max(end - time.monotonic(), 0.0))
    except (TimeoutError, subprocess.TimeoutExpired):
        raise ValueError(f"'{program}' did not end within {limit_s:g} s") from None
    finally:
        stop(process)
    if code != 0:
        _redact_output(out)
        said = " ".join(redact(err.decode("utf-8", "replace")).split())[-_COMPLAINT:]
        raise ValueError(f"'{program}' ended with {code}" + (f": {said}" if said else ""))
    return out


def _redact_output(out: bytes) -> None:
    """Hide what a failed command printed: it may be the value, and be repeated in its error output."""
    try:
        Secret(out.decode("utf-8", "surrogateescape"))
    except ValueError:
        return
