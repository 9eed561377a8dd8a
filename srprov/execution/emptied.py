"""What an engine removes was emptied before, where a container that still runs could lead the engine elsewhere.

An engine that removes a volume, or a container with what it wrote, goes through its folders as root, among the robot's
own. A container that holds such a folder open, as another one handed it on by a socket, puts a link there meanwhile:
`os.RemoveAll` of Go before 1.21.11 and 1.22.4 follows it, and empties the folder of the robot that it leads to. So such
an engine gets nothing to go through: the folder gets another name beside its own, and is removed in a sandbox; nobody
holds the new, empty one in its place.

Source: golang/go issue 52745; moby, `volume/local` and `daemon/graphdriver/overlay2`; tried with Docker 20.10.
"""

from __future__ import annotations

import json
import posixpath
import re
from collections.abc import Mapping

from srprov.modules.container_commands import stop
from srprov.robot_answers import MOST_LINES
from srprov.sandbox import HAS_MOUNT, MOUNTED, NO_SANDBOX, NONE_MOUNTED, NOT_CLOSED, sandboxed_writing
from srprov.session import Progress, Session
from srprov.untrusted import absolute, lines_of, mapping, mappings, string
from srprov.wire import EngineCall, EngineQuery, Query, Reply, Run, quote

_GO = re.compile(r"go1\.([0-9]{1,3})(?:\.([0-9]{1,3}))?")
_MENDED = {21: 11, 22: 4}
_NONE_SUCH = re.compile(r"no such (container|volume)", re.IGNORECASE)
_TOLD = {
    "volumes": """docker volume inspect --format '{"Driver":{{json .Driver}},"Mountpoint":{{json .Mountpoint}}}'""",
    # whole parts: a template ends at a key that is not there
    "containers": """docker container inspect --format '{"Id":{{json .ID}},"State":{{json .State}},\
"GraphDriver":{{json .GraphDriver}},"Mounts":[{{range .Mounts}}{{if eq .Type "volume"}}{"Type":"volume",\
"Name":{{json .Name}},"Source":{{json .Source}},"Driver":{{json .Driver}}},{{end}}{{end}}null],\
"HostConfig":{{json .HostConfig}}}'""",
}
"""What asks for that alone, of all that an engine says of one."""
_UPPER = ("overlay2", "fuse-overlayfs")
"""Storage drivers that tell where a container's own files lie."""
_ANONYMOUS = re.compile(r"[0-9a-f]{64}")
_LONGEST_S = 1800.0
_TRIES = 3
_UNSEEN = "its engine says that they lie where the robot has no such folder"
_MOUNTED = "another disk or folder is mounted at its place: unmount that first"
_HELD = "a container that still runs may hold it open: stop it, such as by its experiment's destroy"


class _NotToldError(Exception):
    """An engine does not say what it has to, or that it would not remove it; the text says what."""


def emptied(call: EngineCall, session: Session, progress: Progress) -> Reply | None:
    """Take away the files of what an engine is about to remove; return what went wrong, or None.

    What is not told whole goes wrong: a container's own words may make it too long to be read.

    Raises:
        TransportError: The robot cannot be talked to any more.
    """
    kind, _, name = call.path.removeprefix("/").partition("/")
    if call.method != "DELETE" or kind not in _TOLD:
        return None
    (version,) = session.ask([EngineQuery(path="/version")])
    if not version.ok:  # its engine is away, and is waited for as in any other command
        return version
    if not is_led(string(mapping(version.json()).get("GoVersion"))):
        return None
    (found,) = session.ask([Query(command=f"{_TOLD[kind]} -- {quote(name)}")])
    if _is_gone(found):
        return None
    body = mapping(found.json() if found.ok else None)
    try:
        folders = _folders(kind, name, body, session)
    except _NotToldError as error:
        return Reply(status=found.status, ok=False, err=f"{error} {found.err.strip()[:300]}".rstrip())
    if mapping(body.get("State")).get("Running") is True:  # it would write on, and the engine would end it anyway
        stopped = session.execute(stop(name, 0).stopping_within(0))
        if not stopped.ok:
            return stopped
    if not folders:
        return None
    reply = session.execute(Run(script="\n".join(map(_emptying, folders)), timeout_s=_LONGEST_S), progress)
    held = "" if reply.status == HAS_MOUNT else f"\n{_HELD}"
    why = NOT_CLOSED if reply.status == NO_SANDBOX else f"{reply.err.strip()}{held}"
    return None if reply.ok else Reply(status=reply.status, ok=False, err=f"its files cannot be removed: {why}")


def is_led(version: str) -> bool:
    """Return whether a program that was built with that Go follows links while it removes folders; also if unknown."""
    numbers = _GO.match(version)
    if numbers is None:
        return True
    minor, patch = int(numbers[1]), int(numbers[2] or 0)
    return minor < min(_MENDED) or patch < _MENDED.get(minor, 0)


