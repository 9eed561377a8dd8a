"""A shell script that reads or fills a folder by names that others choose, closed off from the rest of its robot.

Root reads files there by their names, and a container may put a link or a device in the way of any name meanwhile; or
unpacks an archive of another robot, whose names and links may lead anywhere. In a mount namespace of its own, with a
root that holds only the robot's programs, read-only, and that folder without devices, a link leads nowhere else, a
device cannot be opened, and no hard link reaches what lies beyond. Who is not root has nothing to lose there, unless
what is read may be told to others: then it happens in a user namespace, too.
"""

from __future__ import annotations

import posixpath
import re

from srprov.wire import quote

MISSING, LED_OUT, NO_SANDBOX, ELSEWHERE, HAS_MOUNT = 44, 45, 47, 48, 50
"""Exit statuses: what is asked for is gone; a link leads out of the folder; it could not be closed off; another one is
in its place; something else is mounted in it."""
NOT_CLOSED = "its folder cannot be closed off from the robot's other files; unshare and mount of util-linux do that"
"""What `NO_SANDBOX` means, in words."""

INSIDE = "/folder"
"""What the folder is called in there."""
_ENTER = f"""cd -- "$1" || exit {MISSING}
[ "$(pwd -P)" = "$1" ] || exit {ELSEWHERE}
mount -t tmpfs -o mode=755,size=64k,nosuid srprov /tmp && mkdir /tmp/dev /tmp/folder && : >/tmp/dev/null &&
mount --bind /dev/null /tmp/dev/null || exit {NO_SANDBOX}
links=
for name in bin sbin lib lib32 lib64 libx32 usr; do
  if [ -L "/$name" ]; then links="$links /$name"
  elif [ -d "/$name" ]; then
    mkdir "/tmp/$name" && mount --bind "/$name" "/tmp/$name" && mount -o remount,bind,ro "/tmp/$name" ||
      exit {NO_SANDBOX}
  fi
done
[ ! "$links" ] || cp -P $links /tmp || exit {NO_SANDBOX}
for name in $4; do
  [ -f "/etc/$name" ] || continue
  mkdir -p /tmp/etc && : >"/tmp/etc/$name" && mount --bind "/etc/$name" "/tmp/etc/$name" &&
    mount -o remount,bind,ro "/tmp/etc/$name" || exit {NO_SANDBOX}
done
# people keep there what nobody else may read
for name in usr/local usr/src; do
  [ ! -d "/tmp/$name" ] || mount -t tmpfs -o ro,mode=755,size=4k srprov "/tmp/$name" || exit {NO_SANDBOX}
done
mount -c --bind . /tmp/folder && mount -o "remount,bind,$3,nodev,nosuid,noexec" /tmp/folder || exit {NO_SANDBOX}
mount -o remount,bind,ro,nosuid,nodev,noexec /tmp || exit {NO_SANDBOX}
exec chroot /tmp sh -c "cd /folder; $2"
"""
_ESCAPED = r"sed 's/\\/\\134/g; s/ /\\040/g; s/\t/\\011/g'"
MOUNTED = (
    f'top=$(printf %s "${{root%/}}" | {_ESCAPED}); mounted=$(while read -r _ _ _ _ at _; do rest=${{at#"$top"/}}; '
    '[ "$rest" = "$at" ] || [ ! "$rest" ] || printf "./%s\\n" "$rest"; done </proc/self/mountinfo | head -c 65536); '
)
"""Has the shell's `$mounted` say what is mounted below the folder of its `$root`, by lines, with blanks, tabs and
backslashes as `/proc/self/mountinfo` has them."""
NONE_MOUNTED = f'[ ! "$mounted" ] || {{ echo "something else is mounted in it: $mounted" >&2; exit {HAS_MOUNT}; }}; '
MOUNTS_SEEN = f"""set -f; IFS='
'; whole="./${{folder:+$folder/}}${{what#./}}"; whole=$(printf %s "${{whole%/}}" | {_ESCAPED}); for one in $mounted; do
case "$whole/" in "$one"/*) printf 'M 0 %s\\0\\0H\\0' "$what"; exit 0 ;; esac
case $one in "$whole"/*) printf 'M 0 %s\\0\\0' "${{what%/}}/${{one#"$whole"/}}" ;; esac
done; """
"""Says within `inside` what is mounted in a path, as `listing.py` takes it; ends where the path is in a mount."""
ENDED = re.compile(rb"srprov-end ([0-9]{1,3})\s*\Z")
"""What a script that `ending` made says last on stderr: with which status it ended."""
_OCTAL = re.compile(rb"\\([0-3][0-7]{2})")
_ROOT = f'root=$(realpath -e -- "$root" 2>/dev/null) || exit {MISSING}; '
_NAMES = "passwd group"
_WHY_NOT = (
    'set -f; IFS=/; at=.; for part in $folder; do at="$at/$part"; '
    f'[ ! -L "$at" ] || exit {LED_OUT}; done; exit {MISSING}'
)
_WATCHED = (
    "exec 3<&0; timeout -k 9 {most} sh -c {script} 3<&- & job=$!; trap 'kill $job' HUP TERM; "
    "{{ cat <&3; kill $job; }} >/dev/null 2>&1 & watch=$!; exec 3<&-; "
    "wait $job; status=$?; kill $watch; exit $status"
)


