"""A bundle -> what is needed to run it again on other robots: its definitions in a folder, and who does whose part.

Nothing of a bundle is believed: it was verified before, what is read has the hashes that were verified, and what its
experiment asks for is allowed by who runs it, as that of any other file of a stranger.
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
from msgspec.structs import replace

from srprov import believed, private, regular_file
from srprov.codes import Code
from srprov.definitions.model import BUILDERS, Host, Inventory, repository_in
from srprov.errors import RefusedError, UsageError, did_you_mean
from srprov.evidence import story, verify
from srprov.evidence.compare_inputs import facts_of
from srprov.evidence.files import MOST_TEXT, Files, below, content, json_of
from srprov.evidence.session import data_sets
from srprov.evidence.story import Story
from srprov.evidence.verified import Bundle, reopened
from srprov.facts.model import Snapshot
from srprov.untrusted import mapping, string
from srprov.whose import others_may_write

_INVENTORY = "inventory.yml"
_NO_PART = "(a robot without a part)"
"""No robot of an inventory can be called so."""


class Needed(msgspec.Struct, frozen=True, kw_only=True):
    """What a robot must have for its services, as their definitions ask for it."""

    tags: tuple[str, ...]
    devices: tuple[str, ...]
    """Those of `requires`, and those that containers are given."""
    arch: str
    """Docker's name of what it was."""


class Replay(msgspec.Struct, frozen=True, kw_only=True):
    """What is run again."""

    edf: str
    """Its name in the folder where the bundle's definitions are unpacked."""
    placed: Mapping[str, str]
    """Service -> robot, as the bundle names it."""
    facts: Mapping[str, Any]
    """Robot -> what it was like then."""
    needs: Mapping[str, Needed] = msgspec.field(default_factory=dict)
    """Robot that did something -> what it needs for that."""

    @property
    def robots(self) -> tuple[str, ...]:
        """Return the robots that did something, by name."""
        return tuple(sorted(set(self.placed.values())))


def check(bundle: str, signers: str = "") -> Bundle:
    """Return a bundle to be read, which is what it says.

    Raises:
        RefusedError: With the checks that failed.
        UsageError: It is no bundle.
    """
    report = verify.verify(bundle, signers)
    if report.failed:
        failed = [f"  {one.id} {one.what}: {one.details[0]}" for one in report.findings if one.result == "fail"]
        told = "\n".join(failed)
        raise RefusedError(
            f"{bundle} is not what it says:\n{told}",
            hint=f"srprov verify {shlex.quote(str(bundle))} says more",
            code=Code.BUNDLE_FALSE,
        )
    return Bundle(bundle, report.hashes, signed=bool(signers))


def read(bundle: Bundle) -> Replay:
    """Read what a bundle's last session was.

    Raises:
        UsageError: It holds no run.
    """
    with _opened(bundle) as (files, told):
        facts = mapping(json_of(files, f"{told.home}/facts.json").get("robots"))
        edf = told.edf.removeprefix(f"{told.home}/inputs/")
        placed = dict(told.last.assignment)
        needs = {robot: _needed(told, robot, facts) for robot in sorted(set(placed.values()))}
        return Replay(edf=edf, placed=placed, facts=facts, needs=needs)


def _needed(told: Story, robot: str, facts: Mapping[str, Any]) -> Needed:
    every = told.last.choice.experiment.services
    services = [every[name] for name, other in sorted(told.last.assignment.items()) if other == robot and name in every]
    tags = {tag for one in services for tag in one.requires.tags}
    devices = {path for one in services for path in one.requires.devices}
    devices |= {path for one in services for path, _, _ in one.runtime.devices}
    arch = string(mapping(facts.get(robot)).get("arch"))
    return Needed(tags=tuple(sorted(tags)), devices=tuple(sorted(devices)), arch=arch)


def unpack(bundle: Bundle, folder: Path, first: Callable[[], None] = lambda: None) -> None:
    """Write the definitions of a bundle's last session into a folder, which is new, or has just them already.

    Before the first of them is written, `first` is called; it is not where nothing is.

    Raises:
        UsageError: It holds no run, or something else is in the folder, or that cannot be written.
        RefusedError: Others could put a link into it while it is filled; or it is signed, and they could put other
            definitions there before they are read.
    """
    with _opened(bundle) as (files, told):
        home = f"{told.home}/inputs/"
        names = [name for name in below(files, home) if name != home + _INVENTORY]
        if strange := next((one for one in names if repository_in(one.split("/"), folder=False) is not None), ""):
            what = f"{bundle.path} holds {strange.removeprefix(home)}"
            why = f"{what}: a repository would say whose experiment it is, or name programs"
            raise UsageError(why, hint="ask its author for one without it", code=Code.REPLAY)
        contents = {folder / name.removeprefix(home): content(files, name) for name in names}
        absent = {folder / one for one in data_sets(files, told.home)}
    try:
        _fill(folder, contents, absent, first)
        alone = not bundle.signed or all(map(believed.is_closed, {folder, *(one.parent for one in contents)}))
    except OSError as error:
        why = f"{error.filename or folder}: {error.strerror or error}"
        raise UsageError(why, hint="name another folder with -o", code=Code.CANNOT_WRITE) from error
    if not alone:
        raise _others(folder, "what was signed could be replaced, or added to, there")


