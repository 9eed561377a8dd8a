"""Commands that run on a robot unless a check says that there is nothing to do.

Wanted parameters: `argv` (words) or `shell` (text for `sh -c`); `unless` (text or words) and `creates` (a path), at
least one of them: the check; `timeout` (seconds). The name is only a name.

What a command did cannot be found by looking around, so nothing of it is listed, owned or taken away again. Only who
knows the wish can ask: `probes` and `probed` stand beside `queries` and `parse`. The check is asked when planning,
right before the command runs, and again after it.
"""

from __future__ import annotations

from collections.abc import Sequence

from srprov.modules.module import as_int
from srprov.resource import Action, Change, Observed, Resource, State
from srprov.wire import AnyQuery, Command, Query, Reply, Run, sh

CHECK_S = 10
"""Seconds that a check may take."""
DEFAULT_S = 60
_GRACE_S = 5
_LATE = 124
"""What timeout(1) exits with."""
_NO_ANSWER = 255


class CommandModule:
    """The module of kind `command`."""

    kind = "command"

    def queries(self) -> tuple[AnyQuery, ...]:
        """Ask nothing: see `probes`."""
        return ()

    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Find nothing."""
        return ()

    def probes(self, want: Resource) -> tuple[Query, ...]:
        """Run the check and print its exit code; it reads nothing, and what it says is dropped."""
        bounded = sh("timeout", "-k", "2", str(CHECK_S), "sh", "-c", _check(want))
        return (Query(command=f"{bounded} </dev/null >/dev/null 2>&1; echo $?", timeout_s=CHECK_S + 2.0 * _GRACE_S),)

    def probed(self, want: Resource, replies: Sequence[Reply]) -> Observed:
        """Read the exit code."""
        code = as_int(replies[0].out.strip(), _NO_ANSWER)
        # the code is told, but two different ones are the same to a plan that is kept: the command is due
        return Observed(module=self.kind, name=want.name, instance="", state={"holds": code == 0, "status": code})

    def check(self, want: Resource, found: State | None) -> Change | None:
        """Ask whether the check holds."""
        if found is not None and found["holds"]:
            return None
        return Change(action=Action.RUN, cause=_cause(want, found), before=found)

    def commands(self, want: Resource, change: Change) -> tuple[Command, ...]:
        """Run it, within its time."""
        seconds = int(want.params.get("timeout", DEFAULT_S))
        words = want.params["argv"] if "argv" in want.params else ["sh", "-c", want.params["shell"]]
        bounded = sh("timeout", "-k", str(_GRACE_S), str(seconds), *words)
        late = f'test "$s" != {_LATE} || echo "not done after {seconds} s" >&2'
        return (Run(script=f'{bounded} </dev/null; s=$?; {late}; exit "$s"', timeout_s=seconds + 2.0 * _GRACE_S),)

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Do nothing: nobody knows how to undo a command."""
        return ()


def _check(want: Resource) -> str:
    parts = [sh("test", "-e", want.params["creates"])] if "creates" in want.params else []
    if "unless" in want.params:
        unless = want.params["unless"]
        parts.append(sh("sh", "-c", unless) if isinstance(unless, str) else sh(*unless))
    return " && ".join(parts)


def _cause(want: Resource, found: State | None) -> str:
    if found is None or found["status"] == _NO_ANSWER:
        return "its check gave no answer"
    if found["status"] == _LATE:
        return f"its check was not done after {CHECK_S} s"
    if "unless" not in want.params:
        return f"{want.params['creates']} is not there"
    unless = want.params["unless"]
    text = " ".join((unless if isinstance(unless, str) else sh(*unless)).split())
    shown = text if len(text) <= 60 else text[:59] + "…"
    creates = f"{want.params['creates']} is not there, or " if "creates" in want.params else ""
    return f"{creates}its check exits with {found['status']}: {shown}"
