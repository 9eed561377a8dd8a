"""One lock per robot: what it is there, who holds it, and how that is read.

The lock is a `flock` on the robot, taken by a script that lives on the controller's own connection
(`session.LockChannel`). The kernel frees it with the script's process, so a lock whose holder died cannot exist; the
file `holder` beside it only tells people whose lock it is. When the controller is gone (end of input) or was silent for
too long, the script first kills what the controller's session still runs on the robot, then lets go: nobody acts on a
robot without its lock.

Takes and returns values; `lock_set.py` acquires the locks of a run.
"""

from __future__ import annotations

import concurrent.futures
import datetime as dt
import json
import os
import secrets
from collections.abc import Callable, Iterable

import msgspec

from srprov.errors import TransportError
from srprov.owner import owner
from srprov.session import Reader
from srprov.untrusted import integer, json_or_none, lines_of, mapping, text
from srprov.wire import Query, quote

PLACES = ("/run/srprov", "/tmp/srprov")  # noqa: S108 - the fallback is used only when root owns it
"""Folders for lock and holder: the first that root can write to, and that root owns."""
_LONGEST_S = 100 * 365 * 86_400
"""What a robot claims beyond is no time for which it can be held; it might have begun before any calendar."""

# `lock_set.py` puts `tidy=…` before it: what to run once the lock is held, to remove what others left
SCRIPT = r"""
mark=$1 quiet=$2 sshd=$3 holder=$4 held= place=
shift 4
trap '' PIPE
trap : HUP INT TERM
say() { printf '%s\n' "$*"; }
now() { date -u +%Y-%m-%dT%H:%M:%SZ; }
for tool in flock timeout dd; do
    command -v "$tool" >/dev/null || { say "no $tool is not installed on the robot"; exit 1; }
done
umask 077
for place in "$@" ''; do
    [ -d "$place" ] || mkdir -m 755 "$place" 2>/dev/null
    [ -d "$place" ] && [ ! -L "$place" ] && [ -O "$place" ] && (: >>"$place/lock") 2>/dev/null && break
done
[ "$place" ] || { say "no folder for a lock: root can write to none of $*"; exit 1; }
exec 9>>"$place/lock"
# who only looks holds the lock shared, and for a moment: try again at once, as nobody else can have it then
lock() {
    left=20
    until flock -n 9 2>/dev/null; do
        flock -sn 9 2>/dev/null || return 1
        flock -u 9
        left=$((left - 1))
        [ "$left" -gt 0 ] || return 1
    done
}
take() {
    if lock; then
        held=1
        umask 022
        printf '%s,"since":"%s"}\n' "${holder%\}}" "$(now)" >"$place/holder.part" &&
            mv "$place/holder.part" "$place/holder"
        umask 077
        eval "$tidy"
        say locked
    else
        say busy "$(now)" "$(head -c 2000 "$place/holder" 2>/dev/null | tr -d '\n')"
    fi
}
untell() { [ -z "$held" ] || rm -f "$place/holder"; }
free() {
    untell
    flock -u 9
    held=
}
# the processes of the controller's session, by a word in their environment that their children inherit
of_session() {
    found=
    if printf 'a\0b\n' | grep -q b; then
        found=$(grep -l "SRPROV_SESSION=$mark" /proc/[0-9]*/environ 2>/dev/null | tr -dc '0-9\n')
    else # a grep that stops at a NUL byte, as busybox's does with some libraries; this takes ten times as long
        for dir in /proc/[0-9]*; do
            while IFS= read -r line || [ "$line" ]; do
                case $line in *"SRPROV_SESSION=$mark"*) found="$found ${dir#/proc/}" && break ;; esac
            done <"$dir/environ"
        done 2>/dev/null
    fi
    [ "$mark" ] && [ "$found" ]
}
# when a process began, in clock ticks since the boot; nothing when it is over: its number may be another's by now
since() {
    stat= began=
    [ "$1" ] && read -r stat 2>/dev/null <"/proc/$1/stat"
    set -- ${stat##*) }
    [ "$#" -gt 19 ] && [ "$1" != Z ] && shift 19 && began=$1
}
# sshd's process of this connection, which carries what the controller says to the engine
connected() {
    since "$sshd"
    [ "$began" ] && [ "$began" = "$logged_in" ]
}
since "$sshd"
logged_in=$began
take
while :; do
    # dd takes one byte and no more; its time is an interval, which no change of the clock can move
    case $(timeout "$quiet" dd bs=1 count=1 2>/dev/null 9>&-) in
        b) say b ;;
        t) take ;;
        f) free && say free ;;
        e) untell; exec 9>&-; exit 0 ;;
        *) break ;;
    esac
done
tries=0
while [ "$held" ] && [ "$tries" -lt 20 ]; do
    of_session || found=
    connected && found="$found $sshd"
    [ "$found" ] || break
    kill -9 $found 2>/dev/null
    tries=$((tries + 1))
    [ "$tries" -lt 3 ] || sleep 1
done
free
"""
"""Letters: `b` the heartbeat, `t` try again, `f` let go but stay, `e` let go and end."""


