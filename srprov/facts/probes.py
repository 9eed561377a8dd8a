"""The probes: what a robot is asked, as a table of shell commands, each with the function that reads its answer.

Gives the queries; `answers.py` has the parsers and `host.py` puts their values together. Pure: the commands are text.
A robot needs `sh` (dash or busybox), `grep`, `tr`, `sed`, coreutils and iproute2.

A slow robot pays for every process, so most of the work is done by what the shell has built in: globs find devices,
and one `grep` reads all files of /proc and /sys, each line after its file's name (what cannot be read stays silent).
Source: proc(5), sysfs-class-net, ip-address(8), the busybox manual.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec

from srprov.facts import rules, spelled, wireguard
from srprov.facts.answers import (
    parse_count,
    parse_devices,
    parse_disk,
    parse_files,
    parse_identity,
    parse_processor,
    parse_wireless,
)
from srprov.facts.lifelines import NAME_FILES, TIME_FILES
from srprov.facts.links import HIDDEN, parse_hidden, parse_links, parse_routes
from srprov.facts.placements import RECORDS
from srprov.wire import EngineQuery, Query

DEVICE_GLOBS = (
    "video* media* ttyUSB* ttyACM* ttyAMA* ttyTHS* serial[0-9]* i2c-* spidev* gpiochip* gpiomem* hidraw* vchiq "
    "nvidia* nvhost-* nvmap kvm fuse uinput net/tun input/js* input/event* dri/* snd/* serial/by-id/*"
)
"""Below /dev: what a service may ask for."""

EMULATORS = {
    f"/proc/sys/fs/binfmt_misc/qemu-{machine}": arch
    for machine, arch in (("aarch64", "arm64"), ("arm", "arm"), ("x86_64", "amd64"), ("i386", "386"),
                          ("riscv64", "riscv64"))
}  # fmt: skip
"""What tells of an emulator, by the names that everybody gives them -> the architecture that it runs."""

_FILES = (
    "/proc/loadavg /proc/meminfo /proc/sys/kernel/hostname /proc/sys/kernel/osrelease /proc/sys/kernel/version "
    "/sys/kernel/realtime /sys/devices/system/cpu/online /etc/os-release /usr/lib/os-release "
    "/sys/firmware/devicetree/base/model /proc/device-tree/model /sys/class/net/*/speed /sys/class/video4linux/*/name "
    "/sys/class/dmi/id/sys_vendor /sys/class/dmi/id/product_name /etc/machine-id "
    "/sys/firmware/devicetree/base/serial-number /sys/bus/usb/devices/*/idVendor /sys/bus/usb/devices/*/idProduct "
    "/sys/bus/usb/devices/*/product /sys/bus/usb/devices/*/serial "
    f"/proc/1/comm /proc/uptime /proc/net/dev {' '.join(NAME_FILES + TIME_FILES)} "
    f"{' '.join(EMULATORS)} {spelled.HOSTS} {spelled.USERS} {RECORDS}"
)
# The clock comes first: every later command would only add to its error. Linux 6.1 and later names its machine in
# /proc; a shell with an address of more than 8 digits is one of 64 bits; root's name is known. So no program is started
# for these. sudo takes SSH_CONNECTION away, but itself still has it in its environment, and is an ancestor of this
# shell.
_IDENTITY = """\
date +'clock %s.%N'
m= ; read -r m 2>/dev/null </proc/sys/kernel/arch || m=$(uname -m)
printf 'machine %s\\n' "$m"
read -r l 2>/dev/null </proc/self/maps && l=${l%%-*}
[ ${#l} -gt 8 ] && echo 'bits 64' || { printf 'bits '; getconf LONG_BIT 2>/dev/null || echo; }
while read -r k i e v; do [ "$k" = Uid: ] && break; done 2>/dev/null </proc/self/status
[ "$k $e" = 'Uid: 0' ] && echo 'id uid=0(root)' || { printf 'id '; id; }
c=${SSH_CONNECTION:-} u=${SUDO_USER:-} p=$PPID n=0
while [ -n "$u" ] && [ -z "$c" ] && [ "${p:-0}" -gt 1 ] && [ $n -lt 6 ]; do
  n=$((n + 1))
  [ -r /proc/$p/environ ] && c=$(tr '\\0' '\\n' 2>/dev/null </proc/$p/environ | sed -n 's/^SSH_CONNECTION=//p')
  q= ; while read -r k v; do [ "$k" = PPid: ] && q=$v && break; done 2>/dev/null </proc/$p/status
  p=$q
done
printf 'connection %s\\n' "$c"
[ -z "$u" ] || printf 'user %s\\n' "$u"
"""
# udev rules of robots give their devices names: /dev/rplidar -> ttyUSB0. Those are the links to a character device.
_DEVICES = f"""\
for f in {" ".join("/dev/" + glob for glob in DEVICE_GLOBS.split())}; do
  [ -e "$f" ] && printf 'dev %s\\n' "$f"
done
for f in /dev/*; do [ -L "$f" ] && [ -c "$f" ] && printf 'alias %s\\n' "$f"; done
:"""
_WIRELESS = """\
for d in /sys/class/net/*; do
  [ -e "$d/wireless" ] || [ -e "$d/phy80211" ] || continue
  printf 'wireless %s\\n' "${d##*/}"
  command -v iw >/dev/null 2>&1 && iw dev "${d##*/}" link 2>/dev/null
done
:"""
# df takes the folders that Docker's root may be; which one it is, the engine says, or the file that configures it
_DISK = """\
r=
while IFS= read -r l || [ "$l" ]; do
  case $l in *'"data-root"'*) r=${l#*'"data-root"'}; r=${r#*'"'}; r=${r%%'"'*};; esac
done 2>/dev/null </etc/docker/daemon.json
printf 'root %s\\n' "$r"
df -Pk / /var/lib/docker "${HOME:-/}" "${r:-/}" 2>/dev/null
:"""
# the list of CPUs is among the files; only where there is none they are counted
_COUNT_CPUS = "[ -r /sys/devices/system/cpu/online ] || grep -c '^processor[[:space:]]*:' /proc/cpuinfo"

# its first lines are enough where a processor has a name; ARM's have none, and their boards do
_PROCESSOR = """\
n=0
while [ $n -lt 8 ] && IFS= read -r l; do
  n=$((n + 1))
  case $l in 'model name'*) printf '%s\\n' "$l"; break;; esac
