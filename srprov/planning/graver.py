"""What a permission gives away beyond its name: which values of it make a container as good as root on a robot. Pure.

Of each kind what is known to be harmless is a closed list, as no list of the rest would ever be whole: all else may be.

Source: capabilities(7), ptrace(2) ("Ptrace access mode checking"), the kernel's list of devices; runc, `sysctl` of its
validator, and `nsexec.c` on what is dumpable.
"""

from __future__ import annotations

import re

EVERY_PROCESS = "as good as root where anybody but root runs something; it reads what other containers hold"
"""A container may be any user, and whose processes have no more capabilities than it has, it reads the files of."""
LISTENERS = "root's programs may do what they are told there: on the loopback, or by sockets that lie in no folder"
"""An engine that listens on 127.0.0.1, a debugger, an X server: they ask nobody who is on the robot itself."""
TOLD = "root's programs may do what they are told on the robot's loopback, and by sockets in any folder"
"""An engine that sends as root to an address of a stranger's is told by what answers there where to send it next."""
ELSEWHERE = "root's programs that ask there may do what they are told by who answers, in the overlay"
"""Such as a registry, or the metadata of a cloud."""
SHARED = "root may believe what is written to its shared memory, or do what a socket in it is told"
"""`/dev/shm` is a folder, too; ssh keeps connections to other hosts there where it is told so."""
AS_ROOT = "as good as root on the robot"
MAY_BE = f"may be {AS_ROOT}"
WRITTEN = f"{MAY_BE}, where it, or another container, runs or believes what is written there"
"""Of a place of data that a container may write to: whose programs take what from there no plan knows whole."""
LEFT_THERE = "may be as good as root there, where a program of anybody's runs, follows or believes what is left in it"
"""Of a folder on the machine that runs what was exported: `git`, `scp` and an editor follow what a container left."""
READ = f"{MAY_BE}, where a program has a pipe or a socket there, or somebody a key"
"""Of one that is only read: a pipe takes what is written to it, also where nothing else can be."""
LINKING = "NET_ADMIN"
MAKES_LINKS = f"{MAY_BE}: it makes links in the robot's own network, where root's programs may do what it answers"
"""By the number that a container's own link has for the network of its other end; no name of a namespace is needed."""
_CAPABILITIES = frozenset({"ALL", "SYS_ADMIN", "SYS_MODULE", "SYS_RAWIO", "SYS_BOOT", "DAC_READ_SEARCH"})
TRACING = "SYS_PTRACE"
TAKES_OVER = f"{AS_ROOT}, unless AppArmor is in force: it takes over what engines start in it, such as health checks"
"""That has all rights until it runs, inside of the container, which traces whom it sees, also who has more than it."""
_ORDINARY = frozenset(
    {
        *("AUDIT_WRITE", "CHOWN", "DAC_OVERRIDE", "FOWNER", "FSETID", "KILL", "MKNOD", "NET_BIND_SERVICE", "NET_RAW"),
        *("SETFCAP", "SETGID", "SETPCAP", "SETUID", "SYS_CHROOT"),
        *("IPC_LOCK", "NET_BROADCAST", "SYS_NICE", "WAKE_ALARM"),
    }
)
"""Docker's own, and those that robots need for schedules, which end at the container's namespaces or there.

SYS_PTRACE was one of them until it took over a health check, and NET_ADMIN until it made a link on the robot's own
card: the kernel asks for it in the namespace of users that a network belongs to, and engines give a container the
robot's. So no other one is: SYSLOG shows where the kernel's memory is, BPF and PERFMON read it, SYS_TIME moves the
clock by which a robot believes certificates.
"""
_DISK = re.compile(
    r"/dev/((sd|hd|vd|xvd)[a-z]+[0-9]*\Z|(nvme|mmcblk|dm-|md|mtd|mtdblock|ubi|ubiblock|loop|nbd|zram|sg)[0-9]"
    r"|(mapper|disk|block|bsg|md)(/|\Z)|root\Z)"
)
A_DISK = f"a disk: {AS_ROOT}, if it is the robot's own"
_HARMLESS = re.compile(
    r"/dev/((video|media|v4l-subdev|radio|ttyUSB|ttyACM|fb|rfcomm|pps|lirc|apex_"
    r"|hailo|iio:device|watchdog|nvidia|input/js|input/mouse)[0-9]+"
    r"|nvidiactl|nvidia-(uvm|uvm-tools|modeset)|nvmap|nvhost-[a-z0-9-]+|kfd|kvm|fuse|net|net/tun"
    r"|null|zero|full|u?random|rfkill|input/mice|(snd|dri|dma_heap)(/.+)?|(serial|v4l)/by-(id|path)/[^/]+)"
)
"""Parts that robots have, by the names that the kernel and udev give them; what is not named so may be anything.

It may be memory, or a card that writes to it; keys, consoles, terminals; raw USB. So may be a serial line that is none
of an adapter's: a robot's console is one. I2C, SPI and pins (`gpiochip0`) lead to the chip that a board starts from, or
to one that says how: a Raspberry Pi has both. A network card's clock (`ptp0`) is the robot's where it follows that.
"""
HARMLESS = "a part that robots have, which is known to be harmless"
_BY_NUMBER = re.compile(r"[ab] |c (\*|0*(1|10|21|90)):")
"""Rules for them, which a container can make a device of by itself; 21 and 90 are disks as characters."""
_PARTS = frozenset({"29", "81", "116", "166", "188", "195", "226"})
"""Characters that are screens, cameras, sound, serial adapters, graphics; source: the kernel's devices.txt.

A closed list: 4 and 204 are consoles, 13 keyboards, 189 raw USB with its disks, and from 234 on any kernel has its own.
"""

