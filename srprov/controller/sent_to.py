"""Which container gets what a user sends: a file by `cp`, the words and the input of `exec`.

Takes where services are, as `located.py` found it; gives one, or refuses. Whoever only looks goes by that alone.
"""

from __future__ import annotations

from srprov.codes import Code
from srprov.controller.located import Located, Whereabouts
from srprov.controller.ownership import shown_maker
from srprov.errors import RefusedError, UsageError
from srprov.names import few

_MOST_AWAY = 8


def trusted(there: Whereabouts, word: str, source: str) -> Located:
    """Return the one container that a word means, for who sends something of the user's own there.

    The user names his EDF, of this `source`: what another file made is not meant by it, whatever that one calls itself,
    unless a run of this machine took it over.

    Each robot may say that a service is on it. The one that has it contradicts, or this machine knows better, or the
    EDF; where none does, the user says which robot he means. What this machine wrote before its last run is a robot's
    word while those that may have the newer record are silent; what that run placed nowhere is nowhere. Where this
    machine did not write what counts, another robot has to have it in its record, as all do whose instance it is.

    Raises:
        UsageError: It is more than one, or only its robot says that it is there.
        RefusedError: Another file made it.
    """
    found = _only(there.named([word]))
    if "@" in word:
        return found
    maker = str(found.found.state.get("source", "")) if found.found else ""
    adopted = there.remembered and found.placed and there.source == source
    if maker not in ("", source) and not adopted:
        raise RefusedError(
            f"{found.where} was made from {shown_maker(maker)}, not from {source}",
            hint=f"if you mean that one, name it with its robot: {found.service}@{found.host}",
            code=Code.OWNER,
        )
    if found.host in there.unreachable or not (why := _doubt(there, found)):
        return found
    raise UsageError(
        f"only {found.host} says that {found.service} is there: {why}",
        hint=f"name it with its robot: {found.service}@{found.host}",
        code=Code.DISPUTED,
    )


def _doubt(there: Whereabouts, found: Located) -> str:
    """Return why it may not be there, or nothing."""
    if found.host in there.strangers:
        return "a run of this machine knows another robot by that name"
    if there.unsure:
        silent = few(there.unsure, _MOST_AWAY)
        return f"a later run of this machine may have placed it elsewhere, which {silent} could tell"
    if there.remembered:
        return "" if found.placed else "the placement that counts here has it nowhere"
    service = there.by_name.get(found.service)
    pin = service.robot if service else ""
    nobody = "no run of this machine put it there"
    if pin not in ("", found.host):
        return f"{nobody}, and the EDF wants it on {pin}"
    if there.unreachable:
        return f"{nobody}, and {few(sorted(there.unreachable), _MOST_AWAY)} cannot be asked"
    return "" if found.placed else f"{nobody}, and no other robot has it in its record"


def _only(found: tuple[Located, ...]) -> Located:
    """Return the one container that is meant.

    Raises:
        UsageError: It is more than one.
    """
    if len(found) > 1:
        several = ", ".join(one.where for one in found)
        raise UsageError(
            f"that is more than one container: {several}", hint="name one of them, or SERVICE@ROBOT", code=Code.WHICH
        )
    return found[0]
