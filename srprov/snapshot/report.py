"""What was found on robots and what could not be captured: as JSON and as Markdown.

Takes robots as they were read; gives JSON values and text. Pure.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from srprov.snapshot.folder import Definition, Robot, host_service
from srprov.snapshot.notes import KINDS

_TITLES = {
    "lost": "Not captured",
    "adapted": "To know",
    "secret": "Looks like a secret",
}


def document(
    name: str, robots: Sequence[Robot], definitions: Mapping[str, Definition], unreachable: Mapping[str, str]
) -> dict[str, Any]:
    """Return the whole report as JSON values, robots in name order."""
    secrets = [
        {"secret": secret, "service": one.name, "robot": robot.name, "env": variable}
        for robot in robots for one in robot.services for secret, variable in sorted(one.secrets.items())
    ]  # fmt: skip
    return {
        "experiment": name,
        "robots": {robot.name: _robot(robot, definitions.get(robot.name)) for robot in robots},
        "secrets": secrets,
        "notes": [
            {"robot": robot.name, "kind": note.kind, "subject": note.subject, "words": note.words}
            for robot in robots
            for kind in KINDS
            for note in robot.notes.all()
            if note.kind == kind
        ],
        "unreachable": dict(sorted(unreachable.items())),
    }


def _robot(robot: Robot, definition: Definition | None) -> dict[str, Any]:
    host = robot.host
    return {
        "base": host.base,
        "arch": host.arch,
        "cdf": definition.file if definition else "",
        "service": host_service(robot) if definition else "",
        "services": {one.name: str(one.fields.get("image", "")) for one in robot.services},
        "packages": {
            "installed": len(host.packages),
            "by_hand": [f"{one.name}={one.version}" for one in host.chosen.by_hand],
            "others": [f"{one.name}={one.version}" for one in host.chosen.others],
            "gone": sorted(host.gone),
            "older": sorted(host.older),
            "elsewhere": sorted(host.elsewhere),
        },
        "sources": [one.line() for one in host.sources],
        "pip": [
            {"name": one.name, "version": one.version, **({"commit": one.commit} if one.commit else {})}
            for one in host.pip
        ],
        "repositories": [
            {"folder": one.folder, "git": one.url, "commit": one.commit, "branch": one.branch, "patch": len(one.patch)}
            for one in robot.repositories
        ],
        "workspaces": [{"folder": folder, "kind": kind} for folder, kind in host.workspaces],
        "ros": list(host.ros),
    }


def markdown(report: Mapping[str, Any]) -> str:
    """Return the report as text that people read."""
    return "\n".join(_lines(report)) + "\n"


def _lines(report: Mapping[str, Any]) -> Iterator[str]:
    yield f"# {report['experiment']}: what was found, and what was not captured"
    for name, robot in report["robots"].items():
        yield from ("", f"## {_plain(name)}", "")
        packages = robot["packages"]
        yield f"- system: {robot['base'] or 'not known'} {robot['arch']}".rstrip()
        for service, image in robot["services"].items():
            yield f"- service {service}: {_plain(image)}"
        if packages["installed"]:
            yield (f"- packages: {packages['installed']} installed, {len(packages['by_hand'])} by hand beyond the base,"
                   f" {len(packages['others'])} that came with them and are named too")  # fmt: skip
        if robot["pip"]:
            yield f"- pip: {len(robot['pip'])} packages"
        for one in robot["repositories"]:
            dirty = f", with a patch of {one['patch']} bytes" if one["patch"] else ""
            yield f"- repository {_plain(one['folder'])}: {one['commit'][:12]} of {_plain(one['git'])}{dirty}"
        for kind in KINDS:
            some = [note for note in report["notes"] if note["robot"] == name and note["kind"] == kind]
            if some:
                yield from ("", f"### {_TITLES[kind]}", "")
                yield from (f"- {_plain(note['subject'])}: {_plain(note['words'])}" for note in some)
    if report["secrets"]:
        yield from ("", "## Variables to set before `plan`", "")
        # names of services may look alike, so the robot stands there, too
        yield from (
            f"- `{one['env']}`: the secret {one['secret']} of {one['service']} on {_plain(one['robot'])}"
            for one in report["secrets"]
        )
    for robot, why in report["unreachable"].items():
        yield from ("", f"{_plain(robot)} could not be reached: {_plain(why)}")


def _plain(words: str) -> str:
    """Return words that Markdown shows as they are."""
    return "".join(f"\\{c}" if c in "\\`*_[]<>|#" else c for c in words)
