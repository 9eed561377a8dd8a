"""What a path of a robot is beside what its name says: another folder's name, somebody's home, a disk of the robot's.

A plan says of paths by their names what they give away. `/data` may hold what an overlay shows as `/etc`, the homes of
users, the file that the robot's memory is swapped to, or what a unit starts as root; the robot knows.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator

from srprov.controller.robot_mounts import Mounts
from srprov.modules.mount_kind import GRAVE, gives_away, mount_kind
from srprov.robot_answers import TooManyError
from srprov.untrusted import absolute, lines_of, text
from srprov.wire import Query

_FOUND = r"""for f in @/srv/salt @/srv/pillar @/srv/formulas @/srv/reactor @/srv/spm @/srv/tftp @/srv/tftpboot; do
  [ ! -e "$f" ] || readlink -f "$f"
done
# the rest is not gone through, and that is told
most() { sed '1001{s/.*/?/;q;}'; }
homes() {
  while IFS=: read -r _ _ _ _ _ home shell; do
    case $shell in */nologin | */false) ;; *) [ ! -d "@/$home" ] || printf '%s\n' "@/$home" ;; esac
  done <@/etc/passwd
}
# lines of text files that say something, but for what says where disks are
lines() {
  find "$@" -type f -size -2048 -exec grep -hE '^[[:blank:]]*[^#[:blank:]]' {} + |
  grep -vE '^[[:blank:]]*(Wh(at|ere)|Description|Documentation|(Requires|Wants)MountsFor|(Condition|Assert)[A-Za-z]+)='
}
words() { grep -oE "(^|[^A-Za-z0-9._])/(srv|mnt|media|data)(/[A-Za-z0-9._@+-]+)$1" | sed 's#^[^/]*##; s#^//*#/#'; }
{ find @/etc @/opt @/usr/local @/var/lib @/var/opt @/var/spool @/root -xdev -maxdepth 3 -type l -exec stat -c %N {} + |
  sed -n -E "s#.* -> '((\.\./)+|/+)((srv|mnt|media|data)(/[^']*)?)'\$#/\3#p" | most
{ lines @/etc -xdev ! -name 'fstab*' ! -name 'auto.*' ! -name exports ! -name updatedb.conf ! -name 'passwd*' |
    words +
  { lines @/usr/local/bin @/usr/local/sbin @/usr/local/etc @/var/spool/cron -xdev
    lines @/etc/systemd @/lib/systemd/system @/usr/lib/systemd/system @/usr/local/lib/systemd @/run/systemd -xdev
    homes | while IFS= read -r home; do
      lines "$home" -xdev -maxdepth 1 -name '.*' ! -name '*hist*' ! -name .viminfo
      lines "$home/.ssh" "$home/.config/systemd" "$home/.config/fish" "$home/bin" "$home/.local/bin" -xdev
    done
  } | words '*'
} | sort -u | most | while IFS= read -r p; do
  printf '%s\n' "$p"
  [ ! -e "$p" ] || readlink -f "$p"
  # what lies beside a program is often a part of it
  case $p in /*/*/*) [ ! -f "$p" ] || readlink -f "${p%/*}" ;; esac
done
} 2>/dev/null
"""
"""What root's programs find where data are: Salt's folders, links, and what is named by settings, units, programs of
the robot's own, and the files by which shells of those who may log in begin, whatever stands around the name.

No list of the words by which a program is started would ever be whole: all that a line names counts, but where it says
where a disk is, or a person had typed it. `@` is where all of that lies: nothing, but for tests.
"""


def places_of_root(below: str = "") -> str:
    """Return a script that prints the places of data from which root's programs take what they run or believe."""
    return _FOUND.replace("@/", f"{below}/")


USED = Query(
    command=places_of_root()
    + r"""while IFS=: read -r _ _ _ _ _ home shell; do
  case $shell in */nologin | */false) ;; *) [ ! -d "$home" ] || readlink -f "$home" ;; esac
done </etc/passwd
sed -n -E 's#^([^ ]+ +){7}(/.*)$#\2#p' /proc/net/unix 2>/dev/null | sort -u | most | while IFS= read -r p; do
  [ "$p" = "?" ] && echo "?" || readlink -f "$p"
done
{ tail -n +2 /proc/swaps | cut -d ' ' -f 1; cat /sys/block/loop*/loop/backing_file; } 2>/dev/null
:"""
)
"""Ask for that, the homes of those who may log in, sockets, and files that the robot swaps to, or has a file system in.

A socket answers also where nothing can be written."""
MORE = "?"
"""Stands for places of which there are too many to be gone through."""
_MOST_LINES = 10_000
_MOST_NAMED = 4


def used(said: str) -> list[str]:
    """Read the reply to `USED`; a home that is `/` is nobody's. `MORE` is in it where that is not all."""
    lines = [line.rstrip() for line in lines_of(said, _MOST_LINES + 1)]
    found = {MORE if line == MORE else absolute(line).rstrip("/") for line in lines[:_MOST_LINES]}
    return sorted(found - {""} | ({MORE} if len(lines) > _MOST_LINES else set()))


def other_names(paths: Iterable[tuple[str, str, bool]], mounts: Mounts, others: Collection[str]) -> Iterator[str]:
    """Yield a sentence for each path that is, holds or lies in what gives away more than its name says.

    Args:
        paths: Each with where it really is, and whether it is only read.
        mounts: What is mounted on the robot.
        others: What the robot uses, whatever its name.
    """
    known = [one for one in others if one != MORE]
    if MORE in others:
        yield "root's programs name more places of data than are looked at: whether these are among them is not known"
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
