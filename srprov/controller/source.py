"""What a run starts from: an experiment's definitions, or a plan that was kept in a file. Reads the files."""

from __future__ import annotations

import functools
import os
import shlex
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec.structs import replace

from srprov import regular_file
from srprov.codes import Code
from srprov.definitions import load_experiment, refuse_link_out
from srprov.definitions.lockfile import Lock, lock_path
from srprov.definitions.lockfile import load as load_lock
from srprov.definitions.model import Definitions
from srprov.definitions.profiles import chosen
from srprov.errors import UsageError
from srprov.git_address import parse_address

EDF_ENDINGS = (".edf", ".yml", ".yaml")
"""No plan has such a name."""

if TYPE_CHECKING:
    from srprov.planning.planfile import PlanFile


def read_source(
    file: str, signers: str = "", allowed: Collection[str] = (), profiles: Collection[str] = (), *, locked: bool = False
) -> Definitions | PlanFile:
    """Read an EDF with every file that it names, or a plan that `plan -o` wrote.

    With `signers`, only a plan that one of them signed: nothing of the file is looked at before that is sure.

    Raises:
        DefinitionError: With everything that is wrong with it.
        UsageError: It is a plan that cannot be applied, or that is named like an EDF; or an EDF, with `signers`.
        RefusedError: Nobody among the signers signed it; or a CDF is in a git repository, and that is not allowed.
    """
    if signers:
        return _signed(file, signers)
    saved = saved_plan(file)
    if saved and locked:
        raise UsageError(
            "--locked is for an EDF: what a plan in a file does was decided when it was made", code=Code.OPTIONS
        )
    return saved or read_definitions(file, allowed, profiles, locked=locked)


def read_definitions(
    file: str, allowed: Collection[str], profiles: Collection[str] = (), *, locked: bool = False,
    environ: Mapping[str, str] | None = None,
) -> Definitions:  # fmt: skip
    """Read an EDF with every file that it names, and put in what its lock says, which is of all services.

    Args:
        file: The EDF.
        allowed: Kinds of permission that the user gave.
        profiles: Of services that are wanted beside those that always are.
        locked: Refuse when there is no lock, or when it is out of date.
        environ: What gives the values of variables that are named alone; None: the process's environment.

    Raises:
        DefinitionError: With everything that is wrong with it, or with the lock.
        UsageError: With all that the lock and the files differ in; or no service has such a profile; or a link leads
            the file's name out of the folder that it is named in.
        RefusedError: A CDF is in a git repository, and the user did not allow to fetch it; or there is a lock, and a
            file that would be compared with it is not the experiment's own.
    """
    refuse_link_out(file)
    found = chosen(_with_lock(file, allowed, environ, locked=locked), profiles)
    if not found.experiment.services:
        raise UsageError(
            "no service is wanted: all of them have profiles", hint="name one with --profile", code=Code.NO_SUCH_NAME
        )
    return found


def _with_lock(file: str, allowed: Collection[str], environ: Mapping[str, str] | None, *, locked: bool) -> Definitions:
    path = lock_path(file)
    lock = load_lock(path)
    found = fetched(file, allowed, functools.partial(_tree, lock.commits if lock else {}), environ)
    if lock is None and not locked:
        return found
    from srprov.controller.own_files import permit_compared
    from srprov.controller.pins import differences, pinned

    if lock is None:
        raise UsageError(
            f"there is no lock {path}", hint=f"srprov lock {shlex.quote(str(file))} -i INVENTORY", code=Code.LOCK_FILE
        )
    permit_compared(found, allowed)
    try:
        told = differences(found, lock)
    except (OSError, ValueError) as error:
        raise UsageError(f"a file of the experiment cannot be read: {error}", code=Code.NO_FILE) from None
    if told and locked:
        lines = "\n".join(f"  {one}" for one in told)
        raise UsageError(
            f"{path} is out of date:\n{lines}",
            hint=f"srprov lock {shlex.quote(str(file))} -i INVENTORY",
            code=Code.LOCK_FILE,
        )
    more = f", and {len(told) - 1} more" if told[1:] else ""
    notes = [f"{path} is out of date: {one}{more}" for one in told[:1]]
    notes += _doubts(found, lock)
    return replace(pinned(found, lock), notes=tuple(notes))


def _doubts(found: Definitions, lock: Lock) -> list[str]:
    """Return what is to be said of the commits from which CDFs were read; those of code are told when it is fetched."""
    named = sorted({(url, ref) for _, url, ref in found.experiment.remote} & lock.commits.keys())
    if not named:
        return []
    from srprov.controller.repositories import doubts

    return [*filter(None, doubts((*one, lock.commits[one]) for one in named).values())]


