"""How a robot gets a command: what an engine would do by names that others may lead elsewhere is done for it first."""

from __future__ import annotations

from srprov.execution.emptied import emptied
from srprov.execution.unfilled import unfilled
from srprov.robot_answers import answers_of
from srprov.session import Progress, Session, no_progress
from srprov.wire import Command, EngineCall, Reply


def sent(command: Command, session: Session, progress: Progress = no_progress) -> Reply:
    """Have a robot do a command.

    A container is made as one that has no volume filled where others may write; a container or volume that is removed
    is emptied first.

    Raises:
        TransportError: The robot cannot be talked to any more.
    """
    with answers_of(session.host):  # what a robot says of its folders goes into commands: not all of it can
        if isinstance(command, EngineCall) and (failed := emptied(command, session, progress)):
            return failed
        made = unfilled(command, session)
    return made if isinstance(made, Reply) else session.execute(made, progress)
