"""What of an instance runs where, and what of it is missing or wrong.

What should be there is what the placement record says that is believed, and with an EDF also the services of it that
were never placed. Reads what this machine remembers of its runs; all else is pure.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import msgspec

from srprov.controller.ownership import looking
from srprov.definitions.expand import expand
from srprov.definitions.model import Experiment
from srprov.facts.model import Snapshot
from srprov.modules import RUNNING
from srprov.modules.isolated import ISOLATED
from srprov.network.identity import link_names, tunnel_name
from srprov.network.record import PlacementRecord, read_record
from srprov.resource import Observed, State

_NOBODY = PlacementRecord()
_STATES = {"paused": "paused", "restarting": "restarting"}


class Status(msgspec.Struct, frozen=True, kw_only=True):
    """The rows of `srprov status`, as its schema describes them."""

    services: list[dict[str, Any]]
    """One per container, and one per service that should have one and has none in reach."""
    links: list[dict[str, Any]]
    """One per network of Docker and VXLAN link that a robot with services on the overlay lacks."""
    disputes: tuple[str, ...] = ()
    """What robots say that contradicts others, or that nobody can confirm."""
    notes: tuple[str, ...] = ()
    """What else there is to say of the robots' records."""
    trials: str = ""
    """Why nothing is missing although no service of the trials has a container; empty where that is not so."""

    @property
    def as_it_should_be(self) -> bool:
        """Return whether nothing is missing or wrong."""
        return not self.links and not self.disputes and not any(row["problem"] for row in self.services)


def status_of(
    snapshot: Snapshot, instance: str = "", experiment: Experiment | None = None,
    by_trials: Callable[[str], bool] = lambda _instance: False,
) -> Status:  # fmt: skip
    """Return what is there, missing and wrong.

    Args:
        snapshot: The robots as they are.
        instance: The instance's id; empty: all of them.
        experiment: What the instance should be; None: what the robots' records say of it.
        by_trials: Says of an instance whether trials were what its services were last wanted for; asked where none of
            them has a container, and no EDF says so.

    Raises:
        UsageError: Two instances of a service would have one name.
    """
    looked = looking(snapshot, instance)
    snapshot = looked.snapshot
    found = _running(snapshot)
    names = [instance] if instance else sorted({*found, *snapshot.placements} - {""})
    states = {
        robot: {(item.module, item.name): item.state for item in items} for robot, items in snapshot.observed.items()
    }
    looks = [_Look(snapshot, states, name, found.get(name, ()), experiment) for name in names]
    rows: list[dict[str, Any]] = []
    lines: list[str] = []
    for look in looks:
        mine = list(look.rows())
        if experiment:
            mine, line = look.without_trials(mine)
        elif mine and all(row["problem"] == "missing" for row in mine) and by_trials(look.instance):
            mine, line = [], look.trials_line
        else:
            line = ""
        rows += mine
        lines += [line] * bool(line)
    return Status(
        services=sorted(rows, key=lambda row: (row["instance"], row["service"], row["robot"])),
        links=[link for look in looks for link in look.links()],
        disputes=looked.disputes,
        notes=looked.notes,
        trials="; ".join(lines),
    )


def _running(snapshot: Snapshot) -> dict[str, list[tuple[str, Observed]]]:
    """Return instance -> what runs its services, each with its robot. One look at all: robots may name many."""
    found: dict[str, list[tuple[str, Observed]]] = {}
    for host, items in snapshot.observed.items():
        for item in items:
            if item.module in RUNNING:
                found.setdefault(item.instance, []).append((host, item))
    return found


