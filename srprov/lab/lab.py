"""The whole lab: `up` makes it from whatever is there, `down` leaves nothing, `status` looks.

Nothing is assumed about how the last command ended. What exists is found by name (cgroups, links,
folders), compared with what is wanted, and only the difference is done.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Sequence, Set
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from srprov.errors import UsageError
from srprov.lab import (
    cgroups,
    disk,
    faults,
    images,
    inventory,
    machine,
    members,
    network,
    partition,
    places,
    registry,
    robot,
    spec,
    state,
)
from srprov.lab.machine import run

Say = Callable[[str], None]


@dataclass(frozen=True)
class Wanted:
    """What the user asked of `lab up`; None and empty: as it was, or the default."""

    count: int | None = None
    spec_text: str | None = None
    spec_file: str = "lab-spec.yml"
    user: str | None = None


@dataclass(frozen=True)
class Seen:
    """A robot as `status` finds it."""

    name: str
    address: str
    state: str
    """`ready`, `booting` or `dead`."""
    memory: int | None
    """Bytes that its processes hold."""
    pid: int | None
    faults: tuple[str, ...] = ()
    """What was broken on purpose since it was booted, e.g. `cut off from all`, `docker stopped`."""


def up(wanted: Wanted, say: Say) -> list[str]:
    """Make the lab as wanted; gives the names of the robots that had to be booted."""
    machine.require_root()
    machine.require(machine.PACKAGES)
    machine.require_plain_root()
    with state.locked():
        lab, robots = _decide(wanted, state.read_lab(), say)
        storage = images.ensure(say)
        changed = network.ensure()
        lab = replace(lab, kernel_before={**changed, **lab.kernel_before})
        state.write_lab(lab)
        _make_key()
        registry.ensure(storage)
        _remove_surplus({each.name for each in robots}, say)
        booted = _boot_missing(robots, say)
        faults.undo([each for each in robots if each.name not in booted], say)
        robot.await_ready(robots)
        _write_inventory(lab, robots)
    return booted


def _decide(wanted: Wanted, before: state.Lab | None, say: Say) -> tuple[state.Lab, list[spec.Robot]]:
    """The lab and its robots, from what is asked for now and what was before."""
    if before is not None and wanted.count is None and wanted.spec_text is None:
        source, file = before.spec, str(before.spec["file"])
    else:
        source = {"text": wanted.spec_text or "", "file": wanted.spec_file, "count": wanted.count}
        file = wanted.spec_file
    parsed = spec.parse(source["text"], file)
    count = source["count"] or parsed.count or max(spec.DEFAULT_COUNT, parsed.least)
    if count < parsed.least:
        raise UsageError(f"-n {count}, but robot{parsed.least} has options in {file}", hint="raise -n")
    robots = parsed.build(count)
    user = wanted.user or (before.user if before is not None and source is before.spec else None)
    target = str(places.INVENTORY.absolute())
    known = before.inventories if before else ()
    lab = state.Lab(
        spec=source,
        user=user,
        kernel_before=before.kernel_before if before else {},
        inventories=tuple(sorted({*known, target})),
    )
    if machine.find("sudo") is None and any(inventory.user_of(each, user) == "robot" for each in robots):
        say("sudo is not installed here: on the robots, the user robot cannot become root")
    return lab, robots


def _make_key() -> None:
    if not places.KEY.exists():
        draft = places.KEY.with_suffix(".new")
        draft.unlink(missing_ok=True)
        run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", places.TAG, "-f", str(draft)])
        draft.with_name(draft.name + ".pub").replace(places.KEY.with_suffix(".pub"))
        draft.replace(places.KEY)  # last: it says that both are there


def _existing() -> set[str]:
    """Every robot that there is any trace of."""
    disks = {path.name for path in places.DISKS.glob("*/")}
    return {name for name in disks | cgroups.robots() if places.robot_number(name)}


def _remove_surplus(wanted: set[str], say: Say) -> None:
    surplus = sorted(_existing() - wanted)
    if surplus:
        say(f"removing {', '.join(surplus)}")
        _each(robot.remove, surplus)


def _boot_missing(robots: Sequence[spec.Robot], say: Say) -> list[str]:
    """Boot the robots that are dead, or were booted with other options."""
    missing = []
    for each in robots:
        alive = state.read_robot(each.name)
        if alive is None or alive.options != each.boot_digest:
            missing.append(each)
    if missing:
        say(f"booting {len(missing)} robot{'s' if len(missing) > 1 else ''}")
        _each(robot.kill, [each.name for each in missing])
        _each(disk.prepare, missing)
        robot.go(robot.power_on(missing))
    return [each.name for each in missing]


def _write_inventory(lab: state.Lab, robots: Sequence[spec.Robot]) -> None:
    keys = {each.name: disk.host_key(each.name) for each in robots}
    _write_if_other(places.KNOWN_HOSTS, inventory.known_hosts(keys))
    for path in lab.inventories:
        if Path(path) == places.INVENTORY.absolute() or Path(path).exists():
            _write_if_other(Path(path), inventory.as_text(robots, lab.user))


def _write_if_other(path: Path, text: str) -> None:
    if not path.exists() or path.read_text() != text:
        path.parent.mkdir(parents=True, exist_ok=True)
        draft = path.with_name(f".{path.name}.new")
        draft.write_text(text)
        draft.replace(path)


def down(say: Say) -> bool:
    """Remove the lab and all that a killed run may have left; False when there was nothing."""
    machine.require_root()
    existing = _existing()
    if not (places.RUN.exists() or existing or cgroups.robots()):
        network.remove({})
        return False
    with state.locked():
        lab = state.read_lab()
        say(f"removing the lab ({len(existing)} robots)")
        _each(robot.remove, sorted(existing))
        registry.remove()
        network.remove(lab.kernel_before if lab else {})
        for path in map(Path, lab.inventories if lab else ()):
            if path.exists() and path.read_text().startswith(inventory.HEADER):
                path.unlink()
        shutil.rmtree(places.DISKS, ignore_errors=True)
        shutil.rmtree(places.RUN, ignore_errors=True)
    return True


def status() -> list[Seen]:
    """The robots of the lab in the order of their numbers; none when it is down."""
    lab = state.read_lab()
    if lab is None:
        return []
    cuts = partition.in_force()
    return [_look(each, cuts) for each in members.of(lab)]


def _look(each: spec.Robot, cuts: Set[partition.Rule]) -> Seen:
    where = str(places.address(each.name))
    booted = state.read_robot(each.name)
    if booted is None:
        return Seen(each.name, where, "dead", None, None, faults.cuts_of(each.name, cuts))
    ready = robot.is_ready(each, booted.init.pid, cuts)
    return Seen(
        each.name,
        where,
        "ready" if ready else "booting",
        cgroups.memory(each.name),
        booted.init.pid,
        (*faults.cuts_of(each.name, cuts), *faults.of_engine(each, booted.init.pid)),
    )


def kill(name: str) -> None:
    """End one robot as by power loss; it stays a member of the lab."""
    machine.require_root()
    with state.locked():
        robot.kill(members.one(name).name)


def restart(name: str) -> None:
    """Boot one robot again, from dead or alive, with its disk kept; returns when it is ready."""
    machine.require_root()
    with state.locked():
        each = members.one(name)
        robot.kill(each.name)
        disk.prepare(each)
        robot.go(robot.power_on([each]))
        robot.await_ready([each])


def shell(name: str, command: Sequence[str]) -> list[str]:
    """The program that runs `command` in the robot, for the caller to execute."""
    machine.require_root()
    return robot.enter(members.one(name).name, command)


def _each(act: Callable[[Any], None], items: Sequence[Any]) -> None:
    """Do it for all of them, some at a time; the first error counts, after all have ended."""
    with ThreadPoolExecutor(max_workers=4 * (os.cpu_count() or 1)) as pool:
        for done in [pool.submit(act, item) for item in items]:
            done.result()
