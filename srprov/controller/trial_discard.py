"""Trials that count no more because a person says so: noted in the journal and in trials.csv; no robot is asked."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

from srprov import private, regular_file
from srprov.controller.trial_folder import check_own
from srprov.controller.trial_history import read_history
from srprov.controller.trial_request import TrialsRequest
from srprov.controller.trial_run import chosen
from srprov.definitions.model import Experiment
from srprov.definitions.trialsmodel import TrialDefinitions
from srprov.record.journal import Journal
from srprov.trials import design
from srprov.trials.judge import COUNTED
from srprov.trials.marks import DISCARD, Row, discarded
from srprov.trials.table import csv_text

_MOST_TABLE = 512 << 20


def discard(experiment: Experiment, request: TrialsRequest) -> list[str]:
    """Note that trials count no more and are not run; return a line for each.

    Raises:
        UsageError: The folder holds no run, another srprov works in it, or a trial is unknown.
        RefusedError: The folder may be others'.
        OSError: It cannot be written.
    """
    assert request.folder is not None  # a run is gone on with in a folder, as was checked
    trials = chosen(design(experiment.trials or TrialDefinitions()), request.discard).trials
    check_own(request.folder)
    history = read_history(request.folder)
    with Journal(request.folder, history.events + 1) as journal:
        for one in trials:
            journal.add(DISCARD, trial=one.id, reason=request.reason)
        out = {one.id for one in trials}
        counted = [one for one in history.rows if one["trial"] in out and one["status"] in COUNTED]
        now = discarded(counted, out, request.reason)
        _mark_table(request.folder / "trials.csv", {_key(one): one for one in now})
    attempts = Counter(one["trial"] for one in now)
    return [f"{one.id}: {attempts[one.id]} discarded" if attempts[one.id] else f"{one.id}: not run" for one in trials]


def _key(row: Row) -> tuple[str, str]:
    return str(row["trial"]), str(row.get("attempt"))


def _mark_table(path: Path, rows: Mapping[tuple[str, str], Row]) -> None:
    """Write the status and the reason of some rows anew; all else stays as it is. A missing table stays missing."""
    if not path.exists():
        return
    reader = csv.DictReader(io.StringIO(regular_file.read_text(path, _MOST_TABLE), newline=""))
    names = reader.fieldnames or ()
    found = [{**one, **_changed(rows.get(_key(one)))} for one in reader if "trial" in one]
    private.replace_file(path, csv_text(names, found))


def _changed(row: Row | None) -> dict[str, str]:
    return {"status": str(row["status"]), "reason": str(row["reason"])} if row else {}
