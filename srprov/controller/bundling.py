"""What a bundle needs of the controller: the values that must not be in it, and who signs it.

Reads variables and files that an experiment's definitions name and the user allowed, only to look for their values;
runs ssh-keygen.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any

import msgspec
from msgspec.structs import replace

from srprov import regular_file, secret_files
from srprov.codes import Code
from srprov.controller.signature import signature, signed_by
from srprov.controller.trial_images import ran
from srprov.definitions import load_experiment
from srprov.definitions.secretmodel import SecretSource
from srprov.definitions.secretvalues import resolve
from srprov.errors import DefinitionError, UsageError
from srprov.untrusted import mapping, parse_json, string, strings

NAMESPACE = "srprov-bundle"
"""What a signature of a bundle's manifest is for."""
_LARGEST = 64 * regular_file.MIB
_INPUTS = re.compile(r"sessions/[^/]+/inputs\.json")


class NotRead(msgspec.Struct, frozen=True):
    """Whose values nobody looks for in a bundle."""

    names: tuple[str, ...]
    """Of secrets and variables that cannot be read here."""
    variables: tuple[str, ...]
    """That nobody is known to have given to this run: none of them was read, whether or not it is there."""


def known_secrets(folder: Path, names: Collection[str]) -> NotRead:
    """Let `redact` know the secrets of a run's experiment, and the variables that its services take.

    Args:
        folder: The run's.
        names: Its files, none of which is reached by way of a link. No definition elsewhere is read: a folder may come
            from a stranger, and what is wrong with a definition is told in its own words. Of files of secrets only
            those are read that the user allowed on this machine before, and of variables those that this machine gave
            to this run: where a guess at another one is right, that there is no bundle would tell it.

    Returns:
        Those whose values were not read; commands are not run.

    Raises:
        UsageError: The folder does not say what was run.
    """
    sessions = [folder / name for name in names if _INPUTS.fullmatch(name)]
    missing, known, given_to_it = set[str](), secret_files.known(), ran(folder).variables()
    environ, apart = {name: os.environ[name] for name in given_to_it if name in os.environ}, set[str]()
    for path in sorted(sessions, key=lambda path: (len(str(path)), str(path))):
        given, about = _told_by(path)
        edf, taken = path.parent / string(given.get("edf")), strings(given.get("variables"))
        if f"{path.parent.relative_to(folder)}/{string(given.get('edf'))}" not in names:
            raise UsageError(
                f"{path} names no EDF that is there", hint="name the folder of a run of trials", code=Code.RECORD
            )
        apart.update(set(taken) - given_to_it)
        missing.update(given_to_it & set(taken) - environ.keys())
        try:
            experiment = load_experiment(edf, {**dict.fromkeys(taken, ""), **environ}, home=str(folder)).experiment
        except DefinitionError as error:
            raise UsageError(
                f"{edf}: {error.problems[0].message}",
                hint="it was changed since it was run",
                code=Code.EXPERIMENT_CHANGED,
            ) from error
        home = os.path.dirname(string(mapping(about.get("source")).get("file")))
        for name, source in sorted(experiment.secrets.items()):
            if source.env and source.env not in given_to_it:
                apart.add(source.env)
            elif not _read(_as_it_was(source, experiment.folder, home, folder), known, environ):
                missing.add(name)
    return NotRead(tuple(sorted(missing)), tuple(sorted(apart)))


def _told_by(path: Path) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    """Return what a session says of what it ran, and of where that was."""
    try:
        given = mapping(parse_json(regular_file.read_text(path, _LARGEST), max_characters=_LARGEST))
        return given, mapping(parse_json(regular_file.read_text(path.with_name("environment.json"))))
    except (OSError, ValueError) as error:
        raise UsageError(
            f"{path} cannot be read: {error}", hint="name the folder of a run of trials", code=Code.NO_FILE
        ) from None


def _as_it_was(source: SecretSource, now: str, then: str, run: Path) -> SecretSource:
    """Return where a secret comes from: a file that was named from the EDF's folder lay beside that, not in the run."""
    if not source.file or not Path(source.file).is_relative_to(os.path.abspath(run)):
        return source
    return replace(source, file=os.path.normpath(os.path.join(then, os.path.relpath(source.file, now))))


def _read(source: SecretSource, known: Collection[str], environ: Mapping[str, str]) -> bool:
    """Read a value for `redact`, of files only one of the `known`; return whether that was done."""
    if source.command or (source.file and os.path.realpath(source.file) not in known):
        return False
    try:
        resolve([source], dict(environ))
    except DefinitionError:
        return False
    return True


def signer(key: str, target: str) -> Callable[[bytes], bytes]:
    """Return what signs a bundle's manifest with an SSH key."""
    return lambda manifest: signature(manifest, target, key, NAMESPACE)


def complaint(manifest: bytes, signed: bytes, signers: str) -> str:
    """Return why a signature is none of this manifest by one of the signers, or nothing."""
    return signed_by(manifest, signed, signers, NAMESPACE)
