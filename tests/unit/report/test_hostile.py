"""Pages of records that somebody else made: nothing else of this machine is in them, and they are read in time."""

from __future__ import annotations

import base64
import gzip
import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from srprov.cli.main import run
from srprov.errors import UsageError
from srprov.evidence import files
from srprov.report import read
from srprov.report.page import page
from srprov.report.read import of_run
from tests.bounded import bounded
from tests.unit.evidence.bundles import packed
from tests.unit.report.records import run as a_run
from tests.unit.report.records import write

BEYOND = int("9" * 400)


def test_no_name_of_what_a_link_leads_to_is_told_and_nothing_is_walked_through(tmp_path: Path) -> None:
    """All of a disk would be: hours, and a page with the names of all files on it."""
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "decoy").write_text("x")
    folder = write(tmp_path / "run", {"environment.json": {"verb": "apply"}})
    for target in (tmp_path / "mine", Path("/")):
        (folder / "inputs").unlink(missing_ok=True)
        (folder / "inputs").symlink_to(target)
        found = of_run(folder)
        assert found.inputs == () and found.missing[-1] == "inputs cannot be read: it is a link"
        assert "decoy" not in page(found)


def test_links_in_the_place_of_a_run_of_trials_folders_are_refused(tmp_path: Path) -> None:
    (tmp_path / "mine" / "1" / "inputs").mkdir(parents=True)
    (tmp_path / "mine" / "1" / "inputs" / "decoy").write_text("x")
    folder = write(tmp_path / "run", {"journal.jsonl": ""})
    for name in ("sessions", "trials"):
        (folder / name).symlink_to(tmp_path / "mine")
        with pytest.raises(UsageError, match=f"{name} is a link"):
            files.of_run(folder)
        (folder / name).unlink()
    assert list(files.of_run(folder).sizes) == ["journal.jsonl"]


@pytest.mark.parametrize("name", ["result.json", "environment.json", "inputs/notes.txt"])
def test_no_file_of_the_user_s_is_in_a_page_by_a_second_name(tmp_path: Path, name: str) -> None:
    """An archive makes one of any file, where it is unpacked: a page is for others, and had all of it as its data."""
    (tmp_path / "mine").write_text('{"auths": {"registry.lab": {"auth": "decoy"}}}')
    folder = write(tmp_path / "run", {**a_run(1), "inputs/e.edf": "edf: 1"})
    if name == "environment.json":  # which is the data of a run that has no result
        (folder / "result.json").unlink()
    (folder / name).unlink(missing_ok=True)
    (folder / name).hardlink_to(tmp_path / "mine")
    found = of_run(folder)
    assert b"decoy" not in found.data and "notes.txt" not in [one.name for one in found.inputs]
    why = "it has another name (a hard link); copy the record, if it is your own"
    assert f"{name} cannot be read: {why}" in found.missing


def test_inputs_are_few_and_have_a_size_in_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Sparse files of any size cost whoever sends them nothing; what cannot be read counts, too."""
    monkeypatch.setattr(read, "MOST", 1000)
    folder = write(tmp_path / "run", {"environment.json": {}, "inputs/a": "x" * 600, "inputs/b": "x" * 600})
    found = of_run(folder)
    assert [one.name for one in found.inputs] == ["a"] and "inputs/b cannot be read: it is larger" in found.missing[-1]
    for at in range(500):
        (folder / "inputs" / f"link{at}").symlink_to("/dev/null")
    assert len(of_run(folder).missing) < 220


@pytest.mark.parametrize("line", ["\n", "x\n", '{"time":1,"event":"end"}\n'])
def test_events_without_end_are_read_in_time(tmp_path: Path, line: str) -> None:
    """Lines that are none took minutes, empty ones half a gigabyte."""
    begin = json.dumps({"time": 1, "event": "start", "robot": "robot1", "step": 1}) + "\n"
    folder = write(tmp_path / "run", {"environment.json": {}, "events.jsonl": begin + line * ((60 << 20) // len(line))})
    found = bounded(lambda: of_run(folder))
    assert found.events is not None and found.events[0].robot == "robot1"
    assert any("events.jsonl is read up to its line" in one for one in found.missing)


def test_whole_numbers_beyond_all_others_are_no_numbers(tmp_path: Path) -> None:
    whole = a_run(2)
    whole["result.json"]["robots"]["robot1"]["bytes_sent"] = BEYOND
    found = of_run(write(tmp_path / "run", whole))
    assert found.result is None and any(one.startswith("result.json is not what") for one in found.missing)
    assert "robot2" in page(found)
    whole = a_run(2)
    whole["facts.json"] = {"robots": {"robot1": {"memory_total": -BEYOND}}}
    assert of_run(write(tmp_path / "run", whole)).facts is None


def test_a_small_page_takes_little_memory_when_its_data_is_taken_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What is in it may be packed to a thousandth, of characters that each become several."""
    made = tmp_path / "page.html"

    def write_page(data: bytes) -> None:
        packed = base64.b64encode(gzip.compress(data, mtime=0)).decode()
        made.write_text(f'<a id="data" download="x.json.gz" href="data:application/gzip;base64,{packed}"')

    write_page(json.dumps(["x\u00e9" * 1_500_000, "\x1b[31m"], ensure_ascii=False).encode())
    assert run(["report", str(made), "--extract"]) == 0
    assert capsys.readouterr().out == json.dumps(["x\u00e9" * 1_500_000, "\x1b[31m"], ensure_ascii=False) + "\n"
    write_page(b'["' + "\u202e".encode() * (41 << 20) + b'"]')
    limit = 640 << 20
    done = subprocess.run(
        [sys.executable, "-m", "srprov", "report", str(made), "--extract"], check=False, capture_output=False,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)),
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, b"")


def test_a_sparse_file_takes_no_more_memory_than_its_size(tmp_path: Path) -> None:
    """It costs whoever sends it nothing: as a plan, as a page, and as the plan in a bundle's session."""
    sparse = tmp_path / "sparse"
    sparse.touch()
    for size, words in ((190 << 20, ["--extract"]), (500 << 20, ["--extract"]), (250 << 20, ["-o", "page.html"])):
        os.truncate(sparse, size)
        assert bounded(lambda words=words: run(["report", str(sparse), *words]), cpu_s=4) == 5


def test_a_large_file_of_a_bundle_is_in_memory_once(tmp_path: Path) -> None:
    path = packed({"a": b"\0" * (200 << 20)}, tmp_path / "b.zip")
    with files.opened(str(path)) as archive:
        assert bounded(lambda: len(files.content(archive, "a", 256 << 20))) == 200 << 20