def _fill(
    folder: Path, contents: Mapping[Path, bytes], absent: Collection[Path], first: Callable[[], None]
) -> None:  # fmt: skip
    """Write files into a folder that has none; it is the same folder from its first file to its last."""
    if folder.is_symlink():
        raise _in_the_way(folder)
    private.make_folder(folder)
    real = Path(os.path.realpath(folder))
    with regular_file.real_folder(real) as opened:
        there = _read(real, {real / one.relative_to(folder) for one in absent})
        if there == {real / one.relative_to(folder): data for one, data in contents.items()}:
            return
        if there:
            raise _in_the_way(folder)
        if others_may_write(real, os.fstat(opened)):
            raise _others(folder, "a link of theirs could lead what is written elsewhere")
        first()
        for place, data in contents.items():
            new = Path(f"/proc/self/fd/{opened}", place.relative_to(folder))
            private.make_folder(new.parent)
            private.write_output(str(new), data)


def _in_the_way(folder: Path) -> UsageError:
    return UsageError(f"something else is in {folder}", hint="name a new folder with -o", code=Code.IN_THE_WAY)


def _others(folder: Path, why: str) -> RefusedError:
    told = f"others can write to {folder}, or to a folder above or below it: {why}"
    return RefusedError(told, hint="name a folder of your own with -o", code=Code.STRANGE_FILE)


@contextmanager
def _opened(bundle: Bundle) -> Iterator[tuple[Files, Story]]:
    try:
        with reopened(bundle) as files, story.read(files) as told:
            yield files, told
    except ValueError as error:
        hint = f"srprov verify {shlex.quote(str(bundle.path))} says more"
        raise UsageError(f"{bundle.path} cannot be run again: {error}", hint=hint, code=Code.REPLAY) from error


def _read(folder: Path, but: Collection[Path]) -> dict[Path, bytes]:
    """Return what is in a folder but for some files; of what is no file, nothing that is equal to one."""
    return {
        one: regular_file.read(one, MOST_TEXT, real=True) if one.is_file() and not one.is_symlink() else b"\0"
        for one in sorted(folder.rglob("*"))
        if one not in but and (one.is_symlink() or not one.is_dir())
    }


def mapped(inventory: Inventory, robots: Collection[str], asked: Mapping[str, str]) -> Inventory:
    """Return the robots of an inventory that do the parts of a bundle's, under the names of those.

    Args:
        inventory: The robots that there are.
        robots: Those of the bundle; one that is not asked for is done by the one of the same name.
        asked: Robot of the bundle -> robot of the inventory.

    Raises:
        UsageError: A name is of no robot, two parts would be one robot's, or a robot's part is nobody's.
    """
    for name in asked:
        if name not in robots:
            raise UsageError(
                f"--map {name}: the bundle has no such robot",
                hint=f"it has {', '.join(sorted(robots))}",
                code=Code.REPLAY,
            )
    whose = {name: asked.get(name, name) for name in sorted(robots)}
    for name, new in whose.items():
        if new not in inventory.hosts:
            part = f"say who does the part of {name}"
            hint = did_you_mean(new, inventory.hosts) or f"{part}: --map {shlex.quote(name)}=ROBOT"
            raise UsageError(f"there is no robot {new} in the inventory", hint=hint, code=Code.REPLAY)
    twice = sorted(new for new in set(whose.values()) if list(whose.values()).count(new) > 1)
    if twice:
        raise UsageError(
            f"{twice[0]} would do the part of several robots", hint="each needs a robot of its own", code=Code.REPLAY
        )
    hosts: dict[str, Host] = {name: replace(inventory.hosts[new], name=name) for name, new in whose.items()}
    names = {new: name for name, new in whose.items()}
    groups = {
        group: tuple(sorted(names[one] for one in members if one in names))
        for group, members in inventory.groups.items()
    }
    if inventory.groups.get(BUILDERS) and not groups[BUILDERS]:
        groups[BUILDERS] = (_NO_PART,)  # else any robot would build for others
    return replace(inventory, hosts=hosts, groups=groups)


def differences(replay: Replay, asked: Mapping[str, str], snapshot: Snapshot) -> Iterator[str]:
    """Return a line for each robot: who does its part, and what is different of it."""
    for name in replay.robots:
        now = snapshot.facts.get(name)
        found = facts_of(mapping(replay.facts.get(name)), msgspec.to_builtins(now)) if now else ()
        told = [f"{key}: {was or 'unknown'}, and {is_ or 'unknown'}" for key, was, is_ in found]
        yield f"{name} is {asked.get(name, name)}: {'; '.join(told) or 'the same kind of machine'}"
