"""A robot is locked while its engine is asked for the files of a container that does not run.

An engine that is not mended mounts such a container's volumes by their names, and takes them off again: what another
run of srprov starts meanwhile, and has one of them, could lead it elsewhere by a link (`container_folders.py`).
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from srprov.codes import Code
from srprov.container_files import is_mended
from srprov.errors import LockHeld, TransportError
from srprov.untrusted import mapping, string
from srprov.wire import EngineQuery

if TYPE_CHECKING:
    from srprov.session import Session


@contextmanager
def standing_still(session: Session, container: str) -> Iterator[None]:
    """Hold the robot's lock where a container's files need it; one that runs is never asked of such an engine.

    Raises:
        LockHeld: Somebody else holds the robot.
        TransportError: It cannot be locked, or is gone.
    """
    version, about = session.ask([EngineQuery(path="/version"), EngineQuery(path=f"/containers/{container}/json")])
    runs = mapping(mapping(about.json()).get("State")).get("Running") is True
    if runs or is_mended(string(mapping(version.json()).get("Version"))):
        yield
        return
    from srprov.execution.lock_set import LockOptions, LockSet
    from srprov.execution.locks import claim

    robot, never = session.host, threading.Event()
    options = LockOptions(copied_to=frozenset({robot}))  # what a cut copy has sent is left to the next apply
    try:
        locks = LockSet([robot], {robot: session}, claim("cp"), options, never, lambda _event: None).acquire()
    except LockHeld as error:
        hint = "try again when that is done (srprov locks); the files of a container that runs need no lock"
        raise LockHeld(error.message, hint=hint) from None
    with locks as held:
        if why := held.lost.get(robot):
            raise TransportError(robot, why, code=Code.LOST)
        yield
