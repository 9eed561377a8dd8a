"""What every robot is asked first: commands of a shell that only read, each with an end, and GETs to its engine.

Gives questions; `host.py` reads the answers. Pure: the commands are text. What may hold any byte comes as base64: names
of files, and files themselves. Each answer has a longest length, so that a robot's whole answer has one too. In folders
that others than root may write, files are found by name alone, or read where these are closed off from the rest.

Source: dpkg-query(1), apt's extended_states, PEP 376, PEP 610, os-release(5); Docker Engine API 1.41.
"""

from __future__ import annotations

import msgspec

from srprov.sandbox import sandboxed_there
from srprov.wire import EngineQuery, Query, Reply, quote

MOST_PACKAGES = 3 << 20
"""Bytes of the list of packages."""
MOST_STATES = 1 << 20
MOST_LISTED = 96 << 10
"""Bytes of a list of paths."""
MOST_METADATA = 1 << 20
MOST_SOURCES = 128 << 10
MOST_KEYS = 512 << 10
ROOTS = "/home /root /opt /srv /usr/local /usr/src /workspace /workspaces /ws /ros_ws /catkin_ws /colcon_ws"
"""Where repositories and workspaces are looked for."""
DEPTH = 7
_SEARCH_S = 15
_PRUNED = "-name .cache -o -name node_modules -o -name .cargo -o -name .rustup -o -name .vscode-server -o -name .ccache"


END = "\0end"
"""What stands behind an answer that is whole."""


def _coded(command: str, most: int) -> str:
    """Return a command whose answer of at most so many bytes comes as one line of base64; it ends with `END`.

    A pipe or a disk that does not answer keeps nobody waiting.
    """
    whole = f"timeout {_SEARCH_S} sh -c {quote(command)} 2>/dev/null && printf '\\0end'"
    return f"{{ {whole}; }} | head -c {most} | base64 | tr -d '\\n'"


_PACKAGES = (
    "dpkg-query -W -f '${db:Status-Abbrev}\\t${Package}\\t${Architecture}\\t${Version}\\t${Essential}\\t${Priority}\\t"
    "${Pre-Depends}\\t${Depends}\\n' 2>/dev/null | head -c " + str(MOST_PACKAGES)
)
_STATES = f"head -c {MOST_STATES} /var/lib/apt/extended_states 2>/dev/null"
# each line after its file's name, as `grep` does it: no file can speak for another
_LISTS = "/etc/apt/sources.list /etc/apt/sources.list.d/*.list /etc/apt/sources.list.d/*.sources"
_SOURCES = _coded(f"grep -D skip -sHa '' {_LISTS}\n:",
                  MOST_SOURCES)  # fmt: skip
_RECORDS = (
    # a file with a second name may be somebody else's: of what was opened that is certain, of a name it is not
    'for i in ./*.dist-info; do [ -f "$i/INSTALLER" ] && [ ! -L "$i" ] && [ ! -L "$i/INSTALLER" ] || continue;'
    ' w=; IFS= read -r w <"$i/INSTALLER"; [ "$w" = pip ] || continue; printf \'dist %s\\0\' "$folder/${i#./}";'
    ' [ -f "$i/METADATA" ] && [ ! -L "$i/METADATA" ] &&'
    ' { [ "$(stat -c %h -)" = 1 ] && head -c 4096; } <"$i/METADATA" |'
    " grep -aE -m 2 '^(Name|Version): ' | head -c 400; printf '\\0';"
    ' [ -f "$i/direct_url.json" ] && [ ! -L "$i/direct_url.json" ] &&'
    ' { [ "$(stat -c %h -)" = 1 ] && head -c 2048; } <"$i/direct_url.json";'
    " printf '\\0'; done; :"
)
"""What pip left in the working folder, which the shell calls `$folder`."""
# whoever may write in such a folder, or above it, chooses what its names lead to, up to the one that is root's
_METADATA = _coded(
    "for folder in /usr/local/lib/python3*/dist-packages /usr/local/lib/python3*/site-packages"
    " /usr/lib/python3*/site-packages /usr/lib/python3/dist-packages /root/.local/lib/python3*/site-packages"
    ' /home/*/.local/lib/python3*/site-packages; do [ -d "$folder" ] && [ ! -L "$folder" ] || continue;'
    ' top=${folder%%/.local/lib/*}; [ "$top" != "$folder" ] || top=${folder%%/lib/*};'
    ' real=$(realpath -e -- "$top"); root="$real${folder#"$top"}"; export folder;'
    f" ( {sandboxed_there(_RECORDS)} ); how=$?;"
    " [ $how = 0 ] || printf 'dist %s\\0\\0%s\\0' \"$folder\" $how; done; :",
    MOST_METADATA,
)
# a root that is not there makes find complain and end with 1
_FIND = f"find {ROOTS} -xdev -maxdepth {DEPTH}"
_REPOSITORIES = _coded(f"{_FIND} \\( {_PRUNED} \\) -prune -o -name .git -printf '%U %y %p\\0'; :", MOST_LISTED)
_WORKSPACES = _coded(
    f"{_FIND} \\( {_PRUNED} -o -name .git \\) -prune -o -type f"
    " \\( -path '*/install/setup.bash' -o -path '*/devel/setup.bash' -o -name pyvenv.cfg \\) -print0; :",
    MOST_LISTED,
)
_OWN_FILES = _coded(
    "for f in /etc/udev/rules.d/* /etc/systemd/system/*.service /etc/systemd/system/*.timer /etc/modprobe.d/*"
    " /etc/modules-load.d/* /etc/netplan/*; do"
    ' [ -f "$f" ] && [ ! -L "$f" ] && printf \'%s\\0\' "$(head -c 1048576 "$f" | sha256sum | cut -c 1-64) $f"; done; :',
    MOST_LISTED,
)
_SYSTEM = """\
grep -D skip -sHa '' /etc/os-release /usr/lib/os-release | head -c 16384
printf 'machine %s\\n' "$(uname -m)"
printf 'id %s\\n' "$(id -u)"
for f in setpriv prlimit git timeout base64; do command -v $f >/dev/null 2>&1 && printf 'has %s\\n' $f; done
for d in /opt/ros/*; do [ -d "$d" ] && printf 'ros %s\\n' "${d##*/}"; done
:"""


class Question(msgspec.Struct, frozen=True):
    """One question of the shell."""

    name: str
    command: str
    most: int
    """Bytes that it lets a robot answer, before base64."""

    def query(self) -> Query:
        """Return it as it travels."""
        return Query(command=self.command, timeout_s=40)

    def answer(self, reply: Reply) -> str:
        """Return what a robot said; nothing where that is more than it may say: none of it is believed, then."""
        return reply.out if len(reply.out) <= 2 * self.most else ""


QUESTIONS = (
    Question("system", _SYSTEM, 32 << 10),
    Question("packages", _PACKAGES, MOST_PACKAGES),
    Question("states", _STATES, MOST_STATES),
    Question("sources", _SOURCES, MOST_SOURCES),
    Question("metadata", _METADATA, MOST_METADATA),
    Question("repositories", _REPOSITORIES, MOST_LISTED),
    Question("workspaces", _WORKSPACES, MOST_LISTED),
    Question("files", _OWN_FILES, MOST_LISTED),
)
"""In the order of asking."""
ENGINE = (
    EngineQuery(path="/containers/json", params=(("all", "1"),)),
    EngineQuery(path="/info"),
)
