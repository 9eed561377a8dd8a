"""What a mount of a robot's own path gives away: just that path, or the engine and with it the robot. Pure.

An engine follows links. So a path is looked at on the robot, too, right before a container is made with it; and what
lies below a folder that a container writes to is whatever that container wants it to be.
"""

from __future__ import annotations

import posixpath
import re
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator

from srprov.definitions.containermodel import Runtime
from srprov.modules.kept_script import TOLD
from srprov.wire import quote

GRAVE = "docker-socket"
_SOCKETS = (
    *("/run/docker.sock", "/run/containerd/containerd.sock", "/run/podman/podman.sock"),
    *("/run/balena-engine.sock", "/run/cri-dockerd.sock", "/run/snapd.socket"),
)
_ENGINES = (
    *("/run/docker", "/run/containerd", "/run/podman", "/run/containers", "/run/srprov", "/run/user"),
    *("/run/balena-engine", "/run/crio", "/run/k3s", "/run/k0s", "/run/lxd", "/run/incus"),
    *("/var/lib/docker", "/var/lib/containerd", "/var/lib/containers", "/var/lib/srprov"),
    *("/var/lib/balena-engine", "/var/lib/lxd", "/var/lib/incus", "/var/lib/rancher", "/var/lib/k0s"),
    *("/var/snap/docker", "/var/snap/lxd", "/var/snap/microk8s"),
)
"""Folders in which engines, or srprov, keep sockets, images, volumes or secrets: /run/user of those without root."""
_OF_ROOT = ("/run/dbus", "/run/systemd")
"""Folders with sockets of what does as root tells it, also root in a container."""
TELLS_SYSTEMD = "who is root there tells systemd what to run, as root"
_DATA = re.compile(
    r"/(?!srv/(?:salt|pillar|formulas|reactor|spm|tftp(?:boot)?)(?:/|\Z))(?:srv|mnt|media|data)(?:/(?!\.)[^/]+)*"
)
"""Where data are. Anywhere else may be what root's programs run or believe, such as the rules of udev in `/run/udev`.

A closed list, as no list of the other folders would ever be whole. People's homes are none of it: their shells run what
is in `~/bin`; nor is what lies below /tmp, where tmux and agents of keys have sockets. Hidden files are settings. Salt
runs as root what is in its folders below /srv, and robots boot what is served there.
"""
_PUBLIC = re.compile(
    r"/(?:usr/(?:local/)?(?:lib[^/]*|s?bin|games|include|share)|usr/local/cuda[^/]*|lib[^/]*|s?bin|opt/ros)(?:/.*)?"
    r"|/sys/(?:block|bus|class|dev|devices|module)(?:/.*)?"
    r"|/etc/(?:localtime|timezone|hostname|hosts|machine-id|os-release|passwd|group)",
    re.DOTALL,
)
"""What everybody may read, and where nobody listens. A closed list, too: elsewhere may be keys, or sockets.

Not all of /usr is: what is built from source has settings, keys, pipes and sockets in /usr/local/etc, /usr/local/var
or a folder of its own there. Not all of /sys is: below it is what the kernel shows root alone, as what is typed."""
_BELIEVED = "root may run or believe what is written there"
_READ = "a key there may let somebody in, and a socket there may do as root what it is told"
_KERNELS = "what the kernel tells root alone is below it, such as keys of radios, and what is typed at the robot"
"""A socket answers whoever reaches it, also where nothing can be written; so a shell in tmux takes keystrokes."""
_MOUNTS = "an engine with containerd's store mounts images there, as root, where links lead"
_MOUNTED_IN = "/tmp"  # noqa: S108 - the robot's own
"""Each time that it makes a container: `containerd-mountNUMBER`, whatever TMPDIR it is given."""
SHARED_MEMORY = "/dev/shm"  # noqa: S108 - the robot's own
"""What a container has of the robot with `ipc: host`, to write to as any mounted folder."""


