"""The words by which a robot's containers may mean hosts: none of them is a name of another robot's container.

In an experiment every service finds every other one by its name. A robot chooses how its containers are called: with a
name that another robot's containers speak to, it would get what they send there, passwords too. Takes what engines say
of containers; gives an answer for each name. Pure. What only stands in files, or in an image, is not seen.
"""

from __future__ import annotations

import dataclasses
import re
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from srprov.snapshot.containers import Service
from srprov.snapshot.notes import Notes
from srprov.untrusted import mapping, string, strings, text

_WORD = re.compile(r"([\\%-]?)([a-z0-9_-]+)")
"""Of a name with dots each part is one: which of them a resolver adds is not known. Behind a sign with which an escape
or an option may begin, a name may stand anywhere in it: `\\tdb`, `%2Fdb`, `-hdb`."""


class NamesThere:
    """The words of some robots."""

    def __init__(self, boxes: Mapping[str, Iterable[Mapping[str, Any]]]) -> None:
        """Take each robot's containers, as its engine has them."""
        self._of = {robot: _Words(some) for robot, some in boxes.items()}

    def mean_others(self, robot: str, name: str) -> bool:
        """Return whether containers of another robot than this one may mean something by a name."""
        return any(words.mean(name.lower()) for other, words in self._of.items() if other != robot)

    def without_hostname(self, robot: str, service: Service, notes: Notes) -> Service:
        """Return a service of a robot without a hostname that is a host's elsewhere: all services would find it so."""
        hostname = str(service.fields.get("hostname", ""))
        alone = all(name == robot or words.none for name, words in self._of.items())
        if not hostname or alone or ("." not in hostname and not self.mean_others(robot, hostname)):
            return service
        words = f"its hostname {text(hostname, length=60)}: containers of other robots would take it for that host"
        notes.lost(f"container {service.name}", words)
        kept = {key: value for key, value in service.fields.items() if key != "hostname"}
        return dataclasses.replace(service, fields=kept)


class _Words:
    """Those of one robot."""

    def __init__(self, boxes: Iterable[Mapping[str, Any]]) -> None:
        found = {one.groups() for box in boxes for said in _texts(box) for one in _WORD.finditer(said.lower())}
        self._whole = frozenset(word.strip("-_") for _, word in found)
        # from the end of each, so that those with one end stand together
        self._glued = sorted(word.rstrip("-_")[::-1] for sign, word in found if sign)
        self.none = not found

    def mean(self, name: str) -> bool:
        """Return whether one of them may be a name."""
        end = name[::-1]
        at = bisect_left(self._glued, end)
        return name in self._whole or (at < len(self._glued) and self._glued[at].startswith(end))


def _texts(box: Mapping[str, Any]) -> Iterator[str]:
    config, host = mapping(box.get("Config")), mapping(box.get("HostConfig"))
    yield from (string(box.get("Name")), string(config.get("Hostname")))
    for key in ("Env", "Cmd", "Entrypoint"):
        yield from strings(config.get(key))
    yield from strings(mapping(config.get("Healthcheck")).get("Test"))
    for key in ("Links", "ExtraHosts"):
        yield from strings(host.get(key))
    for one in mapping(mapping(box.get("NetworkSettings")).get("Networks")).values():
        for key in ("Aliases", "DNSNames"):
            yield from strings(mapping(one).get(key))