def _tree(commits: Mapping[tuple[str, str], str], url: str, ref: str) -> str:
    from srprov.controller.repositories import tree

    return tree(url, ref, commits)


def fetched(
    file: str, allowed: Collection[str], fetch: Callable[[str, str], str], environ: Mapping[str, str] | None = None
) -> Definitions:
    """Read an EDF with every file that it names, when the user allowed it: those elsewhere, and CDFs in git.

    Args:
        file: The EDF.
        allowed: Kinds of permission that the user gave.
        fetch: Gives a folder with the files of a repository's branch, tag or commit.
        environ: As `read_definitions` has it.

    Raises:
        DefinitionError: With everything that is wrong with it.
        RefusedError: The user did not allow it.
    """
    if allowed:
        from srprov.controller.secrets import note_named

        note_named(file, allowed)
    outside = not {"outside", "all"}.isdisjoint(allowed)
    found = load_experiment(file, environ, outside=outside)
    if not found.unsupported:
        return found
    from srprov.controller.permissions import permit_planning
    from srprov.planning.policy import Permission, permissions

    permit_planning(permissions(found.experiment, found.containers), allowed)
    if not found.experiment.remote:
        return found
    named = {url for _, url, _ in found.experiment.remote}

    def asked(url: str, ref: str) -> str:
        # git opens a repository of this machine as its user: what a fetched CDF names was not among the above
        if url not in named and (path := parse_address(url).path):
            permit_planning([Permission(kind="outside", service="a CDF in a repository", what=path)], allowed)
        return fetch(url, ref)

    found = load_experiment(file, environ, fetch=asked, outside=outside)
    if found.unsupported:  # a CDF that was fetched names files that are not in its repository
        permit_planning(permissions(found.experiment, found.containers), allowed)
    return found


def is_edf_name(file: str) -> bool:
    """Return whether a file's name says that it is an EDF: what is in it must not be taken for a plan, then."""
    return file.lower().endswith(EDF_ENDINGS)


def _signed(file: str, signers: str) -> PlanFile:
    from srprov.controller.signature import verified

    refuse_link_out(file)
    hint = "leave --signers out, or sign a plan: srprov plan EDF -o plan.json --sign KEY"
    if is_edf_name(file):
        raise UsageError(f"--signers is for plans, and {file} is named like an EDF", hint=hint, code=Code.OPTIONS)
    text = verified(file, signers).decode("utf-8", "replace")
    saved = _read_plan(text, file)
    if saved is None:
        raise UsageError(f"--signers is for plans, and {file} is none", hint=hint, code=Code.OPTIONS)
    return saved


def saved_plan(file: str) -> PlanFile | None:
    """Return the plan that a file holds; None for one that holds something else.

    Raises:
        UsageError: It cannot be read, or cannot be applied, or is named like an EDF; or a link leads its name out.
    """
    refuse_link_out(file)
    try:
        if not regular_file.beginning(file, 200).lstrip().startswith(b"{"):
            return None
    except OSError:
        return None  # the definitions say what is wrong with it
    from srprov.planning.planfile import MAX_CHARACTERS

    try:
        text = regular_file.read_text(file, MAX_CHARACTERS)
    except OSError as error:
        raise UsageError(
            f"{file} cannot be read: {error.strerror}", hint="apply the EDF itself", code=Code.NO_FILE
        ) from error
    return _read_plan(text, file)


def _read_plan(text: str, file: str) -> PlanFile | None:
    if not text.lstrip().startswith("{"):
        return None
    from srprov.planning.planread import is_plan, load

    if not is_plan(text):
        return None
    if regular_file.has_further_names(os.stat(file)):  # an archive may have given a plan of the user's a second name
        why = f"{file} has another name, elsewhere (a hard link)"
        raise UsageError(why, hint="copy it, if it is your own", code=Code.STRANGE_FILE)
    if is_edf_name(file):
        hint = "if you trust it, give it another name, such as plan.json"
        raise UsageError(
            f"{file} is named like an EDF, and is none: it says no 'edf', as only a plan does",
            hint=hint,
            code=Code.WRONG_KIND,
        )
    from srprov.controller.authority import check_file

    saved = load(text, file)
    check_file(saved, file)
    return saved


def named_instance(file: str) -> tuple[str, str]:
    """Return an experiment's name and its source; the EDF need not be valid any more for that.

    Raises:
        DefinitionError: It has no name that can be read.
    """
    from srprov.definitions.named import experiment_name
    from srprov.definitions.source import source_of

    return experiment_name(file), source_of(str(Path(file).resolve()))
