"""Fields of a service that an EDF has by the same name, or nearly: one function for each kind of value. Pure."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator, Mapping
from typing import Any

from srprov.conversion.project import Project
from srprov.conversion.table_service import SAME
from srprov.importing.position import Path
from srprov.names import label_fault

_Given = Mapping[str, Any]
_SIZES = ("mem_limit", "mem_reservation", "shm_size")
_NUMBERS = ("oom_score_adj", "cpus")
_NAMESPACES = {"ipc": ("host", "private", "shareable", "none"), "pid": ("host",)}
_EXPOSED = re.compile(r"[0-9]{1,5}(-[0-9]{1,5})?(/(tcp|udp))?")
_SECRET = re.compile(r"passw|secret|token|credential|api_?key", re.IGNORECASE)
_PROFILE_FILE = re.compile(r"(seccomp|apparmor|label)[=:](?P<value>.*)", re.DOTALL)


def same(given: _Given, project: Project, at: Path) -> dict[str, Any]:
    """Return the fields that are taken as they are."""
    found: dict[str, Any] = {}
    for key in SAME:
        value = given.get(key)
        if value is None or key == "profiles" or value == "" or (value is False and key != "init"):
            continue
        if value == [] and key not in ("command", "entrypoint"):
            continue
        if key in _SIZES and int(value) <= 0:
            continue  # no limit
        if key in _SIZES:
            found[key] = size_text(int(value))
        elif key in _NUMBERS:
            found[key] = float(value) if key == "cpus" else int(value)
        elif key == "stop_grace_period":
            found[key] = duration_text(value)
        else:
            found[key] = value
    for option in given.get("security_opt") or ():
        named = _PROFILE_FILE.fullmatch(option)
        if named and named[1] == "seccomp" and named["value"] not in ("unconfined", "builtin"):
            project.notes.refused(
                (*at, "security_opt"), f"'{option[:80]}' names a file of this machine", "robots have no such file"
            )
    return found


def duration_text(written: str) -> str:
    """Return a duration as an EDF has it; Compose prints the sign for micro."""
    return written.replace("µs", "us")


def size_text(size: int) -> str:
    """Return bytes in the largest unit that divides them."""
    for unit, factor in (("g", 1 << 30), ("m", 1 << 20), ("k", 1 << 10)):
        if size and size % factor == 0:
            return f"{size // factor}{unit}"
    return str(size)


def environment(given: _Given, project: Project, at: Path) -> dict[str, Any]:
    """Return `environment` without what only the caller would give a value; those of env files stand in it already."""
    found: Mapping[str, str | None] = given.get("environment") or {}
    path = (*at, "environment")
    for name in sorted(name for name, value in found.items() if value is None):
        words = f"'{name}' has no value: it is left out"
        project.notes.adapted(
            (*path, name), words, f"--set {shlex.quote(name)}=VALUE, or a bare {name} in the experiment's file"
        )
    own = project.notes.normal.position_of(at).file
    for name in (name for name, value in found.items() if value and _SECRET.search(name)):
        if project.notes.normal.position_of((*path, name)).file != own:
            words = f"the value of '{name}' stands in the experiment in the clear, as its name says it should not"
            project.notes.adapted(
                (*path, name), words, "make it one of the file's 'secrets', and read /run/secrets/NAME"
            )
    kept = {name: value for name, value in found.items() if value is not None}
    return {"environment": kept} if kept else {}


def namespaces(given: _Given, project: Project, at: Path) -> dict[str, Any]:
    """Return `ipc` and `pid`."""
    found = {}
    for key, known in _NAMESPACES.items():
        value = given.get(key)
        if value in known:
            found[key] = value
        elif value and (key, value) != ("pid", "private"):
            project.notes.refused((*at, key), f"'{key}: {str(value)[:60]}': {_another(str(value))}")
    return found


def _another(value: str) -> str:
    return "the namespace of another container cannot be joined" if ":" in value else "no engine has it"


def various(given: _Given, project: Project, at: Path) -> dict[str, Any]:
    """Return the fields that need a look at their values."""
    found: dict[str, Any] = {}
    if limits := given.get("ulimits"):
        found["ulimits"] = {name: _limit(value) for name, value in limits.items()}
    if labels := given.get("labels"):
        for wrong in filter(None, map(label_fault, sorted(labels))):
            project.notes.dropped((*at, "labels"), wrong)
        found["labels"] = {name: str(value) for name, value in labels.items() if not label_fault(name)}
    if ports := given.get("expose"):
        fit = [str(port) for port in ports if _EXPOSED.fullmatch(str(port))]
        for port in ports:
            if str(port) not in fit:
                project.notes.dropped((*at, "expose"), f"'{str(port)[:40]}' is no port of tcp or udp")
        found["expose"] = fit
    processes = int(given.get("pids_limit") or 0)
    if processes > 0:
        found["pids_limit"] = processes
    elif processes:
        project.notes.dropped((*at, "pids_limit"), "no limit is the default")
    if quota := int(float(given.get("cpu_quota") or 0)):
        period = int(float(given.get("cpu_period") or 0)) or 100_000
        found["cpus"] = round(quota / period, 3)
    return {key: value for key, value in found.items() if value not in ({}, [])} | _pull(given, project, at)


def _limit(value: object) -> object:
    """Return one number, or two; Compose prints no 0, and nothing at all for one number that is 0."""
    if not isinstance(value, Mapping):
        return int(str(value))
    both = {key: int(value.get(key) or 0) for key in ("soft", "hard")}
    return both if any(both.values()) else 0


def _pull(given: _Given, project: Project, at: Path) -> dict[str, Any]:
    policy = given.get("pull_policy")
    if policy is None:
        return {}
    if policy not in ("missing", "if_not_present", "always", "never", "build"):
        project.notes.adapted((*at, "pull_policy"), f"a plan has no clock: '{str(policy)[:40]}' is 'always'")
        policy = "always"
    return {"pull_policy": policy}


def profiles(given: _Given, project: Project, at: Path) -> dict[str, Any]:
    """Return `profiles`, unless the user chose some already."""
    named = given.get("profiles") or []
    if named and project.making.choices.chosen_profiles:
        project.notes.adapted(
            (*at, "profiles"), "the service is always wanted: its profile was named when it was imported"
        )
        return {}
    return {"profiles": named} if named else {}


def gpus(given: _Given, project: Project, at: Path) -> dict[str, Any]:
    """Return `gpus`, of the key itself or of what `deploy` reserves."""
    wanted = [((*at, "gpus", index), one) for index, one in enumerate(given.get("gpus") or ())]
    wanted += _reserved_gpus(given, project, at)
    count = 0
    for path, one in wanted:
        ids = one.get("device_ids") or []
        number = int(one.get("count", len(ids) or -1))
        if number == -1:
            project.notes.exact((*path, "count"))
            return {"gpus": "all"}
        count += number
    return {"gpus": count} if count else {}


def _reserved_gpus(given: _Given, project: Project, at: Path) -> Iterator[tuple[Path, Mapping[str, Any]]]:
    deploy = given.get("deploy") or {}
    reserved = ((deploy.get("resources") or {}).get("reservations") or {}).get("devices") or ()
    for index, one in enumerate(reserved):
        path = (*at, "deploy", "resources", "reservations", "devices", index)
        if "gpu" in one.get("capabilities", ()) or one.get("driver") == "nvidia":
            yield path, one
        else:
            project.notes.refused(path, "devices that are no GPUs cannot be reserved", "name them in 'devices'")
