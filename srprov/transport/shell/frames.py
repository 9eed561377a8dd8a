r"""The language between srprov and a robot's shell: what is written to it, and how its answers are cut apart again.

Takes commands and bytes, returns bytes and replies; pure. A batch is one text. Each command in it runs as `(eval
'command') </dev/null`, so that neither `exit`, a syntax error nor a command that reads its standard input can touch
the shell itself, at the price of one fork; questions of ours that do none of this run without it. After each one the
shell prints `\n<nonce> <index> <status>\n` on both its streams; the nonce is 128 fresh random bits per batch, so that
output may be any bytes and no temporary file is needed on the robot. A first boundary (index `begin`) throws away what
a background process of an earlier command may have printed meanwhile.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence

from srprov.wire import quote

BEGIN = "begin"
LONGEST = 16 << 20
"""Bytes that one stream of a batch may have, what came before its first boundary included."""
_KEPT = 2 << 20
"""Bytes that are kept of a script's output, of which only the end is ever shown."""
_LONGEST_BOUNDARY = 100
_LONGEST_LINE = 4096
"""Characters of a line of progress."""
_STATUS = re.compile(r"[0-9]{1,9}", re.ASCII)
_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin:/snap/bin"
# Whole paths alone, and in order: an empty part of a PATH, or of a loader's, is the folder where somebody is, and root
# reads in folders of containers. `export LD_LIBRARY_PATH=/usr/local/cuda/lib64:$LD_LIBRARY_PATH` leaves one.
_WHOLE_PATHS = "p=; set -f; IFS=:; for d in $PATH; do case $d in /*) p=$p$d: ;; esac; done; set +f; unset IFS"
_UNSET = "p d ENV BASH_ENV CDPATH LD_LIBRARY_PATH LD_PRELOAD LD_AUDIT"


def ready_line(nonce: str) -> bytes:
    """Return the line that a fresh shell prints when everything that a `.bashrc` says is over."""
    return f"\n{nonce} ready\n".encode()


def sudo_prompt(nonce: str) -> bytes:
    """Return what sudo asks with on standard error; it asks for nothing where it needs no password."""
    return f"{nonce} password".encode()


FIND_CONNECTION = """\
line=$PPID
while [ "${line:-0}" -gt 1 ]; do
  name= ; read -r name 2>/dev/null <"/proc/$line/comm"
  case $name in
    sshd|sshd-session|dropbear) break ;;
    sudo|sh|dash|ash|bash|zsh|ksh|mksh|fish|csh|tcsh|busybox) ;;
    *) line=; break ;;
  esac
  up= ; while read -r key up && [ "$key" != PPid: ]; do :; done 2>/dev/null <"/proc/$line/status"
  line=$up
done
[ "${line:-0}" -gt 1 ] || line=
echo "$line"
"""
"""For a fresh shell: set and print `line`, the number of sshd's process for this connection; empty if not found.

Only shells and sudo may lie between: an sshd above any other program is not this connection's, but a user's own login.
"""


def start_command(nonce: str, then: str, *, root: bool, mark: str = "", ask: bool = False) -> str:
    """Return the command line for the robot's login shell that ends in `then`, run by root.

    It works for sh, bash, zsh, fish and csh as login shells: one line, one pair of single quotes, nothing that they
    expand. A user whose name is not root may still be root (uid 0), and then needs no sudo.

    Args:
        nonce: Random hex digits; `ready_line(nonce)` comes before anything that `then` prints.
        then: Words without a single quote.
        root: The login user is root.
        ask: There is a password: sudo may ask for it, with `sudo_prompt(nonce)`, and reads it from standard input.
        mark: Hex digits that `then` and all that it starts have as SRPROV_SESSION in their environment.
    """
    ready = f'printf "\\n%s ready\\n" {nonce}'
    # sudo resets PATH to its secure_path, so PATH is extended behind it; ENV and BASH_ENV would make sh read files.
    setup = f"{_WHOLE_PATHS}; PATH=$p{_PATH}; LC_ALL=C; export PATH LC_ALL; unset {_UNSET}; umask 022; cd /"
    if mark:
        setup = f"SRPROV_SESSION={mark}; export SRPROV_SESSION; {setup}"
    inner = f"{setup}; {ready}; exec {then}"
    if root:
        return f"exec sh -c '{inner}'"
    # Only `"` and `$` are escaped: `\\n` means itself inside double quotes, and fish would halve a doubled backslash.
    again = inner.replace('"', '\\"').replace("$", "\\$")
    sudo = f'sudo -S -p "{sudo_prompt(nonce).decode()}"' if ask else "sudo -n"
    return f'exec sh -c \'if [ "$(id -u)" = 0 ]; then {inner}; fi; exec {sudo} sh -c "{again}"\''