def mount_kind(source: str, *, read_only: bool = False) -> tuple[str, str]:
    """Return the kind of a bind mount, and why it is graver than it looks.

    A folder that holds the engine's socket gives it away just so, as does whatever is, holds or lies below a folder of
    an engine's; /proc leads to every file of the robot by another name. Symbolic links of the robot but for /var/run
    are not known here: see `links_refused`.
    """
    path = plain(source)
    if path in _SOCKETS:
        return GRAVE, ""
    if path == "/proc" or path.startswith("/proc/"):
        return GRAVE, "leads to every file of the robot"
    if any(socket.startswith(f"{path.rstrip('/')}/") for socket in _SOCKETS):
        return GRAVE, "holds the engine's socket"
    if any(f"{one}/".startswith(f"{path.rstrip('/')}/") or path.startswith(f"{one}/") for one in _ENGINES):
        return GRAVE, "what an engine or srprov keeps"
    if any(f"{path}/".startswith(f"{one}/") for one in _OF_ROOT):
        return "host-path", TELLS_SYSTEMD
    if read_only:
        if path == "/sys" or path.startswith(("/sys/kernel", "/sys/fs")):
            return "host-path", _KERNELS
        return "host-path", "" if _PUBLIC.fullmatch(path) or _DATA.fullmatch(path) else gives_away(read_only=True)
    if path == _MOUNTED_IN:
        return "host-path", f"{_MOUNTS}; {_BELIEVED}"
    return "host-path", "" if _DATA.fullmatch(path) else gives_away(read_only=False)


def holds_data(source: str) -> bool:
    """Return whether a path of the robot is a place of data, by its name."""
    return bool(_DATA.fullmatch(plain(source)))


def gives_away(*, read_only: bool) -> str:
    """Return what anything but data may give away."""
    return _READ if read_only else _BELIEVED


def plain(source: str) -> str:
    """Return a path of a robot in one spelling."""
    path = posixpath.normpath("/" + source.lstrip("/"))
    # a link to it on every robot
    return path.removeprefix("/var") if path == "/var/run" or path.startswith("/var/run/") else path


def written_by(run: Runtime) -> Iterator[str]:
    """Yield the robot's paths that a container may write to."""
    yield from (mount.source for mount in run.mounts if mount.kind == "bind" and not mount.read_only)
    if run.ipc == "host":
        yield SHARED_MEMORY


def below(folders: Iterable[str]) -> Callable[[str], bool]:
    """Return what tells whether a path lies below one of some folders, and not whether it is one."""
    highest: list[str] = []
    for one in sorted(map(_key, folders)):
        if not (highest and one.startswith(highest[-1])):
            highest.append(one)

    def is_below(source: str) -> bool:
        path = _key(source)
        before = bisect_left(highest, path)  # of those that sort before it, only the last can hold it
        return before > 0 and path.startswith(highest[before - 1])

    return is_below


def _key(path: str) -> str:
    """Return a path so that a folder sorts right before what is below it, and is the beginning of that alone."""
    return plain(path).rstrip("/").replace("/", "\0") + "\0"


def links_refused(sources: Iterable[str]) -> str:
    """Return a script that fails where one of some paths leads to what is graver to mount than it looks; or nothing.

    Of a path that is not there, what is there of it counts: the rest may be made. One that is grave as it is written
    was asked for as that. What an engine or srprov keeps counts where it really lies: `/var/lib/docker` may be a link
    to another disk, or a folder of it by another name, or the engine is told of another one.
    """
    paths = sorted({one for one in sources if mount_kind(one)[0] != GRAVE})
    return "\n".join([_LOOK, *(f"leads_to_no_engine {quote(one)}" for one in paths)]) if paths else ""


def _grave_patterns() -> str:
    """Return what `mount_kind` calls grave, as the patterns of a shell's `case`."""
    exact, below = {"/", *_SOCKETS}, {"/proc", *_ENGINES}
    for one in (*_SOCKETS, *_ENGINES):
        parts = one.split("/")[1:-1]
        exact |= {"/" + "/".join(parts[:count]) for count in range(1, len(parts) + 1)}
    # where /var/run is no link, what leads there is spelled so
    every = [*sorted(exact | below), *(f"{one}/*" for one in sorted(below))]
    return "|".join([*every, *(f"/var{one}" for one in every if one.startswith("/run"))])


