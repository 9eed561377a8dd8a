"""A volume's data goes from one robot to another, in pieces through the controller; nothing of it is stored here.

GNU tar on both robots: sparse files stay sparse, and owners, modes, times, links and extended attributes are kept. Then
both say the hash of one tar in a fixed order, which has all of that in it. A tar that fails makes a hash of its own.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING

from srprov.errors import TransportError
from srprov.pace import Pace
from srprov.sandbox import ENDED, NO_SANDBOX, NONE_MOUNTED, NOT_CLOSED, ending, sandboxed_reading, sandboxed_writing
from srprov.session import Progress, Streams
from srprov.untrusted import integer, lines_of
from srprov.wire import CopyVolume, Reply, Run, quote

if TYPE_CHECKING:
    from srprov.transport.options import Peers
    from srprov.transport.session import BaseSession

_STEP = 16 << 20
_DU_S = 600.0
_SPARE = 64 << 20
_ENTRY = 16 << 10
"""Bytes that a file may take in a tar beside its content: names, rights, extended attributes."""
_KEEP = "--format=posix --numeric-owner --acls --xattrs '--xattrs-include=*'"
_FIXED = "--sort=name '--pax-option=exthdr.name=%d/PaxHeaders/%f,delete=atime,delete=ctime'"
_READY = b"ready\n"
_MEMORY_KIB = 512 << 10
"""What an archive says of a file's name and attributes, tar keeps in memory, however long it is; and it comes from
another robot."""
_HASH = re.compile("[0-9a-f]{64}")
DEVICES = "it holds devices, and the number of one is another device's on this robot"
_NO_DEVICES = (
    "found=$(find . -xdev '(' -type b -o -type c ')' -exec stat -c %t:%T {} +) || exit 1; "
    f'for one in $found; do [ "$one" = 0:0 ] || {{ echo {quote(DEVICES)} >&2; exit 1; }}; done'
)
"""What ends a script in a folder with a device: the kernel has none of the number 0:0, which engines' layers have."""
UNPACK = (
    f"printf 'ready\\n' && ulimit -v {_MEMORY_KIB} && "
    f"tar --extract --preserve-permissions --same-owner {_KEEP} || exit 1; {_NO_DEVICES}"
)
"""The script that unpacks a tar where it is, and ends with another status than 0 unless that is data alone."""


def copy_volume(copy: CopyVolume, session: BaseSession, peers: Peers | None, progress: Progress) -> Reply:
    """Copy and compare; see `CopyVolume`.

    Raises:
        TransportError: This robot cannot be talked to any more; that of the source is a reply.
    """
    if peers is None:
        return _failed(f"no way to {copy.source_host} from here")
    try:
        source = peers(copy.source_host)
        most, problem = _most(copy, source.execute(_size_of(copy.volume)), session.execute(_room_of(copy.into)))
        if problem:
            return _failed(problem)
        before = _hash(source.execute(_hash_of(copy.volume, copy.timeout_s)))
        if not _HASH.fullmatch(before):
            return _failed(f"{copy.source_host}: its data cannot be read: {before}")
        if problem := _stream(
            copy, source.open_shell(_out(copy.volume)), session.open_shell(_into(copy.into)), progress, most, session
        ):
            return _failed(problem)
        after = _hash(session.execute(_hash_of(copy.into, copy.timeout_s)))
    except TransportError as error:
        if error.host == session.host:
            raise
        return _failed(f"{error.host}: {error.message}")
    if before != after:
        why = f"the copy is not what {copy.source_host} has (sha256 {after[:12]}, not {before[:12]}): did it change?"
        return _failed(why)
    return Reply(status=0, out=before)


def _failed(why: str) -> Reply:
    return Reply(status=1, ok=False, err=why)


def _place(volume: str) -> str:
    return f"place=$(docker volume inspect --format '{{{{.Mountpoint}}}}' {quote(volume)}) && "


def _read(script: str) -> str:
    """Return what reads in a volume's place where there is nothing else of the robot, whatever containers put there."""
    told = f"{{ s=$?; [ $s != {NO_SANDBOX} ] || echo {quote(NOT_CLOSED)} >&2; ( exit $s ); }}"
    return f"{{ root=$place && ( {sandboxed_reading(script)} ) || {told}; }}"


def _hash_of(volume: str, timeout_s: float) -> Run:
    tar = _read(f"exec tar --create {_KEEP} {_FIXED} .")
    return Run(script=f"{_place(volume)}{{ {tar} || head -c 32 /dev/urandom; }} | sha256sum", timeout_s=timeout_s)


def _size_of(volume: str) -> Run:
    """Return what says kilobytes on the disk, kilobytes of the files' lengths, and how many names there are."""
    du = _read(f"{NONE_MOUNTED}du -s -k . && du -s -k --apparent-size . && find . | wc -l")
    return Run(script=f"{_place(volume)}{du}", timeout_s=_DU_S)


def _room_of(volume: str) -> Run:
    """Return what says how many kilobytes are free where a volume lies."""
    return Run(script=f'{_place(volume)}df -P -k "$place" | tail -n 1')


