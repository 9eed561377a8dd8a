"""What a permission gives away beyond its name: which values of it make a container as good as root on a robot. Pure.

Source: capabilities(7), ptrace(2) ("Ptrace access mode checking"), the kernel's list of devices.
"""

from __future__ import annotations

import re

EVERY_PROCESS = "as good as root where anybody but root runs something; it reads what other containers hold"
"""A container may be any user, and whose processes have no more capabilities than it has, it reads the files of."""
_AS_ROOT = "as good as root on the robot"
_CAPABILITIES = frozenset({"ALL", "SYS_ADMIN", "SYS_MODULE", "SYS_RAWIO", "SYS_BOOT", "DAC_READ_SEARCH"})
_DISK = re.compile(
    r"/dev/((sd|hd|vd|xvd)[a-z]+[0-9]*\Z|(nvme|mmcblk|dm-|md|mtd|mtdblock|ubi|ubiblock|loop|nbd|zram|sg)[0-9]"
    r"|(mapper|disk|block|bsg|md)(/|\Z)|root\Z)"
)
_A_DISK = f"a disk: {_AS_ROOT}, if it is the robot's own"
_BY_NUMBER = re.compile(r"[ab] |c (\*|21|90):")
"""Rules for disks, which a container can make a device of by itself; 21 and 90 are disks as characters."""


def noted(what: str, note: str) -> str:
    """Return what is asked for, with a note behind it where there is one."""
    return f"{what} ({note})" if note else what


def of_capability(name: str) -> str:
    """Return why a capability is more than it looks, or nothing."""
    return _AS_ROOT if name.removeprefix("CAP_") in _CAPABILITIES else ""


def of_device(path: str) -> str:
    """Return why a device, by its path in one spelling, is more than it looks, or nothing."""
    return _A_DISK if _DISK.match(path) else ""


def of_rule(rule: str) -> str:
    """Return why a rule of a device cgroup is more than it looks, or nothing."""
    return f"any disk: {_AS_ROOT}" if _BY_NUMBER.match(rule) else ""
