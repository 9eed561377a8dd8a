"""A data set gets to a robot, once: what is there already is compared, what was cut off goes on where it ended.

Takes the file of this machine that has the hash, or downloads it; the robot compares the hash before it takes the
place of a data set.
"""

from __future__ import annotations

import os
from http.client import HTTPException
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from srprov import datasets, regular_file
from srprov.pace import SILENCE_S, Pace
from srprov.session import Progress, Streams
from srprov.transport.download import download
from srprov.transport.image_shell import answer, send
from srprov.transport.turns import Turns
from srprov.wire import DATA_STORE, Reply, SendData, quote

if TYPE_CHECKING:
    from srprov.transport.options import ConnectOptions
    from srprov.transport.session import BaseSession

_PIECE = 1 << 20
_STEP = 64 << 20
_HASHED = 1 << 20
"""bytes/s that the slowest disk of a robot is read with."""


def send_data(command: SendData, session: BaseSession, options: ConnectOptions, progress: Progress) -> Reply:
    """Send it; see `SendData`. A download is somebody's turn.

    Raises:
        TransportError: The robot cannot be talked to any more.
    """
    try:
        with regular_file.real_file(_here(command, options, progress)) as file:
            return _send(command, file, session, progress)
    except (OSError, HTTPException, ValueError, datasets.WrongData) as error:
        why = f"{command.url}: {error}" if command.url else str(error)
        return Reply(status=1, ok=False, err=f"no data set {command.sha256[:12]} to send: {why}")


def _send(command: SendData, file: BinaryIO, session: BaseSession, progress: Progress) -> Reply:
    size = os.fstat(file.fileno()).st_size
    streams = session.open_shell(take_script(command.sha256, size))
    patience = min(command.timeout_s, SILENCE_S + size / _HASHED)
    try:
        # it may have to hash what is there
        word, _, rest = answer(session.host, streams, b"\n", patience).partition(" ")
        if word == "there":
            return Reply(status=0, out="it is there")
        if word != "have" or not rest.isdecimal():
            return Reply(status=1, ok=False, err=rest[:500] or streams.reason())
        file.seek(min(int(rest[:18]), size))
        _feed(file, streams, size, session.host, progress)
        word, _, rest = answer(session.host, streams, b"\n", patience).partition(" ")
        if word == "wrong":
            datasets.forget(command.sha256)
            return Reply(status=1, ok=False, err=f"what arrived has the sha256 {rest[:64]}: did the file change?")
        return Reply(status=0) if word == "done" else Reply(status=1, ok=False, err=rest[:500] or streams.reason())
    finally:
        streams.close()


def _feed(file: BinaryIO, streams: Streams, size: int, host: str, progress: Progress) -> None:
    sent, told, pace = file.tell(), file.tell(), Pace()
    while (piece := file.read(min(_PIECE, size - sent))) and sent < size:
        send(host, streams, piece, pace)
        sent += len(piece)
        if sent - told >= _STEP:
            told = sent
            progress(f"{sent >> 20} of {size >> 20} MiB")


def take_script(sha256: str, size: int) -> str:
    """Return what takes a data set of so many bytes, or the rest of it.

    It says `there`, or `have BYTES` and takes the rest, or `no REASON`; then `done`, or `wrong SHA256`. A part stays.
    """
    place = quote(f"{DATA_STORE}/{sha256}")
    return f"""{{
umask 022
mkdir -p {place} && cd {place} || {{ echo "no it has no place for that"; exit 1; }}
if [ -f data ]; then
  found=$(sha256sum <data)
  [ "${{found%% *}}" != {sha256} ] || {{ echo there; exit 0; }}
  rm -f data
fi
have=$(stat -c %s part 2>/dev/null || echo 0)
[ "$have" -le {size:d} ] || {{ rm -f part; have=0; }}
set -- $(df -Pk . | tail -n 1)
if [ $((({size:d} - have) / 1024 + 65536)) -gt "${{4:-0}}" ]; then
  echo "no room: it needs $((({size:d} - have) / 1048576 + 64)) MiB, and has $((${{4:-0}} / 1024)) MiB free"; exit 1
fi
echo "have $have"
[ "$have" = {size:d} ] || head -c $(({size:d} - have)) >>part
[ "$(stat -c %s part)" = {size:d} ] || exit 1
found=$(sha256sum <part)
[ "${{found%% *}}" = {sha256} ] || {{ rm -f part; echo "wrong ${{found%% *}}"; exit 1; }}
chmod 0444 part && mv part data && echo done
}}"""


def _here(command: SendData, options: ConnectOptions, progress: Progress) -> Path:
    """Return a file that has the hash, from where srprov runs."""
    if options.home is not None:
        return options.home.data_set(command)
    return found_here(command, options.turns, progress)


def found_here(command: SendData, turns: Turns, progress: Progress) -> Path:
    """Return a file of this machine that has the hash; it is downloaded once for all robots.

    Raises:
        ValueError: There is none, and no address.
        WrongData: The address gives another content.
        OSError: It cannot be downloaded or kept.
        HTTPException: What answers there speaks no HTTP.
    """
    with turns.turn(command.sha256):
        if found := datasets.find(command.sha256, command.url):
            return found
        if not command.url:
            raise ValueError("no file here is known to have this hash; plan its EDF here again")
        return datasets.keep(command.sha256, download(command.url, command.timeout_s, progress), command.url)