def _most(copy: CopyVolume, size: Reply, room: Reply) -> tuple[int, str]:
    """Return the most bytes that may be sent, and why nothing can be sent, or nothing."""
    kib = [integer(line.partition("\t")[0], high=1 << 53, default=-1) for line in lines_of(size.out.strip(), 3)]
    if not size.ok or len(kib) != 3 or min(kib) < 0:
        return 0, f"{copy.source_host}: how large its data is cannot be told: {_said(size)}"
    words = room.out.split()
    free = integer(words[3], high=1 << 53, default=-1) if room.ok and len(words) > 3 else -1
    if free < 0:
        return 0, f"how much room there is cannot be told: {_said(room)}"
    if kib[0] > free:
        return 0, f"there are {free >> 10} MiB free, and the data has {kib[0] >> 10} MiB"
    return min((max(kib[:2]) << 10) + kib[2] * _ENTRY + _SPARE, free << 10), ""


def _said(reply: Reply) -> str:
    return " ".join(f"{reply.err} {reply.out}".split())[:200] or f"status {reply.status}"


def _hash(reply: Reply) -> str:
    """Return the hash that a robot said, or what it said in its place."""
    found = _HASH.match(reply.out)
    said = " ".join(reply.err.split())
    # tar's warning that it skips a socket is none of ours, but one that could not read something is told
    return found[0] if found and reply.ok else said or f"status {reply.status}"


def _out(volume: str) -> str:
    return ending(_place(volume) + _read(f"exec tar --create --sparse {_KEEP} ."))


def _into(volume: str) -> str:
    """Return what unpacks a tar into a volume, where there is nothing else of the robot.

    GNU tar leaves links that may lead out for the end. Of these, one can stand in the way of the name of another.
    """
    inside = sandboxed_writing(UNPACK)
    told = f"[ $? != {NO_SANDBOX} ] || echo {quote(NOT_CLOSED)} >&2; exit 1"
    return f"{_place(volume)}root=$place && ( {inside} ) && printf 'done\\n' || {{ {told}; }}"


def _stream(
    copy: CopyVolume, source: Streams, target: Streams, progress: Progress, most: int, session: BaseSession
) -> str:
    """Pass on what one shell prints to the other; return why that did not work, or nothing."""
    try:
        return _Pump(copy, source, target, progress, most, lambda: session.alive).run()
    finally:
        source.close()
        target.close()


class _Pump:
    """One copy under way: a piece of it is in memory at a time."""

    def __init__(
        self, copy: CopyVolume, source: Streams, target: Streams, progress: Progress, most: int,
        alive: Callable[[], bool],
    ) -> None:  # fmt: skip
        self._most, self._alive = most, alive
        self._copy, self._source, self._target, self._progress = copy, source, target, progress
        self._said, self._complaint, self._given = bytearray(), bytearray(), b""
        self._total = self._step = 0
        self._taking = Pace()

    def run(self) -> str:
        """Do it; return why it failed, or nothing."""
        if not self._until(_READY):
            return self._why("it is not ready to take the data")
        giving = Pace()
        while not self._source.ended:
            piece, error = self._source.read()
            self._given = (self._given + error)[-4096:]
            if not self._alive():  # whoever ended the run closed it
                return "its connection was closed"
            if self._total + len(piece) > self._most:
                return f"{self._copy.source_host} gives more than it said that it has, or than there is room for"
            if not giving.goes_on(len(piece)):
                return f"{self._copy.source_host} gave no more data{_words(self._given)}"
            if piece and not self._send(memoryview(piece)):
                return self._why("it took no more of the data")
            giving.resume()
            if not piece:
                self._source.wait(0.2, writing=False)
        ended = ENDED.search(self._given)
        if ended is None or int(ended[1]):  # the other one would wait for the rest
            return f"{self._copy.source_host} did not give all of its data{_words(ENDED.sub(b'', self._given))}"
        return "" if self._until(b"done\n") else self._why("it did not finish")

    def _send(self, piece: memoryview) -> bool:
        """Send all of a piece."""
        self._total += len(piece)
        if self._total >= self._step:
            self._progress(f"{self._copy.volume}: {self._total / (1 << 20):.0f} MiB copied")
            self._step = self._total + _STEP
        self._taking.resume()
        while piece:
            sent = self._target.write(piece)
            piece = piece[sent:]
            if not self._taking.goes_on(sent) or (not sent and not self._listen()):
                return False
            if not sent:
                self._target.wait(0.2, writing=True)
        return True

    def _until(self, word: bytes) -> bool:
        """Wait until the target says a word."""
        pace = Pace()
        while word not in self._said:
            if not self._listen() or not pace.goes_on(0):
                return word in self._said
            self._target.wait(0.2, writing=False)
        return True

    def _listen(self) -> bool:
        """Take what the target says; return whether it still runs."""
        out, error = self._target.read()
        self._said += out[: 4096 - len(self._said)]
        self._complaint += error[: 4096 - len(self._complaint)]
        return not self._target.ended

    def _why(self, what: str) -> str:
        return f"{what}{_words(self._complaint)}"


def _words(complaint: bytes | bytearray) -> str:
    said = " ".join(complaint.decode("utf-8", "replace").split())[-400:]
    return f": {said}" if said else ""
