"""A whole lab, by its name: `up` makes it from whatever is there, `down` leaves nothing.

Nothing is assumed about how the last command ended. What exists is found by name (cgroups, links,
folders), compared with what is wanted, and only the difference is done.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime, timezone
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from srprov import regular_file
from srprov.codes import Code
from srprov.errors import LabError, UsageError
from srprov.lab import (
    arm64,
    cgroups,
    disk,
    faults,
    images,
    inventory,
    machine,
    members,
    network,
    registry,
    robot,
    sites,
    spec,
    state,
    written,
)
from srprov.lab.machine import run
from srprov.lab.places import Site, robot_number

Say = Callable[[str], None]


class Wanted(msgspec.Struct, frozen=True):
    """What the user asked of `lab up`; None and empty: as it was, or the default."""

    count: int | None = None
    spec_text: str | None = None
    spec_file: str = "lab-spec.yml"
    user: str | None = None


def up(name: str, wanted: Wanted, say: Say) -> list[str]:
    """Make the lab as wanted; return the names of the robots that had to be booted."""
    machine.require_root()
    machine.require(machine.PACKAGES)
    machine.require_plain_root()
    with state.locked(Site(name, None).run):
        before = state.read_lab(Site(name, None))
        lab, robots = _decide(Site(name, None), wanted, before, say)
        foreign = any(arm64.is_simulated(each) for each in robots)
        if foreign:
            machine.require(arm64.PACKAGES)
        if any(each.systemd for each in robots):
            machine.require({"systemctl": "systemd"})
        storage = images.ensure(registry.storages(sites.every()), say, foreign=foreign)
        site = sites.claim(name)
        network.ensure(site, robots)
        text = inventory.as_text(site, robots, lab.user)
        state.write_lab(site, msgspec.structs.replace(lab, written=written.digest(text)))
        _make_key(site)
        registry.ensure(site, storage)
        _remove_surplus(site, {each.name for each in robots}, say)
        booted = _boot_missing(site, robots, say)
        faults.undo(site, [each for each in robots if each.name not in booted], say)
        robot.await_ready(site, robots)
        _write_inventory(site, lab, robots)
    return booted


def _decide(site: Site, wanted: Wanted, before: state.Lab | None, say: Say) -> tuple[state.Lab, list[spec.Robot]]:
    """The lab and its robots, from what is asked for now and what was before."""
    if before is not None and wanted.count is None and wanted.spec_text is None:
        source, file = before.spec, str(before.spec["file"])
    else:
        source = {"text": wanted.spec_text or "", "file": wanted.spec_file, "count": wanted.count}
        file = wanted.spec_file
    parsed = spec.parse(source["text"], file)
    count = source["count"] or parsed.count or max(spec.DEFAULT_COUNT, parsed.least)
    if count < parsed.least:
        raise UsageError(
            f"-n {count}, but robot{parsed.least} has options in {file}", hint="raise -n", code=Code.OPTIONS
        )
    robots = parsed.build(count)
    user = wanted.user or (before.user if before is not None and source is before.spec else None)
    target = _place_of_inventory(site)
    known = before.inventories if before else ()
    lab = state.Lab(
        spec=source,
        user=user,
        since=before.since if before else datetime.now(timezone.utc).isoformat(timespec="seconds"),
        inventories=tuple(sorted({*known, target})),
    )
    if machine.find("sudo") is None and any(inventory.user_of(each, user) == "robot" for each in robots):
        say("sudo is not installed here: on the robots, the user robot cannot become root")
    return lab, robots


def _place_of_inventory(site: Site) -> str:
    """Return where the inventory goes: its user names it with `-i`, so nothing of a stranger's may be read with it."""
    if there := regular_file.variables_beside(site.inventory.parent):
        raise LabError(
            f"{os.path.relpath(there)} would be read with the lab's inventory, and may be a stranger's",
            hint="go to another folder",
            code=Code.LAB_MACHINE,
        )
    path = site.inventory.absolute()
    if path.is_file() and not path.is_symlink() and not written.has_header(path):
        message = f"{os.path.relpath(path)} is not what `srprov lab up` wrote"
        raise LabError(message, hint="give it another name, or remove it", code=Code.LAB_MACHINE)
    return str(path)


def _make_key(site: Site) -> None:
    if not site.key.exists():
        draft = site.key.with_suffix(".new")
        draft.unlink(missing_ok=True)
        run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", site.tag, "-f", str(draft)])
        draft.with_name(draft.name + ".pub").replace(site.key.with_suffix(".pub"))
        draft.replace(site.key)  # last: it says that both are there


