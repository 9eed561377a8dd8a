"""Runs of strangers in bundles: what they say of attempts and sessions costs no more than what the bundle holds."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.evidence.verify import verify
from tests.unit.evidence.bundles import Content, events, journal, packed, with_manifest


@pytest.mark.parametrize("odd", [{"trial": []}, {"status": [1]}, {"segment": [1]}, {"attempt": True}, {"attempt": "1"}])
def test_an_end_without_a_row_of_an_attempt_is_none(content: Content, tmp_path: Path, odd: dict[str, object]) -> None:
    found = events(content)
    end = [one for one in found if one["event"] == "end"][-1]
    end["row"] |= odd
    report = verify(str(packed(with_manifest({**content, "journal.jsonl": journal(found)}), tmp_path / "a.zip")))
    (said,) = (one.details[0] for one in report.findings if one.id == "D1")
    assert said == f"journal.jsonl:{end['seq']} ends an attempt without a row of it"


def test_files_are_read_for_one_attempt_alone(content: Content, tmp_path: Path) -> None:
    """Else a small bundle has a log read thousands of times: once for each time that its attempt ended."""
    found = events(content)
    end = [one for one in found if one["event"] == "end"][-1]
    found += [{**end, "seq": len(found) + number} for number in range(1, 3)]
    report = verify(str(packed(with_manifest({**content, "journal.jsonl": journal(found)}), tmp_path / "a.zip")))
    (said,) = (one.details[0] for one in report.findings if one.id == "D1")
    assert said.endswith("which ended before") and not any(one.id == "M1" for one in report.findings)


def test_sessions_that_differ_have_so_many_trials_together(
    content: Content, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = {name.removeprefix("sessions/1/"): data for name, data in content.items() if name.startswith("sessions/1/")}
    more = {f"sessions/{number}/{name}": data for number in (2, 3) for name, data in one.items()}
    monkeypatch.setattr("srprov.evidence.story._MOST_TRIALS", 9)
    packed(with_manifest({**content, **more}), tmp_path / "alike.zip")
    assert not _said("trials that differ", tmp_path / "alike.zip")
    more |= {f"sessions/{number}/assignment.json": one["assignment.json"] + b" " * number for number in (2, 3)}
    packed(with_manifest({**content, **more}), tmp_path / "a.zip")
    assert _said("trials that differ", tmp_path / "a.zip")


def _said(words: str, path: Path) -> bool:
    return any(words in text for one in verify(str(path)).findings for text in one.details)
