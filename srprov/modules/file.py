"""Rendered files below the instance's folder on a robot.

The name is the absolute path.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec

from srprov.hashing import sha256_of
from srprov.modules.differences import read_start, text_difference, whole_difference
from srprov.modules.module import DISCOVERY_FILE, STATE_ROOT, Module, Names
from srprov.modules.params import AnyText, Mode, ParameterError
from srprov.resource import Action, Change, Difference, Observed, State
from srprov.robot_answers import all_lines
from srprov.wire import AnyQuery, Command, Put, Query, Reply, Run, quote

_BELOW = f"{STATE_ROOT}/"
# links are named, so that what they lead to is not taken for ours; the shell itself starts no program for that
_LIST = f"""\
set -- {STATE_ROOT}/*/* {STATE_ROOT}/*/.[!.]*
for f; do [ -L "$f" ] && printf 'link  %s\n' "$f"; done
[ -e "$1" ] || [ -e "$2" ] && sha256sum "$@" 2>/dev/null
:"""
_OWN = re.compile(rf"placement\.json|hosts(-[A-Za-z0-9_][A-Za-z0-9_.-]*)?|{DISCOVERY_FILE}")
_MIN_PARTS = 2
_READABLE = Mode(0o644)


class FileParams(msgspec.Struct, frozen=True, kw_only=True):
    """What a playbook says of a file."""

    content: AnyText | None = None
    blob: bytes | None = None
    """Its content, for a long one that many robots have: it stands once in plan files and records."""
    mode: Mode = _READABLE
    in_place: bool = False
    """Keep the inode: a file that is mounted into running containers must be rewritten, not replaced."""

    def __post_init__(self) -> None:
        """Refuse (ParameterError) none and both."""
        if self.content is None and self.blob is None:
            raise ParameterError("content", "the parameter 'content' is missing")
        if self.content is not None and self.blob is not None:
            raise ParameterError("blob", "there is content beside it")

    @property
    def data(self) -> bytes:
        """The content as it is written."""
        return self.blob if self.blob is not None else (self.content or "").encode()

    @property
    def text(self) -> str:
        """The content as text."""
        return self.content if self.content is not None else self.data.decode("utf-8", "replace")


class FileModule(Module[FileParams]):
    """The module of kind `file`."""

    kind = "file"
    params = FileParams
    common = True
    shares_round_trip = True
    same_in_trials = True
    root = STATE_ROOT

    def queries(self) -> tuple[AnyQuery, ...]:
        """Hash the files directly inside each instance's folder; shipped trees lie deeper and are not read."""
        return (Query(command=_LIST, in_place=True),)

    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Read `sha256  PATH` lines; a link is no file of ours."""
        said = [line.partition("  ")[::2] for line in all_lines(replies[0].out)]
        links = {path for word, path in said if word == "link"}
        found = []
        for sha, path in said:
            parts = path.removeprefix(_BELOW).split("/") if path.startswith(_BELOW) and path not in links else []
            if len(sha) == hashlib.sha256().digest_size * 2 and len(parts) == _MIN_PARTS:
                found.append(Observed(module="file", name=path, instance=parts[0], state={"sha256": sha}))
        return tuple(found)

    def check(self, name: str, want: FileParams, found: State | None) -> Change | None:
        """Compare contents by hash; one that differs is written whole."""
        content = want.data
        if found is not None and found["sha256"] == sha256_of(content):
            return None
        write = Put(path=name, content=content, mode=want.mode, in_place=want.in_place and found is not None)
        if found is None:
            return Change(action=Action.CREATE, cause="not there", commands=(write,))
        return Change(action=Action.UPDATE, cause="content differs", before=found, commands=(write,))

    def is_plumbing(self, name: str) -> bool:
        """Compare with those that srprov's own playbooks write."""
        return _OWN.fullmatch(name.rpartition("/")[2]) is not None

    def old_queries(self, name: str, want: FileParams, found: State) -> tuple[AnyQuery, ...]:
        """Read its beginning."""
        return () if found["sha256"] == sha256_of(want.data) else (read_start(name),)

    def differences(self, want: FileParams, found: State, replies: Sequence[Reply]) -> tuple[Difference, ...]:
        """Compare line by line."""
        return (text_difference("content", replies[0], want.text),) if replies else ()

    def between(self, old: FileParams, new: FileParams) -> tuple[Difference, ...]:
        """Compare line by line."""
        same = old.data == new.data
        return () if same else (text_difference("content", Reply(status=0, out=old.text), new.text),)

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Remove it, and the instance's folder when it was the last thing there."""
        return (remove_path(found.name),)

    def is_own(self, name: str, want: FileParams, names: Names) -> bool:
        """Compare with those that an instance has; no permission but to read."""
        rest = name.removeprefix(f"{STATE_ROOT}/{names.instance}/")
        return rest != name and _OWN.fullmatch(rest) is not None and want.mode == _READABLE

    def misplaced(self, name: str, want: FileParams, context: Mapping[str, Any]) -> tuple[str, str] | None:
        """Say so of one in a deeper folder, too: those are not listed."""
        if wrong := super().misplaced(name, want, context):
            return wrong
        home = f"{self.root}/{context['instance']}"
        rest = name[len(home) + 1 :]
        if "/" in rest or rest in ("", ".", "..") or "\n" in rest or "\\" in rest:
            return f"the file '{name}' is not directly in {home}", "files of an instance lie side by side"
        return None


def whole(want: object, found: State, said: Sequence[Reply]) -> tuple[Difference, ...]:
    """Return what changes in a file of srprov's own, with each new line, or is in a new one; none for what is no file.

    In a plan of somebody else's they are his word, and one that is not shown may lead a service to his host.
    """
    if not isinstance(want, FileParams) or found.get("sha256") == sha256_of(want.data):
        return ()
    return (whole_difference("content", said[0] if said else Reply(status=1, ok=False), want.text),)


def remove_path(path: str, root: str = STATE_ROOT, *, with_root: bool = False) -> Run:
    """Return the script that removes a file or tree and then each folder above it, below `root`, that is empty.

    `with_root` tries the root itself, too.

    Raises:
        ValueError: The path is not inside an instance's folder; nothing else may ever be removed.
    """
    parts = path.removeprefix(root + "/").split("/")
    if not path.startswith(root + "/") or len(parts) < _MIN_PARTS or not all(p not in ("", ".", "..") for p in parts):
        raise ValueError(f"{path} is not inside an instance's folder")
    folders = [f"{root}/{'/'.join(parts[:n])}" for n in range(len(parts) - 1, 0, -1)] + [root] * with_root
    # rmdir refuses a folder that still holds something: that is the wanted end, not a failure
    tidy = "".join(f"; rmdir {quote(folder)} 2>/dev/null" for folder in folders)
    return Run(script=f"rm -rf {quote(path)} || exit 1{tidy}; test ! -e {quote(path)}")
