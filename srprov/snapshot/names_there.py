"""The words by which a robot's containers may mean hosts: none of them is a name of another robot's container.

In an experiment every service finds every other one by its name. A robot chooses how its containers are called: with a
name that another robot's containers speak to, it would get what they send there, passwords too. Takes what engines say
of containers; gives an answer for each name. Pure. What only stands in files, or in an image, is not seen.
"""

from __future__ import annotations

import dataclasses
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from srprov.snapshot.containers import Service
from srprov.snapshot.notes import Notes
from srprov.untrusted import mapping, string, strings, text

_WORD = re.compile(r"[a-z0-9_-]+")
"""Of a name with dots each part is one: which of them a resolver adds is not known."""


class NamesThere:
    """The words of some robots."""

    def __init__(self, boxes: Mapping[str, Iterable[Mapping[str, Any]]]) -> None:
        """Take each robot's containers, as its engine has them."""
        self._of = {robot: frozenset(_words(some)) for robot, some in boxes.items()}
        self._robots = Counter(word for words in self._of.values() for word in words)

    def mean_others(self, robot: str, name: str) -> bool:
        """Return whether containers of another robot than this one may mean something by a name."""
        return self._robots[name.lower()] > (name.lower() in self._of[robot])

    def without_hostname(self, robot: str, service: Service, notes: Notes) -> Service:
        """Return a service of a robot without a hostname that is a host's elsewhere: all services would find it so."""
        hostname = str(service.fields.get("hostname", ""))
        alone = all(name == robot or not words for name, words in self._of.items())
        if not hostname or alone or ("." not in hostname and not self.mean_others(robot, hostname)):
            return service
        words = f"its hostname {text(hostname, length=60)}: containers of other robots would take it for that host"
        notes.lost(f"container {service.name}", words)
        kept = {key: value for key, value in service.fields.items() if key != "hostname"}
        return dataclasses.replace(service, fields=kept)


def _words(boxes: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    for box in boxes:
        for one in _texts(box):
            for word in _WORD.findall(one.lower()):
                yield word.strip("-_")
                if word[:1] == "-":  # `-hdb` names the host `db`
                    yield word[2:]


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