def _existing(site: Site) -> set[str]:
    """Every robot that there is any trace of."""
    disks = {path.name for path in site.disks.glob("*/")}
    return {name for name in disks | cgroups.robots(site) if robot_number(name)}


def _remove_surplus(site: Site, wanted: set[str], say: Say) -> None:
    surplus = sorted(_existing(site) - wanted)
    if surplus:
        say(f"removing {', '.join(surplus)}")
        _each(partial(robot.remove, site), surplus)


def _boot_missing(site: Site, robots: Sequence[spec.Robot], say: Say) -> list[str]:
    """Boot the robots that are dead, or were booted with other options."""
    missing = []
    for each in robots:
        alive = state.read_robot(site, each.name)
        if alive is None or alive.options != each.boot_digest:
            missing.append(each)
    if missing:
        say(f"booting {len(missing)} robot{'s' if len(missing) > 1 else ''}")
        _each(partial(robot.kill, site), [each.name for each in missing])
        _each(partial(disk.prepare, site), missing)
        robot.go(site, robot.power_on(site, missing))
    return [each.name for each in missing]


def _write_inventory(site: Site, lab: state.Lab, robots: Sequence[spec.Robot]) -> None:
    keys = {each: disk.host_key(site, each.name) for each in robots}
    _write_if_other(site.known_hosts, inventory.known_hosts(site, keys))
    for path in map(Path, lab.inventories):
        # of folders of before, only what is the lab's by now: they may be others, or elsewhere
        if path == site.inventory.absolute() or (written.lies_there(path) and written.has_header(path)):
            _write_if_other(path, inventory.as_text(site, robots, lab.user))


def _write_if_other(path: Path, text: str) -> None:
    """Write a file, as root, into a folder that may be a stranger's: through no link, over nothing but its own name."""
    if not written.lies_there(path):
        raise LabError(
            f"{path.parent} is a link to another folder, or lies below one",
            hint="remove it, or go to another folder",
            code=Code.LAB_MACHINE,
        )
    try:
        if regular_file.read_text(path) == text:
            return
    except FileNotFoundError:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LabError(f"{path} cannot be read: {error.strerror}", hint="remove it", code=Code.LAB_MACHINE) from None
    descriptor, draft = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    with open(descriptor, "w", encoding="utf-8") as stream:
        os.fchmod(descriptor, 0o644)  # whoever called sudo reads it
        stream.write(text)
    os.replace(draft, path)


def down(name: str, say: Say) -> bool:
    """Remove the lab and all that a killed run may have left; False when there was nothing."""
    machine.require_root()
    site = Site(name, None)
    if not (site.run.exists() or _existing(site) or cgroups.robots(site)):
        return False
    with state.locked(site.run):
        lab = state.read_lab(site)
        site = sites.claim(name)  # what is left may have lost its number
        existing = _existing(site)
        say(f"removing {site.title} ({len(existing)} robots)")
        _each(partial(robot.remove, site), sorted(existing))
        registry.remove(site)
        network.remove(site)
        for path in map(Path, lab.inventories if lab else ()):
            with contextlib.suppress(OSError):  # gone, or no file
                if written.lies_there(path) and written.has_header(path):
                    path.unlink()
        sites.release(site)
    return True


def kill(name: str, robot_name: str) -> None:
    """End one robot as by power loss; it stays a member of the lab."""
    machine.require_root()
    site = sites.find(name)
    with members.changing(site):
        robot.kill(site, members.one(site, robot_name).name)


def restart(name: str, robot_name: str) -> None:
    """Boot one robot again, from dead or alive, with its disk kept; returns when it is ready."""
    machine.require_root()
    site = sites.find(name)
    with members.changing(site):
        each = members.one(site, robot_name)
        robot.kill(site, each.name)
        disk.prepare(site, each)
        robot.go(site, robot.power_on(site, [each]))
        robot.await_ready(site, [each])


def shell(name: str, robot_name: str, command: Sequence[str]) -> list[str]:
    """Return the program that runs `command` in the robot, for the caller to execute."""
    machine.require_root()
    site = sites.find(name)
    return robot.enter(site, members.one(site, robot_name).name, command)


def _each(act: Callable[[Any], None], items: Sequence[Any]) -> None:
    """Do it for all of them, some at a time; the first error counts, after all have ended."""
    with ThreadPoolExecutor(max_workers=4 * (os.cpu_count() or 1)) as pool:
        for done in [pool.submit(act, item) for item in items]:
            done.result()