def _emptying(folder: str) -> str:
    """Return the script that puts an empty folder in the place of one; what a killed run left beside it goes, too."""
    old = f"{folder}.old"
    remove = f"rm -rf -- {quote('./' + posixpath.basename(old))}"
    # whoever holds it open may put new names into it meanwhile
    away = sandboxed_writing(f"for again in 1 2 3; do {remove} 2>/dev/null && exit; sleep 0.2; done; {remove}")
    clear = f"{{ [ ! -e {quote(old)} ] || ( root={quote(posixpath.dirname(folder))}; {away} ); }}"
    renamed = f"mv -T {quote(folder)} {quote(old)} && mkdir {quote(folder)}"
    # an engine in a mount namespace of its own has its files where this shell sees none
    store = posixpath.dirname(posixpath.dirname(folder))
    there = f"[ -d {quote(store)} ] || {{ echo {quote(_UNSEEN)} >&2; exit 1; }}"
    mounted = f"! mountpoint -q {quote(folder)} 2>/dev/null || {{ echo {quote(_MOUNTED)} >&2; exit {HAS_MOUNT}; }}"
    there = f"{there}; {mounted}; root={quote(folder)}; {MOUNTED}{NONE_MOUNTED}"
    return f"{there}[ ! -d {quote(folder)} ] || {{ {clear} && {renamed}; }} && {clear} || exit"


def _is_gone(found: Reply) -> bool:
    return not found.ok and _NONE_SUCH.search(found.err) is not None


def _folders(kind: str, name: str, body: Mapping[str, object], session: Session) -> list[str]:
    """Return the folders that an engine goes through when it removes that."""
    if kind == "volumes":
        driver = body.get("Driver")
        known, folders = bool(driver), [absolute(body.get("Mountpoint"))] if driver == "local" else []
        if having := _having(name, session) if folders else {}:
            raise _NotToldError(f"it is in use by {', '.join(sorted(having.values()))[:300]}")
    else:
        state, layer = mapping(body.get("State")), mapping(body.get("GraphDriver"))
        driver = layer.get("Name")
        gone = state.get("Dead") is True and driver == ""  # its layer is, but for what has no name
        known = isinstance(state.get("Running"), bool) and (bool(driver) or gone)
        folders = [absolute(mapping(layer.get("Data")).get("UpperDir"))] if driver in _UPPER else []
        own = {string(body.get("Id"))}
        folders += [place for one, place in _anonymous(body).items() if _having(one, session).keys() <= own]
    if not known or not isinstance(driver, str) or not all(folders):
        raise _NotToldError("its engine does not say where its files lie")
    return folders


def _anonymous(body: Mapping[str, object]) -> dict[str, str]:
    """Return the volumes that are removed with a container, and where they lie: it was made with no name of them."""
    host = mapping(body.get("HostConfig"))
    binds = host.get("Binds")
    named = {string(one.get("Source")) for one in mappings(host.get("Mounts"))}
    named |= {string(one).partition(":")[0] for one in (binds if isinstance(binds, list) else ())}
    found = {
        string(one.get("Name")): absolute(one.get("Source"))
        for one in mappings(body.get("Mounts"))
        if one.get("Type") == "volume" and one.get("Driver") == "local"
    }
    return {name: place for name, place in found.items() if name not in named and _ANONYMOUS.fullmatch(name)}


def _having(volume: str, session: Session) -> dict[str, str]:
    """Return id -> name of the containers that have a volume.

    An engine's own filter also finds those that have something else at a place that is called so.
    """
    has = f"{{{{range .Mounts}}}}{{{{if eq .Name {json.dumps(volume)}}}}} has{{{{end}}}}{{{{end}}}}"
    form = "{{.ID}} {{.Name}}" + has
    asks = (
        f"ids=$(docker ps -aq --no-trunc --filter {quote(f'volume={volume}')}) && "
        f'{{ [ ! "$ids" ] || docker container inspect --format {quote(form)} $ids; }}'
    )
    for _ in range(_TRIES):
        (reply,) = session.ask([Query(command=asks)])
        if not _is_gone(reply):  # else one of them went meanwhile
            break
    if not reply.ok:
        raise _NotToldError(f"its engine does not say who has its volumes ({reply.err.strip()[:300]})")
    lines = lines_of(reply.out, MOST_LINES + 1)
    if len(lines) > MOST_LINES:
        raise _NotToldError("its engine names more containers that have its volumes than are read")
    found = (line.split(" ", 3) for line in lines if line.endswith(" has"))
    return {words[0]: words[1].removeprefix("/") for words in found if len(words) > 2}
