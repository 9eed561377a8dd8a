"""Data sets: read-only files that a robot has once, by content, for all instances that use them.

The name is `STATE_ROOT/<instance>/data/<sha256>`, a file that says that the instance uses it; it is empty once a
controller had the content to send from a file of its own, and holds `from HASH` when an address gave it. Who names
another address gets what that gives, also where the instance is called as another one's. The data set is
`STATE_ROOT/.data/<sha256>/data`: it appears there by one rename, when its hash was compared. The last instance that
uses it takes it away.
"""

from __future__ import annotations

import hashlib
import posixpath
import re
from collections.abc import Sequence

import msgspec

from srprov.modules.file import remove_path
from srprov.modules.module import STATE_ROOT, Module, Names
from srprov.modules.params import ParameterError
from srprov.resource import Action, Change, Observed, State
from srprov.robot_answers import all_lines
from srprov.wire import DATA_STORE, AnyQuery, Command, Query, Reply, Run, SendData, quote

_LIST = f"""\
for f in {STATE_ROOT}/*/data/*; do
  [ -f "$f" ] || continue
  said=; IFS= read -r said <"$f" || :
  [ -f {DATA_STORE}/"${{f##*/}}"/data ] || said=begun
  case $said in
    'from '*) printf '%s there%s\\n' "$f" "${{said#from}}" ;;
    ?*) printf '%s\\n' "$f" ;;
    *) printf '%s there\\n' "$f" ;;
  esac
done
:"""
_NAME = re.compile(rf"{STATE_ROOT}/([^/]+)/data/([0-9a-f]{{64}})")
_URL = re.compile(r"https://[A-Za-z0-9.-]+(:[0-9]{1,5})?/[!-~]{0,2000}")


class DataParams(msgspec.Struct, frozen=True, kw_only=True):
    """What a playbook says of a data set."""

    sha256: str
    size: int = 0
    """bytes; 0: not known"""
    url: str = ""
    """Where this machine downloads it, if it does not have it."""

    def __post_init__(self) -> None:
        """Refuse what an EDF could not say."""
        if not re.fullmatch("[0-9a-f]{64}", self.sha256):
            raise ParameterError("sha256", "sha256: expected 64 hexadecimal digits")
        if self.url and not _URL.fullmatch(self.url):
            raise ParameterError("url", "url: expected one that begins with https://")


class DataModule(Module[DataParams]):
    """The module of kind `data`."""

    kind = "data"
    params = DataParams
    root = STATE_ROOT

    def queries(self) -> tuple[AnyQuery, ...]:
        """List what instances use, and whether it is there."""
        return (Query(command=_LIST, in_place=True),)

    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Read one path per line, and `there`."""
        found = []
        for line in all_lines(replies[0].out):
            path, _, said = line.partition(" ")
            there, _, giver = said.partition(" ")
            if match := _NAME.fullmatch(path):
                state = {"there": there == "there", "giver": giver}
                found.append(Observed(module="data", name=path, instance=match[1], state=state))
        return tuple(found)

    def check(self, name: str, want: DataParams, found: State | None) -> Change | None:
        """Ask whether it is there; the robot has compared the hash before it put the content there."""
        given, giver = found is not None and found["there"], _giver(want.url)
        if found is not None and given and giver in ("", found.get("giver")):
            return None
        mark = f"mkdir -p {quote(posixpath.dirname(name))} && echo begun >{quote(name)}"
        size = f" ({want.size / (1 << 20):.1f} MiB)" if want.size else ""
        action = Action.CREATE if found is None else Action.UPDATE
        cause = f"not used there yet{size}"
        if found is not None:
            cause = "its content is not of that address" if given else f"its content is not there{size}"
        send = SendData(sha256=want.sha256, url=want.url)
        # whoever only knows the hash of what is there for others does not get it, also when he tries again
        end = f"echo {quote(f'from {giver}')} >{quote(name)}" if giver else f": >{quote(name)}"
        commands = (Run(script=mark), send, Run(script=end))
        return Change(action=action, cause=cause, before=found, commands=commands)

    def is_own(self, name: str, want: DataParams, names: Names) -> bool:
        """Compare the name with the hash."""
        return name == f"{STATE_ROOT}/{names.instance}/data/{want.sha256}"

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Remove the mark, and the content with the last one."""
        sha256 = found.name.rpartition("/")[2]
        last = (
            f"ls -d {STATE_ROOT}/*/data/{sha256} >/dev/null 2>&1 || rm -rf {DATA_STORE}/{sha256}; "
            f"rmdir {DATA_STORE} {STATE_ROOT} 2>/dev/null; :"
        )
        return (remove_path(found.name), Run(script=last))


def _giver(url: str) -> str:
    """Return what a robot notes of the address that gave a data set; nothing for a file of a controller."""
    return hashlib.sha256(url.encode()).hexdigest()[:32] if url else ""
