"""What travels to a robot as a stream: images, volumes' data and data sets, each by its own file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from srprov.errors import SrprovError
from srprov.session import Progress
from srprov.transport.data_copy import send_data
from srprov.transport.image_copy import copy_image
from srprov.transport.image_load import load_image
from srprov.transport.volume_copy import copy_volume
from srprov.untrusted import text
from srprov.wire import Copy, CopyImage, CopyVolume, Reply

if TYPE_CHECKING:
    from srprov.transport.options import ConnectOptions, Peers
    from srprov.transport.session import BaseSession


def copy(
    command: Copy,
    session: BaseSession,
    peers: Peers | None,
    options: ConnectOptions,
    progress: Progress,
) -> Reply:
    """Bring it to the robot.

    Raises:
        TransportError: The robot cannot be talked to any more.
    """
    try:
        return _copied(command, session, peers, options, progress)
    except SrprovError:
        raise
    except Exception as error:  # of what robots send, which may be anything: it must not end the run of all others
        return Reply(status=1, ok=False, err=f"what came cannot be read: {type(error).__name__}: {text(str(error))}")


def _copied(
    command: Copy, session: BaseSession, peers: Peers | None, options: ConnectOptions, progress: Progress
) -> Reply:
    if isinstance(command, CopyImage) and not command.source_host:
        return load_image(command, session, options, progress)
    if isinstance(command, CopyImage):
        return copy_image(command, session, peers, options, progress)
    if isinstance(command, CopyVolume):
        return copy_volume(command, session, peers, progress)
    return send_data(command, session, options, progress)
