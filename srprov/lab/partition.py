"""Partitions: a robot is cut off from all others, or from one, without anybody being told.

Frames are dropped on the bridge (ebtables): nothing is refused, no error comes back, and what is
connected hangs. Addresses are still resolved (ARP passes), so a sender cannot even tell that its
neighbour is gone. The rules are the only record; they name the robots' links, and stay while a
robot is dead.
"""

from __future__ import annotations

from collections.abc import Iterable, Set
from itertools import pairwise

import msgspec

from srprov.lab.machine import find, require, run
from srprov.lab.places import Site, robot_name

ALL = "all"
CONTROLLER = "controller"


class Rule(msgspec.Struct, frozen=True, order=True):
    """Frames of this chain of the bridge, from and to these links, are dropped (empty: any link)."""

    chain: str
    source: str = ""
    target: str = ""

    @property
    def words(self) -> list[str]:
        """As ebtables takes it."""
        source = ["-i", self.source] if self.source else []
        target = ["-o", self.target] if self.target else []
        return [self.chain, "-p", "!", "ARP", *source, *target, "-j", "DROP"]


def rules(site: Site, name: str, other: str) -> list[Rule]:
    """What cuts a robot off from the other: ALL, CONTROLLER or a robot's name."""
    ours = site.link(name)
    controller = [Rule("INPUT", source=ours), Rule("OUTPUT", target=ours)]
    if other == CONTROLLER:
        return controller
    if other == ALL:
        return [*controller, Rule("FORWARD", source=ours), Rule("FORWARD", target=ours)]
    return [Rule("FORWARD", ours, site.link(other)), Rule("FORWARD", site.link(other), ours)]


def parse(site: Site, saved: str) -> set[Rule]:
    """The lab's rules in what `ebtables-save` prints."""
    found = set()
    for words in map(str.split, saved.splitlines()):
        links = dict(pairwise(words))
        rule = Rule(links.get("-A", ""), links.get("-i", ""), links.get("-o", ""))
        if words[:1] == ["-A"] and "DROP" in words and (rule.source + rule.target).startswith(site.link_prefix):
            found.add(rule)
    return found


def in_force(site: Site) -> set[Rule]:
    """The rules that there are."""
    return set() if find("ebtables-save") is None else parse(site, run(["ebtables-save"]))


def cut(site: Site, name: str, other: str) -> None:
    """Cut the robot off; no error if it is cut off already."""
    require({"ebtables": "iptables", "ebtables-save": "iptables"})
    there = in_force(site)
    for rule in rules(site, name, other):
        if rule not in there:
            run(["ebtables", "-I", *rule.words])


def heal(site: Site, name: str, other: str = ALL) -> bool:
    """Undo `cut`; for ALL, undo everything that cuts this robot off. False when there was nothing."""
    ours = site.link(name)
    there = in_force(site)
    wanted = {rule for rule in there if ours in (rule.source, rule.target)}
    return _delete(wanted if other == ALL else there.intersection(rules(site, name, other)))


def heal_all(site: Site) -> bool:
    """Undo every partition. False when there was none."""
    return _delete(in_force(site))


def _delete(found: Iterable[Rule]) -> bool:
    gone = sorted(found)
    for rule in gone:
        run(["ebtables", "-D", *rule.words])
    return bool(gone)


def cut_off(site: Site, name: str, there: Set[Rule]) -> list[str]:
    """From whom the robot is cut off: ALL alone, or CONTROLLER and the names of robots."""
    if there >= set(rules(site, name, ALL)):
        return [ALL]
    ours = site.link(name)
    pairs = [rule.target for rule in there if rule.source == ours and rule.chain == "FORWARD" and rule.target]
    robots = sorted(int(target.removeprefix(site.link_prefix)) for target in pairs)
    controller = [CONTROLLER] if there >= set(rules(site, name, CONTROLLER)) else []
    return [*controller, *(robot_name(number) for number in robots)]
