"""User files -> Inventory, Experiment (EDF), ContainerDefinition (CDF).

Takes paths; gives values, or `DefinitionError` with every problem at once, each with file, line, column and what to
do. Touches user files for reading, and runs an inventory that is a program, and the commands that give secrets. What a
field means is in `schemas/` and in docs/definitions.md.

    schema, schema_cache   document (`yamldoc`) and JSON Schema -> problems
    paths, named_links, values, mounts  what a text stands for
    merging, runtime       one definition over another -> run-time part
    container, extends, dockerfile, build, cdfs, cdf_folder, remote  CDFs, also in git
    service, envfile, checks, experiment, pins  EDF
    dollars, file_named_volumes  what is allowed and surprises people who come from Compose
    foreign_keys           keys that other tools have
    template, playbook, playbookmodel  playbooks that users write
    taken, hiding          what comes from outside of the experiment's folder, and what problems tell of it
    secrets, secretmodel, secretvalues  where secrets come from, and what they are
    formatting  EDFs and CDFs in one form
    starter     a new experiment
    inventory, inifile, script, hostvars, ranges, terms, patterns  the robots
    unseen      what in an inventory its reader does not see
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from srprov.codes import Code
from srprov.errors import DefinitionError, Diagnostic

if TYPE_CHECKING:
    from srprov.definitions.containermodel import ContainerDefinition
    from srprov.definitions.model import Definitions, Inventory


def load_experiment(
    path: str | Path,
    environ: Mapping[str, str] | None = None,
    fetch: Callable[[str, str], str] | None = None,
    *,
    profiles: Collection[str] = ("*",),
    outside: bool = False,
    home: str = "",
) -> Definitions:
    """Read an EDF and every file that it names; `environ` (default: the process's) gives bare names in `environment`.

    `fetch` gives a folder with the files of a repository's branch, tag or commit; without it no CDF is fetched.
    Services that have profiles are left out unless one of theirs is among `profiles`, or `*`. Files that are not the
    experiment's own, in `home` or else the EDF's folder, are looked at with `outside` alone: the user allowed it.

    What validates but could not be read is listed in `Definitions.unsupported`; whoever acts must refuse it.

    Raises:
        DefinitionError: With everything that is wrong.
    """
    from srprov.definitions import experiment, hiding, paths
    from srprov.definitions.own_lines import hide_own
    from srprov.definitions.profiles import chosen

    try:
        home = "" if outside else home or os.path.dirname(os.path.abspath(path))
        found = experiment.load(str(path), os.environ if environ is None else environ, fetch, home)
        return chosen(found, profiles)
    except DefinitionError as error:
        folder = paths.folder_of(str(path))
        raise DefinitionError(hide_own(hiding.hide_outside(error.problems, folder), str(path), folder)) from None


def load_container(path: str | Path, environ: Mapping[str, str] | None = None) -> ContainerDefinition:
    """Read a single CDF or Dockerfile; it may use files below its own folder, or that of an EDF above that leads to it.

    Raises:
        DefinitionError: With everything that is wrong.
    """
    return _container(path, environ, outside=True)[0]


def _container(
    path: str | Path, environ: Mapping[str, str] | None, *, outside: bool
) -> tuple[ContainerDefinition, tuple[Diagnostic, ...]]:  # and what it names that was not looked at
    from srprov.definitions import cdf_folder, container, hiding, paths, schema
    from srprov.definitions.own_lines import hide_own
    from srprov.yamldoc import loader
    from srprov.yamldoc.allowance import allowance

    if not os.path.lexists(path):
        loader.read_text(path)  # it says what the user, who named it, may have meant
    folder = cdf_folder.experiment_folder(str(path))
    told = paths.folder_of(str(path)) if paths.link_out(str(path)) else folder
    try:
        with allowance(schema.MOST_BYTES, schema.MOST_VALUES, "" if outside else folder) as limits:
            found = container.load(str(path), folder, os.environ if environ is None else environ).definition
        return found, hiding.without_words((one.note for one in limits.left), told)
    except DefinitionError as error:
        raise DefinitionError(hide_own(hiding.hide_outside(error.problems, told), str(path), folder)) from None


def load_inventory(paths: Sequence[str | Path], unnamed: Collection[str] = (), *, run: bool = True) -> Inventory:
    """Read the robots from one or more inventories as Ansible has them; later ones win.

    One of `unnamed`, which the user did not name himself, may not make srprov run anything here. Without `run`, one
    that is a program is refused, whoever named it.

    Raises:
        DefinitionError: With everything that is wrong.
    """
    from srprov.definitions import inventory, names_alone

    named = [str(path) for path in paths]
    found = inventory.load(named, unnamed, run=run)
    names_alone.check_no_command(named, found.hosts.values())
    return names_alone.of_records(named, found)


def select(inventory: Inventory, pattern: str, failed: Callable[[], Collection[str]] | None = None) -> tuple[str, ...]:
    """Return the names of the hosts that an Ansible pattern picks; `failed` says what `@failed` stands for.

    Raises:
        UsageError: A term matches nothing, or nothing is left.
    """
    from srprov.definitions import patterns

    return patterns.select(inventory, pattern, **({"failed": failed} if failed else {}))


def refuse_link_out(path: str, named: str = "") -> None:
    """Refuse a relative path by which a link leads out of its folder; see `named_links.refuse_link_out`."""
    from srprov.definitions import named_links

    named_links.refuse_link_out(path, named)


def refuse_link(path: str) -> None:
    """Refuse a relative path with a link in it; see `named_links.refuse_link`."""
    from srprov.definitions import named_links

    named_links.refuse_link(path)


def offered(path: str, what: str) -> tuple[str, ...]:
    """Return the `services` or `profiles` that an EDF names, or the `robots` or `groups` of an inventory, sorted.

    For a command line that is being typed: what cannot be read gives nothing, and no program is run.
    """
    from srprov.definitions import offers

    return offers.offered(path, what)


def with_files_below(paths: Sequence[str]) -> list[str]:
    """Return the paths, with the EDFs and CDFs of each folder that has some in the folder's place.

    Raises:
        UsageError: A folder holds more than anybody means.
    """
    from srprov.definitions import files_below

    return files_below.with_files_below(paths)


def check_files(paths: Sequence[str | Path], profiles: Collection[str] = ()) -> list[Diagnostic]:
    """Return the problems that `checked` finds."""
    return checked(paths, profiles)[0]


def checked(
    paths: Sequence[str | Path], profiles: Collection[str] = (), *, outside: bool = False
) -> tuple[list[Diagnostic], list[Diagnostic]]:
    """Return every problem of EDFs, CDFs, Dockerfiles and inventories, sorted; suffix or content tells the kind.

    An EDF must also make sense without the services whose `profiles` are not named.

    Returns:
        The problems, and what was not looked at, without `outside`: files that are not the experiment's own.

    Raises:
        UsageError: An EDF has no service with such a profile.
    """
    from srprov.definitions import hiding

    found, left = set[Diagnostic](), set[Diagnostic]()
    for path in map(str, paths):
        try:
            away = not outside and hiding.is_elsewhere(path)
            left.update([hiding.note_on(path)] if away else _check(path, profiles, outside=outside))
        except DefinitionError as error:
            found.update(error.problems)
    return sorted(found), sorted(left)


def remarks(paths: Sequence[str | Path]) -> list[Diagnostic]:
    """Return what in EDFs and CDFs is allowed and may not mean what their writers expect, sorted.

    Raises:
        DefinitionError: A file is no YAML.
    """
    from srprov.definitions import dockerfile, dollars, file_named_volumes, hiding
    from srprov.yamldoc import loader

    found: set[Diagnostic] = set()
    # a remark is told with its line, so there is none on what a link leads to elsewhere
    for path in (one for one in map(str, paths) if not hiding.is_elsewhere(one)):
        kind = file_kind(path)
        if kind in ("edf", "cdf") and not dockerfile.is_dockerfile(path):
            root = loader.read(path)
            found.update((*dollars.remarks_on(root, kind), *file_named_volumes.remarks_on(root, kind)))
    return sorted(found)


def _check(path: str, wanted: Collection[str], *, outside: bool) -> Collection[Diagnostic]:
    kind = file_kind(path)
    if kind == "edf":
        from srprov.definitions import lockfile

        found = load_experiment(path, profiles=wanted, outside=outside)
        lockfile.load(lockfile.lock_path(path))
        return [one for one in found.unsupported if one.code == Code.OUTSIDE]
    if kind == "cdf":
        return _container(path, None, outside=outside)[1]
    # who checks files takes what a pattern finds, as a CI does with those of a stranger's branch
    load_inventory([path], run=False)
    return ()


def file_kind(path: str) -> str:
    """Return what a file is: `edf`, `cdf` (a Dockerfile too) or `inventory`.

    Raises:
        DefinitionError: Its content has to tell, and it cannot be read.
    """
    from srprov.definitions import dockerfile, files_below, hiding, paths
    from srprov.yamldoc import loader
    from srprov.yamldoc.nodes import Map

    if named := files_below.kind_by_name(path):
        return named
    if dockerfile.is_dockerfile(path):
        return "cdf"
    if os.path.isdir(path) or not path.endswith((".yml", ".yaml", ".json")) or os.access(path, os.X_OK):
        return "inventory"
    try:
        root = loader.read(path)
    except DefinitionError as error:
        raise DefinitionError(hiding.hide_outside(error.problems, paths.folder_of(path))) from None
    keys = set(root.entries) if isinstance(root, Map) else set()
    if "edf" in keys or ("services" in keys and "all" not in keys):
        return "edf"
    return "cdf" if "cdf" in keys else "inventory"
