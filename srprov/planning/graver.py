"""What a permission gives away beyond its name: which values of it make a container as good as root on a robot. Pure.

Source: capabilities(7), ptrace(2) ("Ptrace access mode checking"), the kernel's list of devices.
"""

from __future__ import annotations

import re

EVERY_PROCESS = "as good as root where anybody but root runs something; it reads what other containers hold"
"""A container may be any user, and whose processes have no more capabilities than it has, it reads the files of."""
_AS_ROOT = "as good as root on the robot"
_CAPABILITIES = frozenset({"ALL", "SYS_ADMIN", "SYS_MODULE", "SYS_RAWIO", "SYS_BOOT", "DAC_READ_SEARCH"})
_ORDINARY = frozenset(
    {
        *("AUDIT_WRITE", "CHOWN", "DAC_OVERRIDE", "FOWNER", "FSETID", "KILL", "MKNOD", "NET_BIND_SERVICE", "NET_RAW"),
        *("SETFCAP", "SETGID", "SETPCAP", "SETUID", "SYS_CHROOT"),
        *("BLOCK_SUSPEND", "IPC_LOCK", "IPC_OWNER", "LEASE", "LINUX_IMMUTABLE", "NET_ADMIN", "NET_BROADCAST"),
        *("SYSLOG", "SYS_NICE", "SYS_PACCT", "SYS_PTRACE", "SYS_RESOURCE", "SYS_TIME", "SYS_TTY_CONFIG", "WAKE_ALARM"),
    }
)
"""Docker's own, and those that end at the container's namespaces or at a robot's clock, logs and scheduling.

BPF and PERFMON read the kernel's memory; what a kernel yet to come has is not known.
"""
_DISK = re.compile(
    r"/dev/((sd|hd|vd|xvd)[a-z]+[0-9]*\Z|(nvme|mmcblk|dm-|md|mtd|mtdblock|ubi|ubiblock|loop|nbd|zram|sg)[0-9]"
    r"|(mapper|disk|block|bsg|md)(/|\Z)|root\Z)"
)
_A_DISK = f"a disk: {_AS_ROOT}, if it is the robot's own"
_KEYS = re.compile(r"/dev/(mem|kmem|port|uinput)\Z|/dev/vfio(/|\Z)")
"""Memory, keys that are typed for whoever is logged in at the robot, and cards that write to its memory."""
_BY_NUMBER = re.compile(r"[ab] |c (\*|1|10|21|90):")
"""Rules for them, which a container can make a device of by itself; 21 and 90 are disks as characters."""


def noted(what: str, note: str) -> str:
    """Return what is asked for, with a note behind it where there is one."""
    return f"{what} ({note})" if note else what


def of_capability(name: str) -> str:
    """Return why a capability is more than it looks, or nothing."""
    plain = name.removeprefix("CAP_")
    return _AS_ROOT if plain in _CAPABILITIES else "" if plain in _ORDINARY else f"may be {_AS_ROOT}"


def of_device(path: str) -> str:
    """Return why a device, by its path in one spelling, is more than it looks, or nothing."""
    return _A_DISK if _DISK.match(path) else f"may be {_AS_ROOT}" if _KEYS.match(path) else ""


def of_rule(rule: str) -> str:
    """Return why a rule of a device cgroup is more than it looks, or nothing."""
    return f"disks, memory or keys: {_AS_ROOT}" if _BY_NUMBER.match(rule) else ""
