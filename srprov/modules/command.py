"""Commands that run on a robot unless a check says that there is nothing to do.

The name is only a name.

What a command did cannot be found by looking around, so nothing of it is listed, owned or taken away again. Only who
knows the wish can ask: `probes` and `probed` stand beside `queries` and `parse`. The check is asked when planning,
right before the command runs, and again after it.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from srprov.modules.module import Module
from srprov.modules.params import ParameterError
from srprov.resource import Action, Change, Observed, State
from srprov.untrusted import integer
from srprov.wire import AnyQuery, Command, Query, Reply, Run, sh

CHECK_S = 10
"""Seconds that a check may take."""
_GRACE_S = 5
_TIMED_OUT = 124
"""What timeout(1) exits with."""
_NO_ANSWER = 255


class CommandParams(msgspec.Struct, frozen=True, kw_only=True):
    """What a playbook says of a command: `argv` or `shell`, and a check, of which both parts must hold."""

    argv: tuple[str, ...] = ()
    shell: str = ""
    """Text for `sh -c`."""
    unless: str | tuple[str, ...] = ""
    """Text for `sh -c` or words: nothing to do when it exits with 0."""
    creates: str = ""
    """A path: nothing to do when it is there."""
    timeout: int = 60
    """Seconds."""

    def __post_init__(self) -> None:
        """Refuse one with two commands or with none, and one without a check."""
        if bool(self.argv) == bool(self.shell):
            raise ParameterError("argv", "a command needs either 'argv' or 'shell'")
        if not (self.unless or self.creates):
            raise ParameterError("unless", "a command needs 'unless' or 'creates'")


class CommandModule(Module[CommandParams]):
    """The module of kind `command`."""

    kind = "command"
    params = CommandParams
    same_in_trials = True

    def queries(self) -> tuple[AnyQuery, ...]:
        """Ask nothing: see `probes`."""
        return ()

    def parse(self, replies: Sequence[Reply]) -> tuple[Observed, ...]:
        """Find nothing."""
        return ()

    def probes(self, name: str, want: CommandParams) -> tuple[Query, ...]:
        """Run the check and print its exit code; it reads nothing, and what it says is dropped."""
        bounded = sh("timeout", "-k", "2", str(CHECK_S), "sh", "-c", _check(want))
        return (Query(command=f"{bounded} </dev/null >/dev/null 2>&1; echo $?", timeout_s=CHECK_S + 2.0 * _GRACE_S),)

    def probed(self, name: str, want: CommandParams, replies: Sequence[Reply]) -> Observed:
        """Read the exit code."""
        code = integer(replies[0].out.strip(), default=_NO_ANSWER)
        # the code is told, but two different ones are the same to a plan that is kept: the command is due
        return Observed(module=self.kind, name=name, instance="", state={"holds": code == 0, "status": code})

    def check(self, name: str, want: CommandParams, found: State | None) -> Change | None:
        """Ask whether the check holds; if not, the command runs within its time."""
        if found is not None and found["holds"]:
            return None
        bounded = sh("timeout", "-k", str(_GRACE_S), str(want.timeout), *(want.argv or ("sh", "-c", want.shell)))
        explain = f'test "$s" != {_TIMED_OUT} || echo "not done after {want.timeout} s" >&2'
        script = f'{bounded} </dev/null; s=$?; {explain}; exit "$s"'
        run = Run(script=script, timeout_s=want.timeout + 2.0 * _GRACE_S)
        return Change(action=Action.RUN, cause=_cause(want, found), before=found, commands=(run,))

    def removal(self, found: Observed) -> tuple[Command, ...]:
        """Do nothing: nobody knows how to undo a command."""
        return ()


def _check(want: CommandParams) -> str:
    parts = [sh("test", "-e", want.creates)] if want.creates else []
    if want.unless:
        parts.append(sh("sh", "-c", want.unless) if isinstance(want.unless, str) else sh(*want.unless))
    return " && ".join(parts)


def _cause(want: CommandParams, found: State | None) -> str:
    if found is None or found["status"] == _NO_ANSWER:
        return "its check gave no answer"
    if found["status"] == _TIMED_OUT:
        return f"its check was not done after {CHECK_S} s"
    if not want.unless:
        return f"{want.creates} is not there"
    text = " ".join((want.unless if isinstance(want.unless, str) else sh(*want.unless)).split())
    shown = text if len(text) <= 60 else text[:59] + "…"
    creates = f"{want.creates} is not there, or " if want.creates else ""
    return f"{creates}its check exits with {found['status']}: {shown}"
