"""What of ours exists on one robot, of all kinds together: each module says what to ask and reads the answers."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from srprov import names
from srprov.modules import MODULES, PROBING
from srprov.resource import Observed, Resource
from srprov.robot_answers import TooManyError
from srprov.wire import AnyQuery, Reply

MOST_OF_INSTANCE = _MOST = 1000
"""Things of any kind that a robot has of one instance, and things of a kind that it has: plans and tables grow with
them, and with their pairs, and a robot may say anything."""
_SERVICE = re.compile("[a-z0-9][a-z0-9_-]{0,400}")
_OF_ENGINE = ("container", "network", "volume")
_ENGINES_NAME = re.compile("[a-zA-Z0-9][a-zA-Z0-9_.-]{0,254}")
"""As engines give them (moby's RestrictedNamePattern), and as long as a folder's name can be."""
_MOST_SMALL = dict.fromkeys(("image", "file", "secret"), 10_000)
"""Images are nobody's, and one service may have many files."""


def most_of(kind: str) -> int:
    """Return how many things of a kind a robot may have."""
    return _MOST_SMALL.get(kind, _MOST)


def observe_queries(kinds: Iterable[str] = tuple(MODULES)) -> tuple[AnyQuery, ...]:
    """Return the queries of these kinds, in the order that `parse_observed` expects."""
    return tuple(query for kind in kinds for query in MODULES[kind].queries())


def parse_observed(replies: Sequence[Reply], kinds: Iterable[str] = tuple(MODULES)) -> tuple[Observed, ...]:
    """Read the replies to `observe_queries(kinds)`.

    Raises:
        TooManyError: There are more things of a kind than a robot can have.
        ValueError: One has a name, or a text in its state, that no robot's thing can have, or one of ours stands twice.
    """
    found: list[Observed] = []
    start = 0
    for kind in kinds:
        count = len(MODULES[kind].queries())
        # the label of an instance or service that cannot be is not ours: names become paths, containers and words
        seen = MODULES[kind].parse(replies[start : start + count])
        ours = [one for one in seen if not one.instance or (names.valid("instance", one.instance) and _is_named(one))]
        if len(ours) > (most := most_of(kind)):
            raise TooManyError(f"it has more than {most} things of the kind {kind}")
        for one in ours:
            _check(one)
        found += ours
        start += count
    # what a build left is whoever's who comes next
    ours_by_name = Counter((one.module, one.name) for one in found if one.instance or one.state.get("leftover"))
    if ours_by_name and (most_named := ours_by_name.most_common(1)[0])[1] > 1:
        kind, name = most_named[0]
        raise ValueError(f"it names the {kind} {name[:60]!r} twice")  # two steps would be about one thing
    of_instances = Counter(one.instance for one in found if one.instance)
    if of_instances and (largest := of_instances.most_common(1)[0])[1] > MOST_OF_INSTANCE:
        raise TooManyError(f"it has more than {MOST_OF_INSTANCE} things of the instance {largest[0]}")
    return tuple(found)


def _is_named(one: Observed) -> bool:
    """Return whether it is called as such a thing can be: a name stands in sentences, beside commands to be copied.

    A service may have a robot's name behind it that was made to fit.
    """
    named = one.module not in _OF_ENGINE or _ENGINES_NAME.fullmatch(one.name) is not None
    return named and (one.service == "" or _SERVICE.fullmatch(one.service) is not None)


def _check(one: Observed) -> None:
    """Refuse (ValueError) what no command could be about: plans for all robots are made of these words later."""
    # an image's labels are its author's
    if _has_nul(one.name) or (one.module != "image" and _has_nul(one.state)):
        raise ValueError(f"a NUL in what it says of {one.module} {one.name[:60]!r}")
    if one.instance and not MODULES[one.module].shared:
        MODULES[one.module].removal(one)


def _has_nul(value: object) -> bool:
    if isinstance(value, str):
        return "\0" in value
    if isinstance(value, Mapping):
        return any(_has_nul(key) or _has_nul(one) for key, one in value.items())
    return isinstance(value, list | tuple) and any(map(_has_nul, value))


def probe_queries(wants: Iterable[Resource]) -> tuple[AnyQuery, ...]:
    """Return what to ask for those of the wanted resources that do not show by themselves."""
    return tuple(
        query
        for want in wants
        if want.module in PROBING
        for query in PROBING[want.module].probes(want.name, want.params)
    )


def parse_probed(replies: Sequence[Reply], wants: Iterable[Resource]) -> tuple[Observed, ...]:
    """Read the replies to `probe_queries(wants)`."""
    found: list[Observed] = []
    start = 0
    for want in wants:
        if want.module in PROBING:
            count = len(PROBING[want.module].probes(want.name, want.params))
            found.append(PROBING[want.module].probed(want.name, want.params, replies[start : start + count]))
            start += count
    return tuple(found)
