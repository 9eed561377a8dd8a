"""Where a robot keeps images that are under way, and the shell scripts for it. Text only.

`/var/lib/srprov/.images` has `save.PID`, an image unpacked for others to be read by the shell PID, and `load`, an
archive that arrives in parts. Both go when they are done with; what a kill leaves goes with the next run that locks the
robot (`tidy_script`).
"""

from __future__ import annotations

from srprov.wire import quote

SOCKET = "/var/run/docker.sock"
FOLDER = "/var/lib/srprov/.images"
LARGE = 32 << 20
"""Bytes from which on a layer need not be compressed for a fast link, and an archive is spooled where it goes."""


def _tidy(folder: str) -> str:
    """Return what removes the spools of shells that are gone."""
    dead = '[ ! -d "$old" ] || kill -0 "${old##*.}" 2>/dev/null || rm -rf "$old"'
    return f"for old in {folder}/save.*; do {dead}; done"


def _leave(folder: str) -> str:
    """Return what removes the folder, and the one above, when nothing is in them."""
    return f"rmdir {folder} {folder.rpartition('/')[0]} 2>/dev/null"


def own_folder(folder: str = FOLDER) -> str:
    """Return what names a folder of the shell's own `$spool`, and removes it when the shell ends."""
    return f"""umask 077
spool={folder}/save.$$
trap 'cd /; rm -rf "$spool"; {_leave(folder)}' EXIT
trap 'exit 1' HUP INT TERM PIPE
{_tidy(folder)}"""


def save_script(image_id: str, folder: str = FOLDER) -> str:
    """Return what unpacks an image, says where and what it is, and waits for its end.

    It says `ready PLACE [FILE …]` with the files that are larger than 32 MiB, the archive's list, and an empty line.
    """
    name = quote(image_id)
    return f"""{{
{own_folder(folder)}
command -v gzip >/dev/null && command -v tar >/dev/null || {{ echo "no gzip or tar"; echo; exit 1; }}
mkdir -p "$spool" && cd "$spool" || {{ echo "no folder $spool"; echo; exit 1; }}
size=$(docker image inspect --format '{{{{.Size}}}}' {name} 2>/dev/null)
set -- $(df -Pk . | tail -n 1)
if [ "${{size:-0}}" -gt 0 ] && [ "${{4:-0}}" -gt 0 ] && [ $((size / 512 + 65536)) -gt "$4" ]; then
  echo "no room: it needs $((size / 524288 + 64)) MiB, and has $(($4 / 1024)) MiB free"; echo; exit 1
fi
if command -v docker >/dev/null; then docker save {name}
else curl -sf --unix-socket {SOCKET} http://engine/images/{name}/get; fi | tar -xf - >&2
[ -f manifest.json ] || {{ echo "no image came from docker save"; echo; exit 1; }}
set -- $(find . -type f -size +{LARGE // 1024}k)
echo "ready $spool $*"
head -c 500000 manifest.json
printf '\\n\\n'
read -r _
}}"""


def read_script(spool: str, name: str, *, raw: bool = False) -> str:
    """Return what prints a file of a spool, compressed unless it shall be `raw`; equal contents give equal bytes.

    A containerd store keeps layers as they came, most by gzip: those are printed as they are.
    """
    file = quote(name)
    packed = f"""[ "$(head -c 2 < {file} | od -An -tx1 | tr -d ' ')" = 1f8b ]"""
    pack = f"if {packed}; then exec cat < {file}; else exec gzip -1 -n < {file}; fi"
    return f"cd {quote(spool)} && " + (f"exec cat < {file}" if raw else pack)


def load_script(sha256: str, size: int, folder: str = FOLDER) -> str:
    """Return what takes an archive of so many bytes, or the rest of it, into a file, and loads that.

    It says `have BYTES`, or `no REASON`; takes the line `go`, and the rest; then says `loaded`, `failed REASON`, or
    `wrong SHA256` when the file is not what was sent. The file goes unless it is only a part.
    """
    return f"""{{
umask 077
file={folder}/load/{sha256}
mkdir -p {folder}/load 2>/dev/null && [ -w {folder}/load ] || {{ echo "no it has no place for that"; exit 1; }}
command -v docker >/dev/null || command -v curl >/dev/null || {{ echo "no it has neither docker nor curl"; exit 1; }}
for old in {folder}/load/*; do [ "$old" = "$file" ] || rm -rf "$old"; done
tidy() {{ rm -f "$file"; rmdir {folder}/load 2>/dev/null; {_leave(folder)}; }}
trap '[ -s "$file" ] || tidy' EXIT
have=$(stat -c %s "$file" 2>/dev/null || echo 0)
[ "$have" -le {size:d} ] || {{ rm -f "$file"; have=0; }}
echo "have $have"
read -r go && [ "$go" = go ] || exit 1
found=$({{ [ "$have" = 0 ] || cat "$file"; head -c $(({size:d} - have)) | tee -a "$file"; }} | sha256sum)
[ "$(stat -c %s "$file")" = {size:d} ] || exit 1
[ "${{found%% *}}" = {sha256} ] || {{ tidy; echo "wrong ${{found%% *}}"; exit 1; }}
if command -v docker >/dev/null; then said=$(docker load -q -i "$file" 2>&1)
else said=$(curl -sS --fail --unix-socket {SOCKET} -X POST -H 'Content-Type: application/x-tar' -T "$file" \
  'http://engine/images/load?quiet=1' 2>&1); fi
[ $? = 0 ] && word=loaded || word=failed
tidy
printf '%s %s\n' "$word" "$(printf %s "$said" | tr '\n' ' ')"
}}"""


def tidy_script(*, arriving: bool, folder: str = FOLDER) -> str:
    """Return what removes what copies left that ended otherwise, but nothing that is in use for others.

    With `arriving` also the parts of an archive, with which another copy to this robot could go on. Only who holds the
    robot's lock may run it.
    """
    parts = f"rm -rf {folder}/load; " if arriving else ""
    return f"if [ -d {folder} ]; then {parts}{_tidy(folder)}; {_leave(folder)}; fi"
