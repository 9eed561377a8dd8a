"""The files of a snapshot, written and read back by srprov's own rules; what they refuse is left out and noted.

Takes a folder of its own and robots; writes there. Reads what it wrote.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from srprov import private
from srprov.definitions import load_experiment
from srprov.errors import DefinitionError
from srprov.images.dockerfile import render_dockerfile
from srprov.snapshot.folder import EDF_NAME, Definition, Robot, experiment_of
from srprov.snapshot.hider import Hider
from srprov.snapshot.notes import Notes
from srprov.snapshot.without import FREE_KEYS
from srprov.yamldoc.writer import Commented, document

_HEAD = "Written by `srprov snapshot`; report.md says what was not captured."
_TRIED = "try.edf"
LONGEST_S = 120.0
"""To find out what is refused: a robot may have thousands of odd values, and each is tried."""
_MOST_TRIED = 200
"""Entries of a list that are tried one by one; a longer one is kept or dropped as a whole."""
_OURS = ("robot", "cdf", "base", "image", "src", "name", "profiles", "secrets", "env", "network", "kind", "type")
"""Fields whose values are words of the inventory, of srprov or of a registry."""
_OF_CDF = ("cdf", "name", "base")
_OF_SERVICE = ("image", "cdf", "robot")


class Checker:
    """Writes one experiment."""

    def __init__(
        self, folder: Path, robots: Sequence[Robot], definitions: Mapping[str, Definition], hider: Hider
    ) -> None:
        """Take the folder, and all that goes there."""
        self.folder, self.robots, self.definitions, self.hider = folder, list(robots), dict(definitions), hider
        self.end = time.monotonic() + LONGEST_S

    def checked(self, name: str) -> tuple[list[Robot], dict[str, Definition]]:
        """Write all files; return the robots and definitions as they are there.

        Raises:
            OSError: Something cannot be written.
        """
        for robot in self.robots:
            if robot.name in self.definitions:
                self._define(robot)
        self.robots = [self._served(robot) for robot in self.robots]
        if self._fault(experiment_of(name, self.robots, self.definitions)):
            self._together(name)
        whole = experiment_of(name, self.robots, self.definitions)
        self.end = math.inf
        if fault := self._fault(whole):
            self.robots[0].notes.lost("experiment", f"srprov refuses it as a whole: {fault}")
        self._write(EDF_NAME, whole)
        return self.robots, self.definitions

    def _define(self, robot: Robot) -> None:
        """Write a CDF with its files, without what is refused."""
        one = self.definitions[robot.name]
        for path, content in one.files.items():
            place = self.folder / path
            private.make_folder(place.parent)
            with private.open_new(place) as stream:
                stream.write(content)
        subject = f"host {robot.name}"
        values = self._kept(
            one.values, _OF_CDF, lambda values: self._fault_of_cdf(one.file, values), subject, robot.notes
        )
        if fault := self._fault_of_cdf(one.file, values):
            self._drop(robot, f"srprov refuses its definition: {fault}")
            return
        self.definitions[robot.name] = replace(one, values=values)

    def _drop(self, robot: Robot, why: str) -> None:
        """Leave the CDF of a robot's host out."""
        robot.notes.lost(f"host {robot.name}", why)
        (self.folder / self.definitions.pop(robot.name).file).unlink()

    def _served(self, robot: Robot) -> Robot:
        services = []
        for one in robot.services:
            subject = f"container {one.name}"
            fields = self._kept(dict(one.fields), _OF_SERVICE, self._fault_of_service, subject,
                                robot.notes)  # fmt: skip
            if fault := self._fault_of_service(fields):
                robot.notes.lost(subject, f"srprov refuses it: {fault}")
                continue
            secrets = one.secrets if "secrets" in fields else {}
            services.append(dataclasses.replace(one, fields=fields, secrets=secrets))
        return replace(robot, services=tuple(services))

    def _together(self, name: str) -> None:
        """Keep the robots that go together, small ones first, each with all of its containers or with none.

        A robot may fill an experiment up to whatever is left for others: which of theirs fit then would be its word.
        """
        kept: dict[str, Robot] = {}
        for robot in sorted(self.robots, key=self._size):
            own = self._alone(name, robot)
            if fault := self._fault(experiment_of(name, [*kept.values(), own], self.definitions)):
                words = f"all are left out, as they do not go together with those of other robots: {fault}"
                own.notes.lost("containers", f"{words}; look at this robot alone to have them")
                own = replace(own, services=())
                if robot.name in self.definitions and (
                    fault := self._fault(experiment_of(name, [*kept.values(), own], self.definitions))
                ):
                    self._drop(robot, f"does not go together with other robots: {fault}")
            kept[robot.name] = own
        self.robots = [kept[robot.name] for robot in self.robots]

    def _size(self, robot: Robot) -> int:
        """Return how long what is written of a robot is."""
        one = self.definitions.get(robot.name)
        values = [{service.name: service.fields} for service in robot.services]
        return sum(len(document(value, _HEAD)) for value in (*values, *([one.values] if one else [])))

    def _alone(self, name: str, robot: Robot) -> Robot:
        """Return a robot with those of its containers that go together, whatever others have.

        Halves are tried, so that few bad ones cost few tries.
        """
        kept, left = replace(robot, services=()), [robot.services]
        while left:
            some = left.pop()
            tried = replace(kept, services=(*kept.services, *some))
            if not (fault := self._fault(experiment_of(name, [tried], self.definitions))):
                kept = tried
            elif len(some) > 1:
                half = len(some) // 2
                left += [some[half:], some[:half]]
            elif some:
                robot.notes.lost(f"container {some[0].name}", f"does not go together with the others: {fault}")
        return kept

    def _kept(
        self,
        values: dict[str, Any],
        needed: Sequence[str],
        fault_of: Callable[[dict[str, Any]], str],
        subject: str,
        notes: Notes,
    ) -> dict[str, Any]:
        """Return the values without those that are refused."""
        if not fault_of(values):
            return values
        kept = {key: value for key, value in values.items() if key in needed}
        for key, value in values.items():
            if key in needed or not (fault := fault_of({**kept, key: value})):
                kept[key] = value
                continue
            some = []
            if isinstance(value, list) and len(value) <= _MOST_TRIED and key not in ("command", "entrypoint"):
                some = [one for one in value if not fault_of({**kept, key: [one]})]
            if some and not fault_of({**kept, key: some}):
                kept[key] = some
                notes.lost(subject, f"{len(value) - len(some)} of its {key}: an EDF or CDF does not take them: {fault}")
            else:
                notes.lost(subject, f"its {key}: an EDF or CDF does not take it: {fault}")
        return kept

    def _fault_of_cdf(self, file: str, values: Mapping[str, Any]) -> str:
        self._write(file, values)
        return self._fault({"edf": 1, "name": "try", "services": {"one": {"cdf": file}}}, rendered=True)

    def _fault_of_service(self, fields: Mapping[str, Any]) -> str:
        secrets = {name: {"env": "X"} for name in fields.get("secrets", ())}
        return self._fault(
            {"edf": 1, "name": "try", "services": {"one": fields}, **({"secrets": secrets} if secrets else {})}
        )

    def _fault(self, values: Mapping[str, Any], *, rendered: bool = False) -> str:
        """Return the first thing that is wrong with an experiment, or nothing."""
        if time.monotonic() > self.end:
            return "so much is wrong that the rest is not tried"
        path = self.folder / _TRIED
        try:
            self._write(_TRIED, values)
            definitions = load_experiment(str(path), profiles=("*",))
            for one in definitions.containers.values() if rendered else ():
                render_dockerfile(one, ["0" * 40 for _ in one.repositories])
        except DefinitionError as error:
            return error.problems[0].message
        finally:
            path.unlink(missing_ok=True)
        return ""

    def _write(self, name: str, values: Mapping[str, Any]) -> None:
        private.write_file(self.folder / name, document(hidden(values, self.hider), _HEAD))


def hidden(value: Any, hider: Hider, within: str = "") -> Any:  # noqa: ANN401 - what YAML has
    """Return values without secrets. Names of fields, robots and files stay: a password may be such a word, too."""
    if isinstance(value, Commented):
        return Commented(hidden(value.value, hider, within), hider.without_strong(value.words))
    if isinstance(value, Mapping):
        free = within in FREE_KEYS
        return {
            hider.without_strong(key) if free else key: hidden(one, hider, "" if free else key)
            for key, one in value.items()
        }
    if isinstance(value, list):
        return [hidden(one, hider, within) for one in value]
    return hider.without_strong(value) if isinstance(value, str) and within not in _OURS else value
