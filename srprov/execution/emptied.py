"""What an engine removes was emptied before, where a container that still runs could lead the engine elsewhere.

An engine that removes a volume, or a container with what it wrote, goes through its folders as root, among the robot's
own. A container that holds such a folder open, as another one handed it on by a socket, puts a link there meanwhile:
`os.RemoveAll` of Go before 1.21.11 and 1.22.4 follows it, and empties the folder of the robot that it leads to. So such
an engine gets nothing to go through: the folder gets another name beside its own, and is removed in a sandbox; nobody
holds the new, empty one in its place.

Source: golang/go issue 52745; moby, `volume/local` and `daemon/graphdriver/overlay2`; tried with Docker 20.10.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterable, Mapping

from srprov.execution.unfilled import having
from srprov.sandbox import NO_SANDBOX, NOT_CLOSED, sandboxed_writing
from srprov.session import Progress, Session
from srprov.untrusted import mapping, mappings, string
from srprov.wire import EngineCall, EngineQuery, Reply, Run, quote

_GO = re.compile(r"go1\.([0-9]{1,3})(?:\.([0-9]{1,3}))?")
_MENDED = {21: 11, 22: 4}
_NONE = 404
_UPPER = ("overlay2", "fuse-overlayfs")
"""Storage drivers that tell where a container's own files lie."""
_ANONYMOUS = re.compile(r"[0-9a-f]{64}")
_LONGEST_S = 1800.0
_HELD = "a container that still runs may hold it open: stop it, such as by its experiment's destroy"


def emptied(call: EngineCall, session: Session, progress: Progress) -> Reply | None:
    """Take away the files of what an engine is about to remove; return what went wrong, or None.

    Raises:
        TransportError: The robot cannot be talked to any more.
    """
    kind, _, name = call.path.removeprefix("/").partition("/")
    if call.method != "DELETE" or kind not in ("containers", "volumes"):
        return None
    about = EngineQuery(path=f"/containers/{name}/json" if kind == "containers" else f"/volumes/{name}")
    version, found = session.ask([EngineQuery(path="/version"), about])
    if not found.ok or not is_led(string(mapping(version.json()).get("GoVersion"))):
        return None
    body = mapping(found.json())
    if kind == "volumes":
        folders = _unused({name: string(body.get("Mountpoint"))} if body.get("Driver") == "local" else {}, "", session)
    elif mapping(body.get("State")).get("Running") is True and not (stopped := _killed(name, session)).ok:
        return stopped
    else:
        folders = [*_written(body), *_unused(_anonymous(body), string(body.get("Id")), session)]
    script = "\n".join(_emptying(one) for one in folders if one.startswith("/"))
    if not script:
        return None
    reply = session.execute(Run(script=script, timeout_s=_LONGEST_S), progress)
    why = NOT_CLOSED if reply.status == NO_SANDBOX else f"{reply.err.strip()}\n{_HELD}"
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
    return f"[ ! -d {quote(folder)} ] || {{ {clear} && {renamed}; }} && {clear} || exit"


def _killed(name: str, session: Session) -> Reply:
    """End what still runs: it would write on, and the engine would end it anyway."""
    accept = (204, 304, _NONE)
    return session.execute(
        EngineCall(method="POST", path=f"/containers/{name}/stop", params=(("t", "0"),), accept=accept)
    )


def _written(body: Mapping[str, object]) -> list[str]:
    """Return where a container's own files lie."""
    driver = mapping(body.get("GraphDriver"))
    return [string(mapping(driver.get("Data")).get("UpperDir"))] if driver.get("Name") in _UPPER else []


def _anonymous(body: Mapping[str, object]) -> dict[str, str]:
    """Return the volumes that are removed with a container, and where they lie: it was made with no name of them."""
    host = mapping(body.get("HostConfig"))
    binds = host.get("Binds")
    named = {string(one.get("Source")) for one in mappings(host.get("Mounts"))}
    named |= {string(one).partition(":")[0] for one in (binds if isinstance(binds, list) else ())}
    found = {
        string(one.get("Name")): string(one.get("Source"))
        for one in mappings(body.get("Mounts"))
        if one.get("Type") == "volume" and one.get("Driver") == "local"
    }
    return {name: place for name, place in found.items() if name not in named and _ANONYMOUS.fullmatch(name)}


def _unused(places: Mapping[str, str], by: str, session: Session) -> Iterable[str]:
    """Return where the volumes lie that no container has, but for one; an engine removes no other ones."""
    if not places:
        return []
    replies = zip(places.items(), session.ask([having(name) for name in places]), strict=True)
    return [
        place
        for (name, place), reply in replies
        if reply.ok
        and not [
            one
            for one in mappings(reply.json())
            if one.get("Id") != by and name in {string(had.get("Name")) for had in mappings(one.get("Mounts"))}
        ]
    ]
