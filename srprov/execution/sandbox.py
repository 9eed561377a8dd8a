"""A shell script that reads a folder which others write at the same time, closed off from the rest of its robot.

Root reads files there by their names, and a container may put a link or a device in the way of any name meanwhile. In a
mount namespace of its own, with a root that holds only the robot's programs and that folder, read-only and without
devices, a link leads nowhere else and a device cannot be opened. Who is not root has nothing to lose there.
"""

from __future__ import annotations

from srprov.wire import quote

MISSING, NO_SANDBOX = 44, 47
"""Exit statuses: the folder is gone; it could not be closed off."""

_ENTER = f"""cd -- "$1" || exit {MISSING}
mount -t tmpfs -o mode=755,size=64k,nosuid srprov /tmp && mkdir /tmp/dev /tmp/folder && : >/tmp/dev/null &&
mount --bind /dev/null /tmp/dev/null || exit {NO_SANDBOX}
links=
for name in bin sbin lib lib32 lib64 libx32 usr; do
  if [ -L "/$name" ]; then links="$links /$name"
  elif [ -d "/$name" ]; then mkdir "/tmp/$name" && mount --rbind "/$name" "/tmp/$name" || exit {NO_SANDBOX}; fi
done
[ ! "$links" ] || cp -P $links /tmp || exit {NO_SANDBOX}
mount -c --bind . /tmp/folder && mount -o remount,bind,ro,nodev,nosuid,noexec /tmp/folder || exit {NO_SANDBOX}
exec chroot /tmp sh -c "cd /folder; $2"
"""
_WATCHED = (
    "exec 3<&0; timeout -k 9 {most} sh -c {script} 3<&- & job=$!; trap 'kill $job' HUP TERM; "
    "{{ cat <&3; kill $job; }} >/dev/null 2>&1 & watch=$!; exec 3<&-; "
    "wait $job; status=$?; kill $watch; exit $status"
)


def sandboxed(root: str, script: str) -> str:
    """Return a script that runs another one in a folder of the robot, which is its working folder at the start.

    The inner one ends with `exit` or its last status, and sees the folder under another name.
    """
    inside = quote(script)
    return (
        f"root=$(realpath -e -- {quote(root)} 2>/dev/null) || exit {MISSING}; "
        f'if [ "$(id -u)" != 0 ]; then cd -- "$root" || exit {MISSING}; exec sh -c {inside}; fi; '
        f'unshare -m true || exit {NO_SANDBOX}; exec unshare -m sh -c {quote(_ENTER)} sh "$root" {inside}'
    )


def ended_with_channel(script: str, most_s: float) -> str:
    """Return a script that ends another one, with all that it started, when the channel that feeds its shell is closed.

    Or after so many seconds. The other one reads nothing from the channel.
    """
    # a shell that is killed at once after its fork may ignore that and live on: what watches holds no output open
    return _WATCHED.format(script=quote(script), most=f"{most_s:.0f}")
