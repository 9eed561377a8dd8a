"""What a run leaves on the controller: one folder with what it was given, what it decided, what it did, and where.

Takes values from the other rooms; writes files below one folder, each through `redact`, in a thread of its own: a run
never waits for its record, and a record that cannot be written is told, and stops nothing. Reads the versions of
installed libraries, and the newest records: for `@failed`, and for the images that are wanted.

    folder       the folder and its writer        documents    the files' contents, from values
    last         the newest record, read again    wanted       images that the newest records name
"""

from __future__ import annotations

from srprov.record.documents import RunInputs, event_json, run_id, write_inputs
from srprov.record.folder import PlainFolder, RunFolder, default_root
from srprov.record.last import LastRun, last_run, last_verb
from srprov.record.wanted import named_images

__all__ = [
    "LastRun",
    "PlainFolder",
    "RunFolder",
    "RunInputs",
    "default_root",
    "event_json",
    "last_run",
    "last_verb",
    "named_images",
    "run_id",
    "write_inputs",
]