done 2>/dev/null </proc/cpuinfo
:"""


_MOST_LINES = 1024
"""Of each file."""
FILES = Query(command=f"grep -sHa -m {_MOST_LINES} '' {_FILES}\n:", in_place=True)
"""Everything that is read line by line, placement records too: one program for all of it."""


class Probe(msgspec.Struct, frozen=True):
    """One question of the shell, and who reads its answer."""

    name: str
    command: str
    parse: Callable[[str], Any]


PROBES = (
    Probe("identity", _IDENTITY, parse_identity),
    Probe("files", FILES.command, parse_files),
    Probe("cpus", _COUNT_CPUS, parse_count),
    Probe("processor", _PROCESSOR, parse_processor),
    Probe("links", "ip -j -d addr show", parse_links),
    Probe("routes", "ip -j -4 route show table main", parse_routes),
    Probe("devices", _DEVICES, parse_devices),
    Probe("wireless", _WIRELESS, parse_wireless),
    Probe("disk", _DISK, parse_disk),
    Probe("wireguard", wireguard.COMMAND, wireguard.parse_wireguard),
    Probe("rules", rules.COMMAND, rules.parse_rules),
    Probe("hidden", HIDDEN, parse_hidden),
)
"""In the order of asking."""
PING = EngineQuery(path="/_ping", headers=True)
"""What the engine is asked after the probes: its version and its API's stand in the headers of every answer."""
INFO = EngineQuery(path="/info")
"""What only a decision needs: the engine starts two programs for it, which takes 10 ms of a desktop's CPU."""
ENGINE = (PING, INFO)
_PAUSE = 20
"""At least so many hundredths of a second between the two readings of the counters."""
_COUNTERS = f"""\
left={_PAUSE}
read -r now rest 2>/dev/null </proc/uptime
case $now in
  *[!0-9.]*) ;;
  *.*.*) ;;
  *.*) left=$((first + {_PAUSE} + 100 - ${{now%.*}} * 100 - 1${{now#*.}})) ;;
esac
[ "$left" -le {_PAUSE} ] || left={_PAUSE}
[ "$left" -lt 1 ] || sleep "0.$((left / 10))$((left % 10))" 2>/dev/null || sleep 1
cat /proc/uptime /proc/net/dev"""


def counters(first: int) -> Query:
    """Ask for the second reading of the counters, wanted only for the traffic; the first is among the files.

    The robot makes what is missing of the pause between them, so that the engine can be asked in the same round trip.
    Where `sleep` takes whole seconds only, it is one.

    Args:
        first: When the counters were read first, in hundredths of a second since the robot's boot; 0 waits for nothing.
    """
    return Query(command=f"first={first:d}\n{_COUNTERS}", in_place=True)
