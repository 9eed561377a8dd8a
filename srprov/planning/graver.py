"""What a permission gives away beyond its name: which values of it make a container as good as root on a robot. Pure.

Source: capabilities(7), ptrace(2) ("Ptrace access mode checking"), the kernel's list of devices.
"""

from __future__ import annotations

import re

EVERY_PROCESS = "as good as root where anybody but root runs something; it reads what other containers hold"
"""A container may be any user, and whose processes have no more capabilities than it has, it reads the files of."""
LISTENERS = "root's programs may do what they are told there: on the loopback, or by sockets that lie in no folder"
"""An engine that listens on 127.0.0.1, a debugger, an X server: they ask nobody who is on the robot itself."""
TOLD = "root's programs may do what they are told on the robot's loopback, and by sockets in any folder"
"""An engine that sends as root to an address of a stranger's is told by what answers there where to send it next."""
SHARED = "root may believe what is written to its shared memory, or do what a socket in it is told"
"""`/dev/shm` is a folder, too; ssh keeps connections to other hosts there where it is told so."""
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
A_DISK = f"a disk: {_AS_ROOT}, if it is the robot's own"
_KEYS = re.compile(
    r"/dev/(mem|kmem|port|uinput|uhid|hidraw[0-9]+|usbmon[0-9]+|console|tty[0-9]+|ng[0-9].*)\Z"
    r"|/dev/(vfio|bus)(/|\Z)|/dev/input(\Z|/(event|by-))"
)
"""Memory, keys that are typed at the robot, also as its USB sends them, cards that write to its memory, and raw USB."""
_BY_NUMBER = re.compile(r"[ab] |c (\*|0*(1|10|21|90)):")
"""Rules for them, which a container can make a device of by itself; 21 and 90 are disks as characters."""
_PARTS = frozenset({"29", "81", "89", "116", "153", "166", "180", "188", "195", "204", "226"})
"""Characters that are screens, cameras, I2C, sound, SPI, serial lines and graphics; source: the kernel's devices.txt.

A closed list: 4 are consoles, 13 keyboards, 189 raw USB with its disks, and from 234 on any kernel has its own.
"""


def noted(what: str, note: str) -> str:
    """Return what is asked for, with a note behind it where there is one."""
    return f"{what} ({note})" if note else what


def of_capability(name: str) -> str:
    """Return why a capability is more than it looks, or nothing."""
    plain = name.removeprefix("CAP_")
    return _AS_ROOT if plain in _CAPABILITIES else "" if plain in _ORDINARY else f"may be {_AS_ROOT}"


def of_device(path: str) -> str:
    """Return why a device, by its path in one spelling, is more than it looks, or nothing."""
    return A_DISK if _DISK.match(path) else f"may be {_AS_ROOT}" if _KEYS.match(path) else ""


def of_rule(rule: str) -> str:
    """Return why a rule of a device cgroup is more than it looks, or nothing."""
    if _BY_NUMBER.match(rule):
        return f"disks, memory or keys: {_AS_ROOT}"
    major = rule.partition(" ")[2].partition(":")[0]
    return "" if major.lstrip("0") in _PARTS else f"may be {_AS_ROOT}"
