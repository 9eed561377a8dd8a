"""Services that run twice, or may: they were placed elsewhere while their robot was out of reach. Pure."""

from __future__ import annotations

from collections.abc import Mapping

from srprov.assignment.model import Assignment
from srprov.controller.ownership import previous_robots
from srprov.controller.render_inputs import RenderInputs
from srprov.controller.robots_words import names_notes
from srprov.facts.model import Snapshot
from srprov.modules import RUNNING


def copies(snapshot: Snapshot, instance: str, placed: Mapping[str, str]) -> tuple[str, ...]:
    """Return a note for each service that a plan leaves, or finds, on two robots.

    Args:
        snapshot: The robots as they are.
        instance: The instance's id.
        placed: Service -> its robot from now on.
    """
    behind = [
        f"{service} may still run on {robot}, which cannot be reached: then there are two of it with one address, "
        f"the other on {placed[service]}; the next apply that reaches {robot} removes the old one"
        for service, robot in sorted(previous_robots(snapshot, instance).items())
        if robot in snapshot.unreachable and placed.get(service, robot) != robot
    ]
    running: dict[str, list[str]] = {}
    for host, items in sorted(snapshot.observed.items()):
        for item in items:
            if item.module in RUNNING and item.instance == instance and item.state["state"] == "running":
                running.setdefault(item.service, []).append(host)
    twice = [
        f"{service} runs on {' and '.join(hosts)}, with one address: the placement record that is believed "
        f"names {placed[service]}, what is elsewhere is a copy from before"
        for service, hosts in sorted(running.items())
        if len(hosts) > 1 and service in placed
    ]
    return (*behind, *twice)


def placement_notes(inputs: RenderInputs, placed: Assignment) -> tuple[str, ...]:
    """Return notes on what is where: services that stay or may run twice, a search that was stopped, what moves."""
    twice = copies(inputs.snapshot, inputs.instance, placed.placed)
    stay = [f"{service} stays on {placed.placed[service]}, which cannot be reached" for service in placed.frozen]
    if placed.gap:
        stay.append(f"the search for the best placement was stopped; {placed.gap:.3f} less may be possible")
    moving = sorted({one for image in inputs.images.values() for one in image.moving})
    return (*twice, *stay, *moving, *names_notes(inputs.experiment, placed.placed, inputs.snapshot.facts))