class _Look:
    """One instance: what robots have of it, and what they should have."""

    def __init__(
        self,
        snapshot: Snapshot,
        states: Mapping[str, Mapping[tuple[str, str], State]],
        instance: str,
        found: Sequence[tuple[str, Observed]],
        experiment: Experiment | None,
    ) -> None:
        self.snapshot, self.states, self.instance, self.found = snapshot, states, instance, found
        self.record = read_record(snapshot.placements.get(instance)) or _NOBODY
        tags = {robot: facts.tags for robot, facts in snapshot.facts.items()}
        away = {name: robot for name, robot in self.record.robots.items() if robot in snapshot.unreachable}
        self.wanted = expand(experiment, tags, away).services if experiment else None
        given = experiment.trials if experiment else None
        self.trials = given if given and given.designed else None

    def rows(self) -> Iterator[dict[str, Any]]:
        """Return a row per container, and per service without one."""
        there = {(item.service, host) for host, item in self.found}
        for host, item in self.found:
            yield self._row(item.service, host, item.state, self._problem(host, item, there))
        for service, robot in self.record.robots.items():
            if robot not in self.snapshot.facts:
                state = "unreachable" if robot in self.snapshot.unreachable else "not in the inventory"
                yield self._row(service, robot, {"status": state}, "unreachable")
            elif (service, robot) not in there and (self.wanted is None or service in self.wanted):
                yield self._row(service, robot, {"status": "missing"}, "missing")
        never = {name for name, one in (self.wanted or {}).items() if not one.profiles}
        nobody = bool(self.snapshot.unreachable) and not self.snapshot.facts  # then nobody can say what is missing
        problem = "unreachable" if nobody else "missing"
        for service in sorted(never - {service for service, _ in there} - set(self.record.robots)):
            yield self._row(service, "", {"status": "not known" if nobody else problem}, problem)

    def without_trials(self, rows: list[dict[str, Any]]) -> tuple[list[dict[str, Any]], str]:
        """Return the rows without those that only trials have, when none is under way, and a line that says so.

        Where one of these services has a container, it was applied, or a trial is under way: then all of them count.
        """
        if self.trials is None or not self.wanted:
            return rows, ""
        kept = self.trials.settings.keep
        mine = {name for name, one in self.wanted.items() if (one.instance_of or name) not in kept}
        if any(row["service"] in mine and row["problem"] != "missing" for row in rows):
            return rows, ""
        return [row for row in rows if row["service"] not in mine], self.trials_line

    @property
    def trials_line(self) -> str:
        """Return why nothing is missing."""
        return (
            f"{self.instance} has trials, and none is under way: `srprov run` makes their containers and removes them"
        )

    def _problem(self, host: str, item: Observed, there: set[tuple[str, str]]) -> str:
        """Return what is wrong with a container in one of the words of the schema, or nothing."""
        home, state = self.record.robots.get(item.service, host), item.state
        if home != host:
            return "duplicate" if (item.service, home) in there or home not in self.snapshot.facts else "misplaced"
        if self.wanted is not None and item.service not in self.wanted:
            return "unwanted"
        if state["state"] != "running":
            service = self.wanted[item.service] if self.wanted else None
            done = state["state"] == "exited" and state["exit_code"] == 0 and (not service or service.runtime.job)
            return "" if done else _STATES.get(state["state"], "stopped")
        address = self.record.addresses.get(item.service)
        if address and str(address) != self._address(host, item.service, state):
            return "address"
        return "unhealthy" if state["health"] == "unhealthy" else ""

    def _row(self, service: str, host: str, state: Mapping[str, Any], problem: str) -> dict[str, Any]:
        return {
            "instance": self.instance,
            "service": service,
            "robot": host,
            "state": state.get("status", ""),
            "health": state.get("health", ""),
            "address": self._address(host, service, state),
            "image": state.get("image", ""),
            "container": state.get("id", ""),
            "problem": problem,
            "placed_on": self.record.robots.get(service, ""),
            "given_address": str(self.record.addresses.get(service, "")),
        }

    def _address(self, host: str, service: str, state: Mapping[str, Any]) -> str:
        """Return a container's address; one of `both` has none of its own, it is on its robot's bridge or missing."""
        address = str(self.record.addresses.get(service, ""))
        if not address or service in self.record.macs:
            return next((one for one in state.get("addresses", {}).values() if one), "")
        link = self.states[host].get(("vxlan", link_names(self.instance)[1]), {}) if host in self.states else {}
        return address if state.get("state") == "running" and address in link.get("addresses", ()) else ""

    def links(self) -> Iterator[dict[str, Any]]:
        """Return what robots in reach lack of the overlay, by the kernel's and the engine's word."""
        bridge, link = link_names(self.instance)
        users = {self.record.robots[service] for service in self.record.addresses if service in self.record.robots}
        for robot in sorted(users & self.states.keys()):
            seen = self.states[robot]
            network = f"srprov.{self.instance}"
            if ("network", network) not in seen:
                yield self._lack(robot, "network", network, "missing")
            state = seen.get(("vxlan", link))
            if state is None:
                yield self._lack(robot, "vxlan", link, "missing")
            elif ISOLATED in state:
                yield self._lack(robot, "vxlan", link, "isolated")
            elif not state["up"] or state["bridge"] != bridge:
                yield self._lack(robot, "vxlan", link, "down" if not state["up"] else "detached")
            elif state.get("elsewhere") and not self._encrypts(robot):
                yield self._lack(robot, "wireguard", tunnel_name(self.instance), "missing")
            rules = seen.get(("vxlan_filter", link), {})
            count = rules.get("rules", 0)
            if state is not None and not state.get("elsewhere") and not 0 < count == rules["of"]:
                yield self._lack(robot, "vxlan_filter", link, "incomplete" if count else "missing")

    def _encrypts(self, robot: str) -> bool:
        """Return whether a robot's packets of an encrypted overlay go through an interface that is there."""
        netns, seen = tunnel_name(self.instance), self.states[robot]
        links = {name for kind, name in seen if kind == "wireguard" and seen[kind, name]["up"]}
        through = seen.get(("wireguard_routes", netns), {"through": {}})["through"].values()
        return bool(links) and links.issuperset(through)

    def _lack(self, robot: str, kind: str, name: str, problem: str) -> dict[str, Any]:
        return {"instance": self.instance, "robot": robot, "kind": kind, "name": name, "problem": problem}
