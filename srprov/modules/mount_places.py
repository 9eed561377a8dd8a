"""Where a container's mounts go that lie below a volume of its own: no link in the volume's data leads them elsewhere.

Whoever mounts a container's files follows such a link within the container. With one in the place of `/data/logs` the
volume that belongs there is mounted over `/bin`, and what lies in it is what the container runs. No other service of
the experiment may write to such a volume (`definitions.nested`), so a link is there already when the container is made:
a robot that the data was moved from put it there, or a service as the experiment had it before. While a container of
that one still runs, it could put one there at any moment.
"""

from __future__ import annotations

import itertools
import posixpath
from collections.abc import Iterable, Mapping
from typing import Any

from srprov.wire import quote

_LOOK = """not_told() {
  echo "$1 cannot be told, and it may lead elsewhere what is mounted in it: ${2:-docker does not say why}" >&2
  exit 1
}
no_link() {
  if ! place=$(docker volume inspect --format '{{.Mountpoint}}' "$1" 2>/dev/null); then
    why=$(docker volume inspect --format . "$1" 2>&1 >/dev/null) || :
    case $why in *[Nn]"o such volume"*) return 0 ;; esac
    not_told "what lies in the volume $1" "$why"
  fi
  [ -d "$place" ] || not_told "what lies in the volume $1" "$place is no folder"
  volume=$1 && shift
  for part; do
    [ ! -L "$place/$part" ] && continue
    echo "$part in the volume $volume is a link, and what belongs there would be mounted where it leads:" \\
      "make a folder of it" >&2
    exit 1
  done
}
no_other_writes() {
  # of a volume in each container that runs
  writes='{{range .Mounts}}{{if .RW}}{{if eq .Name "'$2'"}}{{$.Name}} {{end}}{{end}}{{end}}'
  who=$(docker ps -q --filter "volume=$2") && others= &&
    { [ -z "$who" ] || others=$(docker inspect --format "$writes" $who); } || not_told "who writes to the volume $2" ""
  for other in $others; do
    [ "$other" != "/$1" ] || continue
    echo "${other#/} may write to the volume $2, and would choose where what is mounted in it goes: apply again," \
      "when that container is gone or made anew" >&2
    exit 1
  done
}"""


def places_refused(name: str, mounts: Iterable[Mapping[str, Any]]) -> str:
    """Return a script that fails where a link in a volume's data is on the way to a mount below it; or nothing.

    And where another container that runs may put one there. Takes a container's name, and its mounts in the engine's
    form. A volume that is not there yet has no data.
    """
    at = {posixpath.normpath(f"/{str(one['Target']).lstrip('/')}"): one for one in mounts}
    ways: dict[str, dict[str, None]] = {}
    for target in sorted(at):
        above = next((one for one in _above(target) if one in at), None)
        if above is None or at[above]["Type"] != "volume" or not at[above].get("Source"):
            continue
        parts = posixpath.relpath(target, above).split("/")
        ways.setdefault(str(at[above]["Source"]), {}).update(dict.fromkeys(itertools.accumulate(parts, posixpath.join)))
    lines = [f"no_other_writes {quote(name)} {quote(volume)}" for volume in sorted(ways)]
    lines += [f"no_link {' '.join(map(quote, (volume, *parts)))}" for volume, parts in sorted(ways.items())]
    return "\n".join([_LOOK, *lines]) if ways else ""


def _above(target: str) -> Iterable[str]:
    """Yield the folders that a path lies in, the nearest one first."""
    while (target := posixpath.dirname(target)) != "/":
        yield target
