"""A journal is whole up to its last line, whatever killed who wrote it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from srprov.controller.trial_folder import check_own
from srprov.errors import RefusedError, UsageError
from srprov.record.journal import NAME, Journal, read


def written(folder: Path, count: int = 3) -> None:
    with Journal(folder) as journal:
        for number in range(count):
            journal.add("begin", trial=f"t{number}", text="line\nfeed \ud800")


def test_what_was_written_is_read(tmp_path: Path) -> None:
    written(tmp_path)
    events, torn = read(tmp_path)
    assert [(one["seq"], one["event"], one["trial"]) for one in events] == [
        (1, "begin", "t0"), (2, "begin", "t1"), (3, "begin", "t2"),
    ]  # fmt: skip
    assert not torn
    assert (tmp_path / NAME).stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("number", [1e30, -1.7e308, 5e-324, 2**64])
def test_a_metric_of_any_size_leaves_a_journal_that_is_read(tmp_path: Path, number: float) -> None:
    with Journal(tmp_path) as journal:
        journal.add("end", row={"m_a": number})
    assert read(tmp_path)[0][0]["row"] == {"m_a": number}


@pytest.mark.parametrize("cut", range(1, 60, 7))
def test_a_torn_last_line_is_cut_off_and_gone_on_after(tmp_path: Path, cut: int) -> None:
    written(tmp_path)
    path = tmp_path / NAME
    path.write_bytes(path.read_bytes()[:-cut])
    events, torn = read(tmp_path)
    assert torn and len(events) == 2
    with Journal(tmp_path, 3) as journal:
        journal.add("end")
    assert [one["event"] for one in read(tmp_path)[0]] == ["begin", "begin", "end"]


@pytest.mark.parametrize(
    "change", [lambda text: text.replace('"seq": 2', '"seq": 5'), lambda text: text.replace("begin", "1", 0) + "[]\n"]
)
def test_a_journal_that_was_changed_is_refused(tmp_path: Path, change: object) -> None:
    written(tmp_path)
    path = tmp_path / NAME
    path.write_text(change(path.read_text()))  # type: ignore[operator]
    with pytest.raises(UsageError, match="is not the event number"):
        read(tmp_path)


def test_without_a_journal_the_folder_is_named(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be read"):
        read(tmp_path)


def test_a_journal_that_is_a_link_is_neither_read_nor_cut(tmp_path: Path) -> None:
    decoy = tmp_path / "decoy"
    decoy.write_text("one line without an end")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / NAME).symlink_to(decoy)
    with pytest.raises(UsageError, match="is a link"):
        read(tmp_path / "run")
    with pytest.raises(OSError):
        Journal(tmp_path / "run")
    assert decoy.read_text() == "one line without an end"


def test_a_folder_in_which_others_may_put_links_is_not_gone_on_with(tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir(mode=0o700)
    (run / "trials").mkdir(mode=0o700)
    check_own(run)
    (run / "trials").chmod(0o770)  # as a umask of 002 makes it, of the user's own group
    check_own(run)
    os.chown(run / "trials", -1, 65534)
    with pytest.raises(RefusedError, match="writable by others"):
        check_own(run)
    (run / "trials").rmdir()
    (run / "trials").symlink_to(tmp_path)
    with pytest.raises(RefusedError, match="is a link"):
        check_own(run)