_KEPT = " ".join((*_SOCKETS, *_ENGINES))
_PLACES = r"""newline=$(printf '\nx') newline=${newline%x}
# a path as /proc/self/mountinfo spells it
spelled() {
  case $1 in
    *"$newline"*) echo "cannot tell where $1 leads" >&2; exit 1 ;;
    *[[:blank:]\\]*) printf '%s' "$1" | sed 's/\\/\\134/g; s/ /\\040/g; s/\t/\\011/g' ;;
    *) printf '%s' "$1" ;;
  esac
}
# a file system, and the place in it, of a path without links: from mount to mount, as the kernel goes, to the next on
# the way that is mounted on the last one; what a later one hides is passed by
place_of() {
  place= mount=0
  while :; do
    next= shortest=
    for m in $mounts; do
      case $m in "$mount "*) point=${m##* } ;; *) continue ;; esac
      case $1/ in "${point%/}"/*) ;; *) continue ;; esac
      [ -n "$next" ] && [ ${#point} -gt $shortest ] || next=$m shortest=${#point}
    done
    [ -n "$next" ] || return 0
    m=${next#* } point=${next##* }
    mount=${m%% *} m=${m#* } f=${m%% *} m=${m#* }
    place="$f ${m% *}"
    place=${place%/}${1#"${point%/}"}/
  done
}
# the same, and of an overlay the places where its layers have it
places_of() {
  place_of "$1"
  places=$place own=${place#* } on=${place%% *}
  for o in $overlays; do
    case $o in "$on "*) place_of "${o#* }${own%/}"; places="$places$newline$place" ;; esac
  done
}
shows_an_engine() {
  places_of "$1"
  every=$places
  for below in $mounts; do
    below=${below##* }
    case $below in "$1"/*) places_of "$below"; every="$every$newline$places" ;; esac
  done
  for p in $every; do
    for e in $kept_at; do
      case $e in "$p"*) return 0 ;; esac
      case $p in "$e"*) return 0 ;; esac
    done
  done
  return 1
}
"""
"""What an engine keeps may be mounted twice, and then lies below what does not have its name."""
_LOOK = f"""\
leads_to_no_engine() {{
  p=$1 r=
  while [ -n "$p" ] && [ ! -e "$p" ] && [ ! -L "$p" ]; do p=${{p%/*}}; done
  if [ -n "$p" ]; then r=$(readlink -f "$p"); [ -n "$r" ] || {{ echo "cannot tell where $1 leads" >&2; exit 1; }}; fi
  there=$r r=${{r%/}}${{1#"$p"}}
  case ${{r:-/}} in {_grave_patterns()})
    echo "$1 leads to ${{r:-/}}: mount that, which asks for {GRAVE}" >&2; exit 1;;
  esac
  printf '%s\\n' "$kept" | while IFS= read -r e; do
    q=$there grave=
    while [ -n "$q" ] && [ -n "$e" ]; do [ ! "$q" -ef "$e" ] || grave=1; q=${{q%/*}}; done
    case $e/ in "$r"/*) grave=1 ;; esac
    [ -z "$grave" ] || {{ echo "$1 is, holds or lies in $e, which an engine or srprov keeps" >&2; exit 1; }}
  done || exit 1
  at=$(spelled "$r") || exit 1
  IFS=$newline; set -f
  if shows_an_engine "$at"; then echo "$1 shows by a mount what an engine or srprov keeps, or /proc" >&2; exit 1; fi
  unset IFS; set +f
}}
{_PLACES}{TOLD}kept=$(
  {{ printf '%s\n' {_KEPT}; told_by_files; told_by_words; told_by_sockets; told_by_databases; }} 2>/dev/null |
  while IFS= read -r e; do
    [ ! -e "$e" ] || readlink -f "$e"
  done
)
ids=$(while read -r id _; do printf ' %s ' $id; done </proc/self/mountinfo)
mounts=$(
  while read -r id parent f root point _; do
    case $ids in *" $parent "*) [ $parent != $id ] || parent=0 ;; *) parent=0 ;; esac
    printf '%s\n' "$parent $id $f $root $point"
  done </proc/self/mountinfo
)
overlays=$(layers)
kept_at=$(
  while read -r _ _ f root _ _ more; do
    case " $more" in *' - proc '*) echo "$f ${{root%/}}/" ;; esac
  done </proc/self/mountinfo
  IFS=$newline; set -f
  for k in $kept; do places_of "$(spelled "$k")"; printf '%s\n' "$places"; done
)"""