_OF_NAMESPACES = re.compile(
    r"net(\.[A-Za-z0-9_-]+)+|fs\.mqueue\.[a-z_]+|kernel\.(msgmax|msgmnb|msgmni|sem|shmall|shmmax|shmmni|shm_rmid_forced)"
)
"""Parameters that each container has for itself; `kernel.core_pattern` is a program that runs as root."""
_RUNTIMES = frozenset({"runc", "io.containerd.runc.v2", "crun", "runsc"})
"""Those that do what the engine's own does, or keep a container further apart, by the names that they give themselves.

`nvidia` is none of them: variables of the image tell it, as root, what of the robot to give.
"""


def noted(what: str, note: str) -> str:
    """Return what is asked for, with a note behind it where there is one."""
    return f"{what} ({note})" if note else what


def gives_root(note: str) -> bool:
    """Return whether a note of these says that a container is as good as root, and not only that it may be."""
    return "as good as root" in note and MAY_BE not in note


def of_capability(name: str) -> str:
    """Return why a capability is more than it looks, or nothing."""
    plain = name.removeprefix("CAP_")
    if plain == TRACING:
        return TAKES_OVER
    if plain == LINKING:
        return MAKES_LINKS
    return AS_ROOT if plain in _CAPABILITIES else "" if plain in _ORDINARY else MAY_BE


def of_device(path: str) -> str:
    """Return why a device, by its path in one spelling, is more than it looks, or nothing."""
    return A_DISK if _DISK.match(path) else "" if _HARMLESS.fullmatch(path) else MAY_BE


def of_rule(rule: str) -> str:
    """Return why a rule of a device cgroup is more than it looks, or nothing."""
    if _BY_NUMBER.match(rule):
        return f"disks, memory or keys: {AS_ROOT}"
    major = rule.partition(" ")[2].partition(":")[0]
    return "" if major.lstrip("0") in _PARTS else MAY_BE


def of_sysctl(name: str, *, shared: bool) -> str:
    """Return why a kernel parameter is more than it looks, or nothing; `shared`: the container has robot's namespaces.

    An engine refuses all that is not of the container's own namespaces; another runtime than its own need not.
    """
    return MAY_BE if shared or not _OF_NAMESPACES.fullmatch(name) else ""


def of_runtime(name: str) -> str:
    """Return why what starts a container is more than it looks, or nothing."""
    return "" if name in _RUNTIMES else f"{MAY_BE}: what that gives a container is its own business"
