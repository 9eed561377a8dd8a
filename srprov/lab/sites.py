"""Which labs there are on this machine, and what they share: numbers, and settings of the kernel.

A lab's number makes its bridge and its addresses. It is noted in the lab's folder in /run from the
first `up` to `down`, so two labs never have the same one. Settings are changed with the first lab
and set back with the last.
"""

from __future__ import annotations

import contextlib
import shutil
from pathlib import Path

from srprov import trees
from srprov.codes import Code
from srprov.errors import LabError
from srprov.lab import arm64, cgroups, network, state
from srprov.lab.machine import write_setting
from srprov.lab.places import LANS, MOST_NUMBER, NAMED_RUN, Site, subnet

SETTINGS = {Path("/proc/sys/net/ipv4/ip_forward"): "1"}
NUMBER = "number.json"
"""Below a lab's folder in /run: it says that the lab is there, and which number it has."""
MACHINE = NAMED_RUN / ".machine"
"""Beside the folders of labs with names, none of which begins with a dot."""
BEFORE = MACHINE / "settings.json"
"""Setting -> value before the first lab."""


def find(name: str) -> Site:
    """Return the lab of that name; without a number if it has a name and is down."""
    found = state.read(NAMED_RUN / name / NUMBER) if name else {"number": 0}
    return Site(name, found["number"] if found else None)


def every() -> list[Site]:
    """Return the labs that are up, by number."""
    named = [find(path.parent.name) for path in NAMED_RUN.glob(f"*/{NUMBER}")]
    default = [Site()] if (Site().run / NUMBER).exists() else []
    return default + sorted(named, key=lambda site: site.number or 0)


def claim(name: str) -> Site:
    """Give a lab its number and its cgroups, and set what all labs need; to be done with the lab's lock.

    Raises:
        LabError: No subnet is free.
    """
    with state.locked(MACHINE):
        site = find(name)
        if site.number is None:
            site = Site(name, _free_number())
        state.write(site.run / NUMBER, {"number": site.number})
        cgroups.make(site)
        known = state.read(BEFORE) or {}
        changed = {str(path): path.read_text().strip() for path, value in SETTINGS.items()}
        state.write(BEFORE, {**changed, **known})  # before anything is changed: a killed run is undone too
        for path, value in SETTINGS.items():
            write_setting(path, value)
    return site


def _free_number() -> int:
    taken = {site.number for site in every()}
    for number in range(1, MOST_NUMBER + 1):
        if number not in taken and all(network.in_use(subnet(number, lan)) is None for lan in LANS):
            return number
    what = f"no subnet from {subnet(1)} to {subnet(MOST_NUMBER)} is free here"
    raise LabError(what, hint="see `srprov lab list` and `ip route`; take a lab or a route away", code=Code.LAB_MACHINE)


def release(site: Site) -> None:
    """Forget a lab of which nothing is left but its number; with the last one, set the settings back."""
    with state.locked(MACHINE):
        cgroups.remove_all(site)
        trees.remove(site.disks)
        trees.remove(site.run)
        if site.name:
            _remove_empty(site.disks.parent)
        if not every():
            for path, value in (state.read(BEFORE) or {}).items():
                write_setting(Path(path), value)
            arm64.forget()
            shutil.rmtree(MACHINE)
            _remove_empty(NAMED_RUN)


def _remove_empty(folder: Path) -> None:
    """Remove a folder, unless another lab has something there."""
    with contextlib.suppress(OSError):
        folder.rmdir()
