"""What a run of trials was made of, in its own folder: a record for each time that it was begun or gone on with.

Takes what is planned; writes `sessions/N/`, as the record of an `apply` has it, and with all files that the robots get.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path

from msgspec.structs import replace

from srprov import private
from srprov.controller.hardware_tokens import tokens
from srprov.controller.input_files import InputFile, definition_files, listing, reader_files, shipped_files
from srprov.controller.plan import Planned
from srprov.controller.run import record_inputs
from srprov.controller.trial_plan import TrialPlan
from srprov.definitions.model import Inventory
from srprov.record.folder import PlainFolder
from srprov.record.input_places import inputs
from srprov.secret import redact

SESSIONS = "sessions"


def session_files(plan: TrialPlan) -> dict[str, InputFile]:
    """Return all files of the experiment, for its records; read before robots act, so that a change is told by then.

    Raises:
        UsageError: One is not any more what was planned.
    """
    whole = _whole(plan)
    return {**reader_files(whole), **shipped_files(whole), **definition_files(whole)}


def _whole(plan: TrialPlan) -> Planned:
    return replace(plan.base, desired=(*plan.base.desired, *plan.services))


def keep_session(
    folder: Path, number: int, plan: TrialPlan, inventory: Inventory, files: Mapping[str, InputFile]
) -> None:
    """Write the record of a session before anything of it is run.

    Args:
        folder: The run's.
        number: Of the session, counted from 1. What a session that ended before its first event left is replaced.
        plan: What is run.
        inventory: The robots.
        files: Of `session_files`.

    Raises:
        OSError: Something cannot be written.
    """
    whole = _whole(plan)
    home = folder / SESSIONS / str(number)
    shutil.rmtree(home, ignore_errors=True)
    sink = PlainFolder(home)
    record_inputs(sink, whole, inventory, "run", with_files=False)
    if whole.snapshot is not None:
        found = tokens(whole.snapshot.facts)
        sink.put_json("hardware.json", lambda: {"tokens": found})
    places = _places(files)
    kept = {path: without_secrets(one) for path, one in files.items() if one.link is None and one.data is None}
    for path, content in kept.items():
        private.make_folder((home / places[path]).parent)
        private.write_output(str(home / places[path]), content)
    variables = whole.experiment.variables if whole.experiment else ()
    about = {"edf": _edf(whole, places), "variables": list(variables), "files": listing(files, places, kept)}
    sink.put_json("inputs.json", lambda: about)
    for tag, image in sorted(whole.images.items()):
        name = tag.replace("/", "_").replace(":", "_")  # a bundle has no names that Windows could not have
        sink.put(f"rendered/{name}.Dockerfile", lambda image=image: image.dockerfile)  # type: ignore[misc]


def _places(files: Iterable[str]) -> dict[str, str]:
    """Return path -> where in the record it is, so that definitions find each other there by the same words.

    What lies above the EDF's folder lies above it there too, so the EDF then is as many folders deeper.
    """
    paths = list(files)
    above = max((path.split("/").count("..") for path in paths), default=0)
    plain = {os.path.normpath("/".join([*(["edf"] * above), path])): path for path in paths}
    return {path: f"inputs/{place}" for place, path in inputs(plain)}


def _edf(planned: Planned, places: Mapping[str, str]) -> str:
    """Return where in the record the EDF is."""
    assert planned.definitions is not None  # trials are never run from a plan in a file
    return places[os.path.basename(planned.definitions.experiment.file)]


def without_secrets(one: InputFile) -> bytes:
    """Return a file's content as it is recorded: byte for byte, but that secrets in a text are masked."""
    try:
        return redact(one.content.decode()).encode()
    except UnicodeDecodeError:
        return one.content
