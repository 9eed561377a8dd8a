"""One session of a run, read from its record: the definitions, the design, what was to be placed, and where it was.

Takes Files; gives a Session. The input files are written into a folder of the caller's, and read from there as any
definitions are: nothing of them is run.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path

import msgspec
from msgspec.structs import replace

from srprov import names, private
from srprov.codes import Code
from srprov.controller.choice import Choice, checked_choice, read_decided
from srprov.controller.request import PlanRequest
from srprov.controller.trial_instances import with_instances
from srprov.definitions import load_experiment, load_inventory
from srprov.definitions.model import Definitions, repository_in
from srprov.definitions.trialsmodel import TrialDefinitions
from srprov.errors import DefinitionError, SrprovError, UsageError
from srprov.evidence.files import MOST_JSON, Files, NotThere, below, content, json_of
from srprov.evidence.private_words import without_access
from srprov.facts.host import with_inventory
from srprov.facts.stored import read_document
from srprov.record.folder import in_lines
from srprov.trials import Design, design
from srprov.untrusted import mappings, string, string_map, strings

_INVENTORY = "inventory.yml"
_MOST_INPUTS = 128 << 20
_MOST_INPUT_FILES = 20_000
_MOST_DEFINITIONS = 4
"""That sessions of one run are of. They are of one, but for comments and what was accepted; each may take seconds."""
_MOST_PAIRS = 2_000_000
_DEEPEST, _MOST_FOLDERS = 100, 200_000
"""Folders above one input file, and above all of them."""
_STRANGE = "has names that no folder can have"
_NO_NAME = frozenset({errno.ENAMETOOLONG, errno.ENOTDIR, errno.EEXIST, errno.EISDIR, errno.EINVAL})
"""What is said of a name that is too long, or that is a file's and a folder's."""


class Session(msgspec.Struct, frozen=True, kw_only=True):
    """One time that the run was begun or gone on with."""

    home: str
    """Its folder, such as `sessions/1`."""
    edf: str
    """Name of the EDF in the bundle."""
    definitions: Definitions
    given: TrialDefinitions
    """What the experiment says of trials, for each instance of a service."""
    design: Design
    places: Mapping[str, int]
    """Trial -> its place in the design's order, counted from 1."""
    choice: Choice
    """What was to be placed, as far as the record tells."""
    assignment: Mapping[str, str]
    """Service -> robot."""

    @property
    def services(self) -> dict[str, str]:
        """Service of each trial -> its robot."""
        return {name: robot for name, robot in sorted(self.assignment.items()) if name not in self.given.settings.keep}


@dataclass(slots=True)
class Earlier:
    """What was read of the sessions before: one that follows is of the same definitions, or of much the same."""

    definitions: dict[str, Definitions] = field(default_factory=dict)
    """Hash of all that they were read from -> they."""
    pairs: int = 0
    """Of services and robots, of all sessions: of each pair is found out whether it can be."""

    def read(self, files: Files, home: str, folder: str, edf: str, variables: Sequence[str]) -> Definitions:
        """Return a session's definitions, which take these variables of the controller.

        Raises:
            NotThere: They cannot be read, or are further ones, of more than any run has.
        """
        about = "\0".join((_unpack(files, home, folder), edf.removeprefix(home), *variables))
        key = sha256(about.encode("utf-8", "surrogatepass")).hexdigest()
        if key not in self.definitions:
            if len(self.definitions) >= _MOST_DEFINITIONS:
                raise NotThere(f"its sessions are of more than {_MOST_DEFINITIONS} experiments that differ")
            self.definitions[key] = _definitions(folder, edf, dict.fromkeys(variables, ""))
        return self.definitions[key]

    def count(self, services: int, robots: int) -> None:
        """Count pairs.

        Raises:
            NotThere: They are more than any run has.
        """
        self.pairs += services * robots
        if self.pairs > _MOST_PAIRS:
            raise NotThere(f"its sessions have more than {_MOST_PAIRS} pairs of services and robots together")


def read_session(files: Files, home: str, folder: str, earlier: Earlier) -> Session:
    """Read a session; its input files are written below `folder`.

    Raises:
        NotThere: Something is missing, or is not what a run writes.
    """
    about = json_of(files, f"{home}/inputs.json")
    edf = f"{home}/{string(about.get('edf'))}"
    if edf not in files.sizes or not edf.startswith(f"{home}/inputs/"):
        raise NotThere(f"{home}/inputs.json names no EDF that is there")
    definitions = earlier.read(files, home, folder, edf, strings(about.get("variables")))
    choice = _choice(files, home, folder, definitions)
    earlier.count(len(choice.experiment.services), len(choice.problem.robots))
    try:
        given = with_instances(choice.experiment)
        made = design(given)
    except SrprovError as error:
        raise NotThere(f"its trials cannot be read: {error.message}") from None
    assignment = _assignment(files, home)
    return Session(
        home=home,
        edf=edf,
        definitions=definitions,
        given=given,
        design=made,
        places={trial.id: place for place, trial in enumerate(made.trials, start=1)},
        choice=choice,
        assignment=assignment,
    )