def batch(nonce: str, commands: Sequence[str], in_place: Collection[int] = ()) -> bytes:
    """Return the text of one batch for a shell's standard input.

    Args:
        nonce: As in `Frames`.
        commands: Each is run in a subshell.
        in_place: Indices of those that the shell runs itself.

    Raises:
        ValueError: A command holds a NUL byte.
    """
    lines = [_boundary(nonce, BEGIN, "0")]
    for index, command in enumerate(commands):
        run = f"{{ eval {quote(command)}; }}" if index in in_place else f"(eval {quote(command)})"
        lines.append(f"{run} </dev/null; _s=$?; {_boundary(nonce, str(index), '$_s')}")
    return ("\n".join(lines) + "\n").encode("utf-8", "surrogateescape")


def _boundary(nonce: str, index: str, status: str) -> str:
    """Return the shell text that prints one boundary on both streams."""
    text = f"printf '\\n%s %s %s\\n' {nonce} {index} {status}"
    return f"{text}; {text} >&2"


class Frames:
    """One stream of one batch, cut at its boundaries as the bytes come in."""

    def __init__(self, nonce: str, count: int, *, only_end: bool = False) -> None:
        """Expect `count` answers behind the first boundary; with `only_end`, one of any length, of which the end."""
        self._only_end = only_end
        self._size = 0
        self._mark = f"\n{nonce} ".encode("ascii")
        self._count = count
        self._buffer = bytearray()
        self._scanned = 0
        self._told = 0
        self.begun = False
        self.answers: list[tuple[bytes, int]] = []
        """(output, exit status) in order"""

    @property
    def done(self) -> bool:
        """Tell whether every answer is here."""
        return self.begun and len(self.answers) == self._count

    def feed(self, data: bytes) -> None:
        """Take the next bytes of the stream, any number of them.

        Raises:
            ValueError: A boundary is not the next one in order, or what is sent is longer than any answer.
        """
        self._buffer += data
        self._size += len(data)
        while not self.done:
            start = self._buffer.find(self._mark, self._scanned)
            end = self._buffer.find(b"\n", start + len(self._mark)) if start >= 0 else -1
            if end < 0:
                # A boundary may begin in the bytes that are here and end in those to come.
                self._scanned = start if start >= 0 else max(0, len(self._buffer) - len(self._mark))
                self._limit(start)
                return
            self._cut(start, end)

    def _limit(self, start: int) -> None:
        """Refuse (ValueError) what no answer has, or forget the beginning of an output of which only the end counts."""
        if start >= 0 and len(self._buffer) - start > len(self._mark) + _LONGEST_BOUNDARY:
            raise ValueError("the robot's shell began a boundary that does not end")
        if self._only_end and self.begun:
            if start < 0 and (surplus := len(self._buffer) - _KEPT) > _KEPT:
                del self._buffer[:surplus]
                self._scanned, self._told = self._scanned - surplus, max(0, self._told - surplus)
        elif self._size > LONGEST:
            raise ValueError(f"the robot's shell sent more than {LONGEST >> 20} MiB where answers were expected")

    def _cut(self, start: int, end: int) -> None:
        """Take one answer out of the buffer: it ends at `start`, its boundary at `end`."""
        said = bytes(self._buffer[start + len(self._mark) : end][:_LONGEST_BOUNDARY]).decode("ascii", "replace")
        index, _, status = said.partition(" ")
        expected = str(len(self.answers)) if self.begun else BEGIN
        if index != expected or not _STATUS.fullmatch(status):
            raise ValueError(f"the robot's shell answered {index!r} where {expected!r} was expected")
        if self.begun:
            self.answers.append((bytes(self._buffer[:start]), int(status)))
        self.begun = True
        del self._buffer[: end + 1]
        self._scanned = 0

    def new_lines(self) -> Iterator[str]:
        """Return the complete lines of a batch's only answer, each once; blank ones are left out.

        The newline that opens a boundary never closes a line of its own, so leaving blank lines out is what keeps half
        a boundary from being taken for output.
        """
        if not self.begun:
            return
        text = self.answers[0][0] if self.answers else self._buffer
        end = len(text) if self.answers else text.rfind(b"\n")
        if end > self._told:
            piece, self._told = bytes(text[self._told : end]), end
            yield from _lines(piece, self._mark)


def _lines(text: bytes, mark: bytes) -> Iterator[str]:
    """Decode lines, without blank ones and without a boundary."""
    for line in text.split(b"\n"):
        if line.strip() and not line.startswith(mark[1:]):
            yield line.rstrip(b"\r")[: 4 * _LONGEST_LINE].decode("utf-8", "replace")[:_LONGEST_LINE]
