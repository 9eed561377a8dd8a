"""What a path of a robot is beside what its name says: another folder's name, somebody's home, a disk of the robot's.

A plan says of paths by their names what they give away. `/data` may hold what an overlay shows as `/etc`, the homes of
users, the file that the robot's memory is swapped to, or what a unit starts as root; the robot knows.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from srprov.controller.robot_mounts import Mounts
from srprov.modules.mount_kind import GRAVE, gives_away, mount_kind
from srprov.robot_answers import TooManyError
from srprov.untrusted import folder, lines_of, text
from srprov.wire import Query

_FOUND = r"""for f in @/srv/salt @/srv/pillar @/srv/formulas @/srv/reactor @/srv/spm @/srv/tftp @/srv/tftpboot; do
  [ ! -e "$f" ] || readlink -f "$f"
done
{ find @/etc @/opt @/usr/local @/var/lib @/var/opt @/var/spool @/root -xdev -maxdepth 3 -type l -exec stat -c %N {} + |
  sed -n -E "s#.* -> '((\.\./)+|/+)((srv|mnt|media|data)(/[^']*)?)'\$#/\3#p" | head -n 1000
{ grep -rhE '^(Exec|EnvironmentFile)' @/etc/systemd/system @/lib/systemd/system
  grep -rhE '^[^#]' @/etc/crontab @/etc/cron.d @/etc/cron.hourly @/etc/cron.daily @/etc/cron.weekly @/var/spool/cron \
    @/etc/rc.local @/etc/init.d @/etc/udev/rules.d @/etc/ld.so.conf.d @/etc/sudoers.d @/etc/profile.d
} | grep -oE '(^|[^A-Za-z0-9._])/(srv|mnt|media|data)(/[A-Za-z0-9._@+-]+)+' | sed -n 's/^[^/]*//p' | head -n 1000
} 2>/dev/null
"""
"""What root's programs find where data are: Salt's folders, links, and what units and the like name.

`@` is where all of that lies: nothing, but for tests.
"""


def places_of_root(below: str = "") -> str:
    """Return a script that prints the places of data from which root's programs take what they run or believe."""
    return _FOUND.replace("@/", f"{below}/")


USED = Query(
    command=places_of_root()
    + r"""while IFS=: read -r _ _ _ _ _ home shell; do
  case $shell in */nologin | */false) ;; *) [ ! -d "$home" ] || readlink -f "$home" ;; esac
done </etc/passwd
{ tail -n +2 /proc/swaps | cut -d ' ' -f 1; cat /sys/block/loop*/loop/backing_file; } 2>/dev/null
:"""
)
"""Ask for that, the homes of those who may log in, and the files that the robot swaps to, or has a file system in."""
_MOST_LINES = 10_000
_MOST_NAMED = 4


def used(said: str) -> list[str]:
    """Read the reply to `USED`; a home that is `/` is nobody's."""
    found = {folder(line.rstrip()).rstrip("/") for line in lines_of(said, _MOST_LINES)}
    return sorted(found - {""})


def other_names(paths: Iterable[tuple[str, str, bool]], mounts: Mounts, others: Iterable[str]) -> Iterator[str]:
    """Yield a sentence for each path that is, holds or lies in what gives away more than its name says.

    Args:
        paths: Each with where it really is, and whether it is only read.
        mounts: What is mounted on the robot.
        others: What the robot uses, whatever its name.
    """
    known = list(others)
    for path, real, read_only in paths:
        if _gives_more(real, read_only=read_only):
            continue  # that was said
        try:
            graver = sorted(one for one in mounts.names(real) if _gives_more(one, read_only=read_only))
        except TooManyError as error:
            yield f"{path}: {error}: what else it is is not known"
            return
        graver += [one for one in known if f"{one}/".startswith(f"{real}/") or f"{real}/".startswith(f"{one}/")]
        if graver:
            shown = ", ".join(map(text, graver[:_MOST_NAMED])) + (" and more" if len(graver) > _MOST_NAMED else "")
            yield f"{path} is, holds or lies in {shown}: {gives_away(read_only=read_only)}"


def _gives_more(path: str, *, read_only: bool) -> bool:
    kind, why = mount_kind(path, read_only=read_only)
    return kind == GRAVE or bool(why)
