"""Results, logs and facts of an applied experiment, brought into a folder; nothing is changed on any robot.

Takes an experiment and the fleet; writes below the folder. What is there already with the robot's content is not
fetched again. A robot that cannot be reached, or is lost meanwhile, is told: what earlier calls brought of it stays.
"""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from shlex import quote
from typing import Any, TypeVar

import msgspec

from srprov import private
from srprov.codes import Code
from srprov.controller.bringing import Home
from srprov.controller.collected import Now, read_earlier
from srprov.controller.fleet import Fleet
from srprov.controller.located import containers_of
from srprov.controller.ownership import looking, made_by_another
from srprov.controller.results import Brought, bring_log, bring_results, listed
from srprov.controller.trial_folder import alone, opened
from srprov.definitions.expand import expand
from srprov.definitions.model import Experiment
from srprov.definitions.trialsmodel import Result
from srprov.errors import RefusedError, SrprovError, TransportError
from srprov.execution.collect import CollectFailed, place_of
from srprov.execution.trial_patience import EquipmentFailed, Patience
from srprov.facts.document import facts_document
from srprov.facts.gather import Detail
from srprov.facts.model import Snapshot
from srprov.record.recordings import in_words
from srprov.record.results import Kept
from srprov.session import Session
from srprov.untrusted import is_of_one, text
from srprov.wire import EngineQuery

_T = TypeVar("_T")
Say = Callable[[str], None]


@dataclass(slots=True)
class _Found:
    """What one robot gave."""

    results: dict[str, list[dict[str, object]]] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    unclosed: list[str] = field(default_factory=list)
    inspected: dict[str, Any] = field(default_factory=dict)
    fetched: Brought = field(default_factory=Brought)
    lost: str = ""
    """Why the robot was given up, or nothing."""


class _Service(msgspec.Struct, frozen=True):
    """A container of the instance."""

    label: str
    host: str
    container: str
    results: tuple[Result, ...]


def collect(
    fleet: Fleet, experiment: Experiment, instance: str, folder: Path, say: Say, *, source: str, meant: bool = False
) -> dict[str, Any]:  # fmt: skip
    """Bring home what there is, and return what `collected.json` says.

    Args:
        fleet: The robots.
        experiment: What the EDF says.
        instance: The instance's id.
        folder: Where it comes.
        say: What is told meanwhile, also that another experiment than that of `source` made the instance.
        source: Where the EDF comes from.
        meant: The user himself named the instance; else its name is the EDF's word, and so are the paths.

    Raises:
        RefusedError: Another experiment made the instance, and only the EDF names it.
        UsageError: Nothing of the instance is on the robots, or the folder is another srprov's, or not as it was left.
        OSError: A document cannot be written here.
    """
    snapshot = fleet.gather(Detail.TRAFFIC, keep_mute=True)
    services = _services(snapshot, experiment, instance)
    if said := made_by_another(looking(snapshot, instance).snapshot, instance, source):
        if not meant:
            hint = f"if you mean that one, name it yourself: --instance {quote(instance)}"
            raise RefusedError(said, hint=hint, code=Code.OWNER)
        say(f"note: {said}")
    private.make_folder(folder)
    with opened(folder) as place, alone(folder):
        earlier = read_earlier(place, instance)
        found = _all(fleet, services, place, say)
        for one in found.values():
            one.failed[:] = [line.replace(str(place), str(folder)) for line in one.failed]
        return earlier.replaced(place, _now(snapshot, services, found))


def _services(snapshot: Snapshot, experiment: Experiment, instance: str) -> list[_Service]:
    """Return the containers, each with the results that the EDF says of its service."""
    given = experiment.trials.results if experiment.trials else {}
    tags = {robot: facts.tags for robot, facts in snapshot.facts.items()}
    origin = {name: one.instance_of or name for name, one in expand(experiment, tags).services.items()}
    return [
        _Service(label, host, container, given.get(origin.get(name := label.partition("@")[0], name), ()))
        for label, host, container in containers_of(snapshot, instance, ())
    ]


def _all(fleet: Fleet, services: Sequence[_Service], folder: Path, say: Say) -> dict[str, _Found]:
    """Ask all robots at the same time."""
    hosts = sorted({one.host for one in services})
    robots = {host: _Robot(fleet, host, say) for host in hosts}
    with ThreadPoolExecutor(max(1, min(len(hosts), fleet.forks))) as pool:
        running = {
            host: pool.submit(_of_robot, robots[host], [one for one in services if one.host == host], folder, say)
            for host in hosts
        }
        try:
            return {host: one.result() for host, one in running.items()}
        except BaseException:  # Ctrl-C: what is under way ends with its connection
            for one in robots.values():
                one.patience.over.set()
            fleet.sessions.close()
            raise