class Claim(msgspec.Struct, frozen=True, kw_only=True):
    """Who wants robots, and what for."""

    owner: str
    """user@host of the controller"""
    pid: int
    purpose: str
    """Verb and instance."""
    run: str

    def words(self) -> tuple[str, ...]:
        """Return the words of `SCRIPT`."""
        about = {"owner": self.owner, "pid": self.pid, "purpose": self.purpose, "run": self.run}
        return (json.dumps(about, separators=(",", ":")), *PLACES)


def claim(purpose: str, run: str = "") -> Claim:
    """Return the claim of this process; a run without an id gets a fresh one."""
    return Claim(owner=owner(), pid=os.getpid(), purpose=purpose, run=run or secrets.token_hex(6))


class Holder(msgspec.Struct, frozen=True, kw_only=True):
    """Who holds a robot, as the robot tells it; what it does not tell is empty."""

    owner: str = ""
    pid: int = 0
    purpose: str = ""
    run: str = ""
    since: str = ""
    """UTC, by this machine's clock, which need not agree with the robot's."""
    age_s: int | None = None

    def __str__(self) -> str:
        """Say it in words."""
        who = f"{self.owner}, process {self.pid}: {self.purpose}" if self.owner else "somebody who did not say who"
        return f"{who}, since {self.since} ({age(self.age_s)})" if self.age_s is not None else who


def age(seconds: int | None) -> str:
    """Return a duration as `7 s`, `12 min` or `3 h 5 min`."""
    if seconds is None:
        return ""
    minutes, hours = seconds // 60, seconds // 3600
    if hours:
        return f"{hours} h {minutes % 60} min"
    return f"{minutes} min" if minutes else f"{seconds} s"


def parse_holder(answer: str) -> Holder:
    """Read `TIME JSON` of a robot: its clock now, and its holder file. Whatever is not of the right shape is empty."""
    robot_now, _, rest = answer.partition(" ")
    told = mapping(json_or_none(rest))
    now, begun = _moment(robot_now), _moment(text(told.get("since")))
    seconds = max(0, int((now - begun).total_seconds())) if now and begun else None
    if seconds is not None and seconds > _LONGEST_S:
        seconds = None
    since = ""
    if seconds is not None:
        here = dt.datetime.now(dt.timezone.utc) - dt.timedelta(seconds=seconds)
        since = here.strftime("%Y-%m-%d %H:%M:%S UTC")
    words = {key: text(told.get(key)) for key in ("owner", "purpose", "run")}
    return Holder(**words, pid=integer(told.get("pid")), since=since, age_s=seconds)


def _moment(text: str) -> dt.datetime | None:
    try:
        return dt.datetime.strptime(text, "%Y-%m-%dT%H:%M:%SZ")
    except ValueError:
        return None


def who_holds() -> Query:
    """Ask for the holder, without being in the way: the lock is tested shared, and only for as long as `true` runs."""
    places = " ".join(map(quote, PLACES))
    test = '[ -d "$p" ] && [ ! -L "$p" ] && [ -O "$p" ] && [ -f "$p/lock" ] || continue; flock -sn "$p/lock" true'
    show = (
        'printf "held %s " "$(date -u +%Y-%m-%dT%H:%M:%SZ)"; head -c 2000 "$p/holder" 2>/dev/null | tr -d "\\n"; echo'
    )
    return Query(
        command=f"command -v flock >/dev/null || exit 0; for p in {places}; do {test} && continue; {show}; done"
    )


def holders(
    robots: Iterable[str], readers: Callable[[str], Reader], *, forks: int = 64
) -> tuple[dict[str, Holder | None], dict[str, str]]:
    """Ask all robots who holds them.

    Returns:
        Robot -> its holder or None, and robot -> reason for those that cannot be asked.
    """
    names = sorted(robots)
    held: dict[str, Holder | None] = {}
    unreachable: dict[str, str] = {}
    pool = concurrent.futures.ThreadPoolExecutor(max(1, min(forks, len(names))))
    try:
        futures = {name: pool.submit(lambda one: readers(one).ask([who_holds()])[0], name) for name in names}
        for name, future in futures.items():
            try:
                line = next((one for one in lines_of(future.result().out, len(PLACES)) if one.startswith("held ")), "")
            except TransportError as error:
                unreachable[name] = error.told
            else:
                held[name] = parse_holder(line.removeprefix("held ")) if line else None
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
    return held, unreachable