def _assignment(files: Files, home: str) -> dict[str, str]:
    """Return service -> robot. A run has logs by the names of both, and a replay has those of the bundle.

    Raises:
        NotThere: One cannot be the name of a service, or of a robot.
    """
    found = string_map(json_of(files, f"{home}/assignment.json").get("assignment"))
    for service, robot in found.items():
        if wrong := names.fault("service", service) or names.fault("robot", robot):
            raise NotThere(f"{home}/assignment.json: {wrong}")
    return found


def again(one: Session, home: str) -> Session:
    """Return a session of which another one follows from the same files."""
    return replace(one, home=home, edf=one.edf.replace(one.home, home, 1))


def follows_from(files: Files, home: str) -> tuple[bytes, ...]:
    """Return what a session follows from."""
    names = ("inputs.json", "assignment.json", "facts.json", "inputs/inventory.yml")
    return tuple(content(files, f"{home}/{name}", MOST_JSON) for name in names)


def _unpack(files: Files, home: str, folder: str) -> str:
    """Write the input files of a session into a folder; return a hash of all but the inventory.

    Raises:
        NotThere: They are more than an experiment has, or have names that no folder can have.
        UsageError: There is no room, or the like.
    """
    try:
        return _write(files, home, folder)
    except OSError as error:
        if error.errno in _NO_NAME:
            raise NotThere(f"{home}/inputs {_STRANGE}") from None
        raise UsageError(f"{error.filename or folder}: {error.strerror}", code=Code.CANNOT_WRITE) from error


def _write(files: Files, home: str, folder: str) -> str:
    made = sha256()
    every = below(files, f"{home}/inputs/")
    if len(every) > _MOST_INPUT_FILES or sum(files.sizes[name] for name in every) > _MOST_INPUTS:
        raise NotThere(f"{home}/inputs holds more than an experiment has")
    deep = [name.count("/") for name in (*every, *data_sets(files, home))]
    if max(deep, default=0) > _DEEPEST or sum(deep) > _MOST_FOLDERS:  # each is made, and removed folder by folder
        raise NotThere(f"{home}/inputs {_STRANGE}")
    for name in every:
        place = Path(folder, name)
        private.make_folder(place.parent)
        text = content(files, name, _MOST_INPUTS)
        if name == f"{home}/inputs/{_INVENTORY}":  # nobody is reached, and an unnamed inventory may not say how
            place = Path(folder, home, _INVENTORY)  # nothing is read with it that the experiment ships
            text = in_lines(without_access(json_of(files, name))).replace("#", r"\u0023").encode()
        else:
            made.update(f"{len(text)} {name.removeprefix(home)}\0".encode())
            made.update(text)
        private.write_output(str(place), text)
    for one in data_sets(files, home):  # definitions must find it; nobody reads it
        place = Path(folder, home, "inputs", one)
        private.make_folder(place.parent)
        private.write_output(str(place), b"")
        made.update(f"data {one}\0".encode())
    return made.hexdigest()


def data_sets(files: Files, home: str) -> dict[str, str]:
    """Return the places of a session's data sets below its inputs -> their sha256: they are not kept.

    Raises:
        NotThere: One is no place there, or would say whose experiment it is.
    """
    found = {}
    for one in mappings(json_of(files, f"{home}/inputs.json").get("files"), most=_MOST_INPUT_FILES):
        if place := string(one.get("data")):
            if not place.startswith("inputs/") or os.path.normpath(place) != place or "\0" in place:
                raise NotThere(f"{home}/inputs.json has a data set of no place: {place[:200]}")
            if repository_in(place.split("/"), folder=False) is not None:  # a folder to replay in may have it already
                raise NotThere(f"{home}/inputs.json has a data set that would make a repository: {place[:200]}")
            if f"{home}/{place}" in files.sizes:  # what was looked at would be empty, and what is run the file
                raise NotThere(f"{home}/inputs.json has a data set in the place of a file: {place[:200]}")
            found[place.removeprefix("inputs/")] = string(one.get("sha256"))
    return found


def _definitions(folder: str, edf: str, environ: Mapping[str, str]) -> Definitions:
    try:
        found = load_experiment(os.path.join(folder, edf), environ, home=folder)
    except DefinitionError as error:
        first = error.problems[0]
        where = os.path.basename(first.location.file)
        raise NotThere(f"the definitions cannot be read: {where}: {first.message}") from None
    for file in found.experiment.files:  # also what a CDF extends: nothing may be told of this machine's files
        if not Path(file).is_relative_to(folder):
            raise NotThere(f"a file of it is named by a path that only one machine has: {file[:200]}")
    return found


def _choice(files: Files, home: str, folder: str, definitions: Definitions) -> Choice:
    """Return what was to be placed, from the facts and the inventory of a session."""
    document = json_of(files, f"{home}/facts.json")
    try:
        path = os.path.join(folder, home, _INVENTORY)
        inventory = load_inventory([path], unnamed=[path])
        found = read_document(document)
        hosts = inventory.hosts
        facts = {name: with_inventory(hosts[name], one) for name, one in found.facts.items() if name in hosts}
        away = {name: found.unreachable.get(name, "not in the facts") for name in hosts if name not in facts}
        snapshot = replace(found, facts=facts, observed={name: () for name in facts}, unreachable=away)
        before, request = read_decided(document.get("decided"), PlanRequest())
        return checked_choice(definitions, inventory, snapshot, request, before)
    except SrprovError as error:
        raise NotThere(f"the record of the robots cannot be read: {error.message}") from None
