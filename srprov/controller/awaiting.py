"""`srprov wait`: conditions of a running experiment, waited for until all of them hold, or one cannot hold any more.

Takes what the user wrote and where services are; only reads robots.
"""

from __future__ import annotations

import contextlib
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence

import msgspec

from srprov.codes import Code
from srprov.controller.fleet import Fleet
from srprov.controller.located import Located, Whereabouts
from srprov.errors import TransportError, UsageError
from srprov.execution.watching import Place, Seen, Watch
from srprov.linear_regex import check_pattern
from srprov.trials.reading import Reading

_REMIND_S = 30.0
_LOOK_S = 1.0
_MOST_LOGS = 4
"""Streams that a session has to an engine."""
_FORMS = "completed:SERVICE, healthy, healthy:SERVICE or log:SERVICE=REGEX"


class Awaited(msgspec.Struct, frozen=True, kw_only=True):
    """One condition."""

    text: str
    """As the user wrote it."""
    kind: str
    """`completed`, `healthy` or `log`."""
    every: bool = False
    """It is about all services with a healthcheck."""
    pattern: str = ""
    services: tuple[Located, ...] = ()


class Standing(msgspec.Struct, frozen=True, kw_only=True):
    """How one service stands to a condition."""

    holds: bool = False
    never: bool = False
    """It cannot hold any more."""
    words: str = ""


class Waited(msgspec.Struct, frozen=True, kw_only=True):
    """How it ended."""

    why: str = ""
    """Why not all conditions hold; empty when they do."""
    unreachable: bool = False
    """A robot stayed away."""


def awaited(texts: Iterable[str], there: Whereabouts) -> tuple[Awaited, ...]:
    """Read conditions.

    Raises:
        UsageError: One is none, or names no service; or no service has a healthcheck.
    """
    return tuple(_read(text, there) for text in dict.fromkeys(texts))


def _read(text: str, there: Whereabouts) -> Awaited:
    kind, colon, rest = text.partition(":")
    service, _, pattern = rest.partition("=") if kind == "log" else (rest, "", "")
    if kind not in ("completed", "healthy", "log") or (colon and not service) or bool(pattern) != (kind == "log"):
        raise UsageError(f"--until takes no '{text}'", hint=f"write {_FORMS}", code=Code.OPTION_VALUE)
    if kind == "healthy" and not colon:
        return _all_healthy(text, there)
    if not colon:
        raise UsageError(f"--until {text}: which service?", hint=f"write {_FORMS}", code=Code.OPTION_VALUE)
    try:
        check_pattern(pattern)
    except ValueError as error:
        raise UsageError(f"--until {text}: {error}", code=Code.OPTION_VALUE) from None
    return Awaited(text=text, kind=kind, pattern=pattern, services=there.named([service]))


def _all_healthy(text: str, there: Whereabouts) -> Awaited:
    services = there.named(())
    checked = [one for one in services if one.found is None or one.found.state["health"]]
    if not checked:
        raise UsageError(
            f"no running service of {there.instance} has a healthcheck", hint="name what is awaited", code=Code.AWAITED
        )
    return Awaited(text=text, kind="healthy", every=True, services=tuple(services))


def standing(what: Awaited, one: Located, seen: Seen) -> Standing:
    """Return how a service stands to a condition."""
    place = (one.host, one.container)
    if what.kind == "log" and (place, what.pattern) in seen.matched:
        return Standing(holds=True)
    reading = seen.readings.get(place)
    if reading is None:
        return Standing(words=f"{one.where} was not seen yet")
    if not reading.state:
        return Standing(never=True, words=f"{one.where} has no container (`srprov apply` makes one)")
    if what.kind == "healthy":
        return _health(what, one, reading)
    if not reading.ended:
        printed = " and has not printed it" if what.kind == "log" else ""
        return Standing(words=f"{one.where} is {reading.state}{printed}")
    if what.kind == "completed":
        done = not reading.exit_code
        return Standing(holds=done, never=not done, words="" if done else f"{one.where} {_exit(reading)}")
    printed = " and has not printed it"
    return Standing(never=place in seen.read, words=f"{one.where} {_exit(reading)}{printed}")