class _Robot:
    """A robot whose connection is made anew when it is lost."""

    def __init__(self, fleet: Fleet, host: str, say: Say) -> None:
        self._sessions = fleet.sessions
        self.host = host
        self.patience = Patience(self._renew, say)

    def do(self, work: Callable[[Session], _T]) -> _T:
        """Do something with its session, again if the connection is lost meanwhile."""
        return self.patience.do(lambda host: work(self._sessions.get(host)), self.host)

    def _renew(self, host: str) -> None:
        self._sessions.get(host).close()
        self._sessions.again(host)


def _of_robot(robot: _Robot, services: Sequence[_Service], folder: Path, say: Say) -> _Found:
    """Bring what one robot has; what goes wrong is told in the result."""
    found = _Found()
    try:
        replies = robot.do(
            lambda session: session.ask([EngineQuery(path=f"/containers/{one.container}/json") for one in services])
        )
        for one, reply in zip(services, replies, strict=True):
            long = reply.ok and not is_of_one(reply.out)
            found.inspected[one.label] = reply.json() if reply.ok and not long else None
            if long:
                found.failed.append(f"{one.label}: what its engine says of it is longer than any container needs")
                continue
            with _told(one.label, found):
                bring_log(robot, one.container, folder / "logs" / f"{one.host}.{one.label}.log")
            with _told(one.label, found):
                _of_service(robot, one, folder, found, say)
    except (EquipmentFailed, TransportError) as error:
        found.lost = error.message if isinstance(error, TransportError) else str(error)
    return found


@contextlib.contextmanager
def _told(label: str, found: _Found) -> Iterator[None]:
    """Note what of a service cannot be fetched, or be written here; the others go on."""
    try:
        yield
    except CollectFailed as error:
        found.failed.append(f"{label}: {error}")
    except OSError as error:
        found.failed.append(f"{label}: {error.filename or 'a file here'}: {error.strerror or error}")
    except (SrprovError, EquipmentFailed):
        raise
    except Exception as error:  # parsers do not raise; the one that does must not lose what the others have
        why = f"{type(error).__name__}: {text(str(error))}"
        found.failed.append(f"{label}: what its robot says cannot be read: {why}")


def _of_service(robot: _Robot, one: _Service, folder: Path, found: _Found, say: Say) -> None:
    if not one.results:
        return
    inspected = found.inspected[one.label]
    parts = folder / ".parts" / one.label
    home = Home(parts=parts, say=lambda text: say(f"{one.label} on {one.host}: {text}"))
    results, fetched = bring_results(robot, inspected, one.results, folder / "results" / one.label, home)
    found.fetched = Brought(found.fetched.files + fetched.files, found.fetched.bytes + fetched.bytes)
    for result in one.results:
        if result in results:
            found.results[f"{one.label}{result.path}"] = [listed(entry) for entry in results[result]]
            found.failed += [_line(one, result, entry, entry.note) for entry in results[result] if entry.failed]
            found.unclosed += [
                _line(one, result, entry, in_words(entry)) for entry in results[result] if entry.unclosed
            ]
        elif place_of(inspected, result.path) is None:
            found.failed.append(f"{one.label}: {result.path} is in no volume of it: `srprov apply` makes it one")
        else:
            found.missing.append(f"{result.path} of {one.label}" + (", which is required" if result.required else ""))
    if not any(entry.failed for some in results.values() for entry in some):
        shutil.rmtree(parts, ignore_errors=True)  # of what has another content by now


def _line(one: _Service, result: Result, entry: Kept, what: str) -> str:
    return f"{one.label} on {one.host}: {result.path}: {entry.path}: {what}"


def _now(snapshot: Snapshot, services: Sequence[_Service], found: Mapping[str, _Found]) -> Now:
    """Return all that came."""
    return Now(
        robots={one.label: one.host for one in services},
        results={key: value for one in found.values() for key, value in one.results.items()},
        inspected={name: value for one in found.values() for name, value in one.inspected.items()},
        facts=facts_document(snapshot.facts, snapshot.unreachable),
        away={**snapshot.unreachable, **{host: one.lost for host, one in found.items() if one.lost}},
        said={
            "missing": sorted(line for one in found.values() for line in one.missing),
            "failed": sorted(line for one in found.values() for line in one.failed),
            "unclosed": sorted(line for one in found.values() for line in one.unclosed),
            "fetched_files": sum(one.fetched.files for one in found.values()),
            "fetched_bytes": sum(one.fetched.bytes for one in found.values()),
        },
    )
