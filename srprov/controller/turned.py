"""Whether the robot's paths that a container mounts lead where they led when it was made. Asks the robot only.

An engine goes by their names each time that it reads or writes a container's files for `cp`: whoever may write above
one can have put a link there since.
"""

from __future__ import annotations

from srprov.codes import Code
from srprov.controller.device_links import led_to
from srprov.errors import RefusedError, visible
from srprov.led import led_of
from srprov.modules.mount_place import LEADS_TO
from srprov.session import Reader
from srprov.wire import EngineQuery, Query, quote

_NONE = 404


def refuse_turned(session: Reader, container: str) -> None:
    """Refuse a container of which a path leads elsewhere by now; of one without the label nothing is known.

    Raises:
        RefusedError: Names the path.
        TransportError: The robot is gone.
    """
    (about,) = session.ask([EngineQuery(path=f"/containers/{container}/json")])
    said = about.json()
    if about.status == _NONE:
        return
    if not (about.ok and isinstance(said, dict)):  # a container's own words may make it too long to be read
        raise RefusedError(
            f"what the engine on {session.host} says of {container} cannot be read",
            hint="make the container anew, with less in its command and labels",
            code=Code.ENGINE,
        )
    led = led_of(said)
    if not led:
        return
    looks = (
        f'r=$(leads_to {quote(path)}); [ "$r" = {quote(real)} ] || printf "%s %s\\n" {number} "$r"'
        for number, (path, real) in enumerate(led.items())
    )
    (looked,) = session.ask([Query(command="\n".join([LEADS_TO, *looks, ":"]))])
    if not looked.ok:
        raise RefusedError(
            f"where the paths of {container} on {session.host} lead cannot be told: {looked.err.strip()[:200]}",
            hint="see what the robot has run out of",
            code=Code.ENGINE,
        )
    now = led_to(looked.out)
    for number, (path, real) in enumerate(led.items()):
        if str(number) in now:
            where = now[str(number)] or "what cannot be told"
            raise RefusedError(
                visible(f"{path} on {session.host} leads to {where}, and to {real} when {container} was made"),
                hint="its engine would read and write there: put back what was there, or make the container anew",
                code=Code.STRANGE_FILE,
            )