def _health(what: Awaited, one: Located, reading: Reading) -> Standing:
    if what.every and not reading.health and reading.state != "created":
        return Standing(holds=True)  # it has no healthcheck
    if reading.ended:
        fine = what.every and not reading.exit_code
        return Standing(holds=fine, never=not fine, words="" if fine else f"{one.where} {_exit(reading)}")
    if reading.state == "running" and not reading.health:
        return Standing(never=True, words=f"{one.where} has no healthcheck")
    well = reading.state == "running" and reading.health == "healthy"
    state = reading.health if reading.state == "running" else reading.state
    return Standing(holds=well, words="" if well else f"{one.where} is {state}")


def _exit(reading: Reading) -> str:
    return f"exited with code {reading.exit_code}{' (out of memory)' if reading.oom else ''}"


def wait(conditions: Sequence[Awaited], fleet: Fleet, seconds: float, say: Callable[[str], None]) -> Waited:
    """Wait until all conditions hold at the same time, one cannot hold any more, or the time is over.

    Args:
        conditions: What is awaited.
        fleet: The robots.
        seconds: From now.
        say: Told at once who is awaited, what holds, and every 30 s what does not.
    """
    begun = said = time.monotonic()
    names = [f"{one.text} ({', '.join(s.where for s in one.services)})" for one in conditions]
    say(f"waiting up to {seconds:g} s for {'; '.join(names)}")
    held: set[str] = set()
    with _watch(conditions, fleet, say) as watch:
        while True:
            watch.news.clear()
            seen = watch.seen()
            open_ones = _open(conditions, seen)
            waited = time.monotonic() - begun
            for one in conditions:
                if one.text not in {*held, *open_ones}:
                    held.add(one.text)
                    say(f"{one.text} holds after {waited:.1f} s")
            if ended := _ended(open_ones, seen, waited >= seconds, seconds):
                return ended
            if time.monotonic() - said >= _REMIND_S:
                said = time.monotonic()
                say(f"still waiting, {seconds - waited:.0f} s more at most: {_in_words(open_ones)}")
            watch.news.wait(max(0.0, min(_LOOK_S, seconds - waited)))


def _watch(conditions: Sequence[Awaited], fleet: Fleet, say: Callable[[str], None]) -> Watch:
    places: dict[Place, list[str]] = {}
    for one in conditions:
        for service in one.services:
            places.setdefault((service.host, service.container), []).extend([one.pattern] * bool(one.pattern))

    logs = Counter(host for (host, _), patterns in places.items() if patterns)
    if crowded := [host for host, count in logs.items() if count > _MOST_LOGS]:
        raise UsageError(
            f"no more than {_MOST_LOGS} logs of one robot can be waited for: {', '.join(crowded)}", code=Code.AWAITED
        )

    def renew(host: str) -> None:
        with contextlib.suppress(TransportError):  # it may never have been reached
            fleet.sessions.get(host).close()
        fleet.sessions.again(host)

    return Watch(fleet.sessions.get, renew, places, say)


def _open(conditions: Sequence[Awaited], seen: Seen) -> dict[str, list[Standing]]:
    """Return condition -> services that it does not hold for; one that holds is not in it."""
    standings = {what.text: [standing(what, one, seen) for one in what.services] for what in conditions}
    return {text: short for text, some in standings.items() if (short := [one for one in some if not one.holds])}


def _ended(open_ones: dict[str, list[Standing]], seen: Seen, late: bool, seconds: float) -> Waited | None:
    if not open_ones:
        return Waited()
    never = {text: [one for one in some if one.never] for text, some in open_ones.items()}
    if hopeless := {text: some for text, some in never.items() if some}:
        return Waited(why=f"cannot hold any more: {_in_words(hopeless)}")
    if seen.failed:
        return Waited(why="; ".join(seen.failed.values()), unreachable=True)
    if late:
        return Waited(why=f"not within {seconds:g} s: {_in_words(open_ones)}; --wait-timeout gives it longer")
    return None


def _in_words(open_ones: dict[str, list[Standing]]) -> str:
    return "; ".join(f"{text}: {', '.join(one.words for one in some)}" for text, some in open_ones.items())
