"""Whom `srprov probe` and a run ask, and what the last run of this machine found.

Takes what robots hold, or what a run gives them; gives what `execution/probing.py` asks.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from srprov.codes import Code
from srprov.controller.authority import wants_of
from srprov.controller.fleet import Fleet
from srprov.controller.ownership import looking
from srprov.controller.plan import Planned
from srprov.controller.robot_files import record_path
from srprov.errors import UsageError
from srprov.execution.probing import OverlayProbe, probe
from srprov.facts.model import Snapshot
from srprov.modules import MODULES
from srprov.network.identity import tunnel_name
from srprov.planning.plan import Plan
from srprov.probing.model import Request
from srprov.probing.request import among, request_of
from srprov.probing.verdict import Probed
from srprov.record.last import newest, record_json, records
from srprov.resource import Resource
from srprov.untrusted import mapping, parse_json

FILE = "probe.json"
"""In the record of a run, as `controller/run.py` writes it."""


def request_for(snapshot: Snapshot, instance: str) -> tuple[Request, tuple[str, ...]]:
    """Return what to probe of an instance by the record that is believed, and notes.

    Raises:
        UsageError: Robots know nothing of it, or disagree, or nothing of it is on an overlay.
    """
    looked = looking(snapshot, instance)
    placement = looked.snapshot.placements.get(instance)
    if looked.disputes:
        raise UsageError(
            looked.disputes[0], hint="`srprov plan` names the robots; --adopt of `apply` settles it", code=Code.DISPUTED
        )
    if placement is None:
        raise UsageError(
            f"nothing of {instance} on these robots", hint="`srprov apply` starts it", code=Code.NOTHING_RUNS
        )
    request = request_of(instance, placement, tunnel_port=_tunnel_port(instance, snapshot))
    if request is None:
        raise UsageError(
            f"no service of {instance} is on the overlay", hint="there is nothing to probe", code=Code.PROBE
        )
    return request, looked.notes


def probe_fleet(fleet: Fleet, snapshot: Snapshot, request: Request) -> Probed:
    """Probe with the robots as they were found, and look at their entries also when everything works."""
    return probe(OverlayProbe(request=request, architectures=_architectures(snapshot)), fleet.connected(), closer=True)


def probing_of(planned: Planned) -> OverlayProbe | None:
    """Return what to probe after a run; None where nothing is on an overlay, or the plan does not say who is.

    Robots that --limit leaves something to do on take no part: nobody says that they work by then.
    """
    wanted = wants_of(planned.saved) if planned.saved else planned.desired
    document = _wanted_record(wanted, planned.plan.instance)
    if document is None:
        return None
    tunnel = _tunnel_port(planned.plan.instance, planned.snapshot, wanted)
    request = request_of(planned.plan.instance, document, tunnel_port=tunnel)
    if request and planned.whole:
        services = {one.service for one in request.endpoints}
        request = among(request, set(request.robots) - _left_out(planned.whole, planned.plan), services)
    architectures = _architectures(planned.snapshot) if planned.snapshot else {}
    return OverlayProbe(request=request, architectures=architectures) if request and request.robots else None


def _wanted_record(wanted: Iterable[Resource], instance: str) -> Mapping[str, Any] | None:
    """Return the placement record that a plan writes; None where there is none."""
    path = record_path(instance)
    record = next((one.params.text for one in wanted if one.module == "file" and one.name == path), None)
    if record is None:
        return None
    try:
        return mapping(parse_json(record))
    except ValueError:  # a plan file may hold anything
        return None


def _left_out(whole: Plan, limited: Plan) -> set[str]:
    done = {step.number for step in limited.steps}
    left = [step for step in whole.steps if step.number not in done]
    return {step.host for step in left if MODULES[step.module].on_overlay}


def _tunnel_port(instance: str, snapshot: Snapshot | None, wanted: Iterable[Resource] = ()) -> int:
    """Return the port of WireGuard that robots shall have, else the one that most have; 0: nothing is encrypted."""
    netns = tunnel_name(instance)
    ports = [one.params.port for one in wanted if one.module == "wireguard" and one.name[:-1] == netns]
    things = (one for some in snapshot.observed.values() for one in some) if snapshot and not ports else ()
    ports += [one.state["listen_port"] for one in things if one.module == "wireguard" and one.name[:-1] == netns]
    return max(Counter(ports).items(), key=lambda one: (one[1], one[0]), default=(0, 0))[0]


def _architectures(snapshot: Snapshot) -> dict[str, str]:
    return {robot: facts.arch for robot, facts in snapshot.facts.items()}


def last_probe(root: Path, instance: str) -> tuple[Path, Mapping[str, Any]] | None:
    """Return the newest record of an instance whose run probed, and what it found.

    Raises:
        UsageError: The folder of records cannot be read.
    """
    for path in newest(records(root, instance).get(instance, [])):
        try:
            said = mapping(record_json(path / FILE))
        except (OSError, ValueError):
            continue
        if said.get("pairs"):
            return path, said
    return None