def named(mounted: bytes) -> bytes:
    """Return the path of a mount as it is, of one that `/proc/self/mountinfo` has."""
    return _OCTAL.sub(lambda one: bytes([int(one[1], 8)]), mounted)


def sandboxed(root: str, script: str, real: str = "", *, way: str = "ro", user: bool = False) -> str:
    """Return a script that runs another one in a folder of the robot, which is its working folder at the start.

    The inner one ends with `exit` or its last status, reads only, unless the way is `rw`, and sees the folder under
    another name, without what is mounted in it, which its `$mounted` names (`MOUNTED`). Nothing is read where the
    folder's path leads elsewhere than to `real`, if that is known; `user` says that the shell is not root's, and is
    closed off all the same.
    """
    same = f'[ "$root" = {quote(real)} ] || exit {ELSEWHERE}; ' if real else ""
    return (
        f"root=$(realpath -e -- {quote(root)} 2>/dev/null) || exit {MISSING}; {same}"
        f"{_closed(script, way, '', user=user)}"
    )


def inside(root: str, path: str, script: str, real: str = "", *, way: str = "ro", first: str = "") -> str:
    """Return a script that runs another in the folder of a path below a root, where `what` is its name.

    `real` is where the root has to lead, if that is known; `first` runs before anything of the path is looked at.

    The kernel says where the working folder is: whatever runs there may put links in the way meanwhile, and neither tar
    nor find nor dd follow one that they are named.
    """
    folder, name = posixpath.split(posixpath.normpath(path))
    go = (
        f"here=$(pwd -P); folder={quote(folder)}; what={quote('./' + (name if name != '.' else ''))}; {first}"
        f'if [ "$folder" ] && ! cd -- "./$folder" 2>/dev/null; then {_WHY_NOT}; fi; '
        f'[ "$(pwd -P)" = "${{here%/}}${{folder:+/$folder}}" ] || [ -z "$folder" ] || exit {LED_OUT}; '
        f'[ -e "$what" ] || [ -L "$what" ] || exit {MISSING}'
    )
    return sandboxed(root, f"{go}; {script}", real, way=way)


def ending(script: str) -> str:
    """Return a script that says on stderr how another one ended."""
    return f'( {script} ); echo "srprov-end $?" >&2'


def sandboxed_writing(script: str) -> str:
    """Return the same of the folder that the shell's `$root` names, where the inner script may write, and nowhere else.

    It knows the names of the robot's users and groups: access lists of an archive name them.
    """
    return _ROOT + _closed(script, "rw", _NAMES)


def sandboxed_there(script: str) -> str:
    """Return a script that runs another one, which only reads, in the folder whose path the shell's `$root` is.

    A path that a link leads elsewhere is not that folder. A shell that is not root's is closed off, too.
    """
    root, user = (_closed(script, "ro", "", user=one) for one in (False, True))
    return f'if [ "$(id -u)" = 0 ]; then {root}; else {user}; fi'


def sandboxed_reading(script: str) -> str:
    """Return the same, where the inner script only reads."""
    return _ROOT + _closed(script, "ro", _NAMES)


def _closed(script: str, way: str, known: str, *, user: bool = False) -> str:
    inside, unshare = quote(script), "unshare -r -m" if user else "unshare -m"
    open_to = f'if [ "$(id -u)" != 0 ]; then cd -- "$root" || exit {MISSING}; exec sh -c {inside}; fi; '
    return (
        f"{MOUNTED}export mounted; {'' if user else open_to}"
        f"{unshare} true || exit {NO_SANDBOX}; "
        f'exec {unshare} sh -c {quote(_ENTER)} sh "$root" {inside} {way} {quote(known)}'
    )


def ended_with_channel(script: str, most_s: float) -> str:
    """Return a script that ends another one, with all that it started, when the channel that feeds its shell is closed.

    Or after so many seconds. The other one reads nothing from the channel.
    """
    # a shell that is killed at once after its fork may ignore that and live on: what watches holds no output open
    return _WATCHED.format(script=quote(script), most=f"{most_s:.0f}")
