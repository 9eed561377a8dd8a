"""`srprov report`: pages are whole HTML that loads and runs nothing, say what the record says, and take any names."""

from __future__ import annotations

import base64
import gzip
import json
import shutil
import time
import zipfile
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from srprov import data
from srprov.cli.main import run
from srprov.report import read
from srprov.report.embed import extracted
from srprov.report.model import PlanView
from tests.bounded import within
from tests.unit.report.pages import Page, wrong_numbers
from tests.unit.report.records import run as a_run
from tests.unit.report.records import write

RACE = Path(__file__).resolve().parents[3] / "docs/evidence/race.zip"
HOSTILE = (
    "</title><script>alert(1)</script>", "\" onload='x", "]]>", "<!--", "&lt;img src=x onerror=y>",
    "\x1b[31m\u202e\x00", "\ud800", "javascript:alert(1)", "</style><style>*{display:none}", "{{7*7}}",
)  # fmt: skip


def page_of(folder: Path, target: Path, *more: str) -> Page:
    assert run(["report", str(folder), "-o", str(target), *more]) == 0
    text = target.read_text()
    page = Page(text)
    assert page.faults == []
    return page


def loads_nothing(page: Page) -> None:
    """Assert that no element of a page can load, run or send anything, and no address leads out of it."""
    tags = {tag for tag, _ in page.elements}
    assert not tags & {"script", "iframe", "object", "embed", "img", "form", "base", "video", "audio", "use", "image"}
    for tag, about in page.elements:
        assert not [name for name in about if name.startswith("on") or name in ("src", "style", "srcset", "action")], (
            tag
        )
        assert about.get("href", "#").startswith(("#", "data:,", "data:application/")), about["href"]
    (policy,) = [about["content"] for tag, about in page.elements if about.get("http-equiv")]
    assert policy.startswith("default-src 'none'; style-src 'sha256-") and "unsafe" not in policy


def test_a_run_of_twelve_robots_is_a_small_page_whose_numbers_are_those_of_its_result(tmp_path: Path) -> None:
    folder = write(tmp_path / "run", a_run(12))
    page = page_of(folder, tmp_path / "page.html")
    loads_nothing(page)
    assert (tmp_path / "page.html").stat().st_size < 150_000
    assert (tmp_path / "page.html").stat().st_mode & 0o077 == 0
    result = json.loads((folder / "result.json").read_text())
    assert wrong_numbers(page, result) == []
    said = {pointer for pointer, _, _ in page.numbers}
    assert {"/changed", "/failed", "/duration_s", "/cost", "/phases/apply", "/probe/pairs"} <= said
    assert {f"/robots/robot{at}/{key}" for at in range(1, 13) for key in result["robots"]["robot1"]} <= said
    for words in (
        "✓ Done",
        "96 steps changed",
        "1 step destroys data",
        "Critical path",
        "it lacks the tag 'lidar'",
        "busybox is not pinned",
        "privileged",
        "its container is exited",
        "with changes that are in no commit",
    ):
        assert words in page.text, words  # fmt: skip


def test_what_failed_comes_first_with_what_was_said(tmp_path: Path) -> None:
    folder = write(tmp_path / "run", a_run(4, failed=True))
    page = page_of(folder, tmp_path / "page.html")
    assert "✕ Failed" in page.text and "1 failed; 31 steps changed" in page.text
    assert "it said:\nno such device" in page.text
    assert page.ids.index("failures") < page.ids.index("placement")


@pytest.mark.parametrize("word", HOSTILE)
def test_no_element_or_attribute_comes_from_data(tmp_path: Path, word: str) -> None:
    """A page of hostile names has the very elements that one of harmless names has."""
    plain = page_of(write(tmp_path / "plain", a_run(3, failed=True)), tmp_path / "plain.html")
    page = page_of(write(tmp_path / "run", a_run(3, word=word, failed=True)), tmp_path / "page.html")
    loads_nothing(page)
    assert [tag for tag, _ in page.elements] == [tag for tag, _ in plain.elements]
    assert page.names == plain.names
    text = (tmp_path / "page.html").read_text()
    assert all(one.isprintable() or one == "\n" for one in text), "no control character, nor one that turns writing"
    assert wrong_numbers(page, json.loads((tmp_path / "run" / "result.json").read_text())) == []


def test_equal_records_give_equal_bytes_wherever_they_lie(tmp_path: Path) -> None:
    one, other = write(tmp_path / "a" / "run", a_run(5)), write(tmp_path / "b" / "run", a_run(5))
    page_of(one, tmp_path / "one.html")
    time.sleep(0.01)
    page_of(other, tmp_path / "other.html")
    assert (tmp_path / "one.html").read_bytes() == (tmp_path / "other.html").read_bytes()


def test_the_data_comes_out_again_as_it_went_in(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Plain where it is small, and packed where it is large."""
    for robots, kind in ((2, "json"), (200, "gzip")):
        folder = write(tmp_path / f"run{robots}", a_run(robots))
        page_of(folder, tmp_path / "page.html")
        text = (tmp_path / "page.html").read_text()
        assert f"data:application/{kind};base64," in text
        result = (folder / "result.json").read_bytes()
        assert extracted(text.encode()) == result
        assert run(["report", str(tmp_path / "page.html"), "--extract", "-o", str(tmp_path / "out.json")]) == 0
        assert (tmp_path / "out.json").read_bytes() == result
        capsys.readouterr()
        assert run(["report", str(tmp_path / "page.html"), "--extract"]) == 0
        assert json.loads(capsys.readouterr().out) == json.loads(result)
    (tmp_path / "no.html").write_text("<!doctype html>")
    assert run(["report", str(tmp_path / "no.html"), "--extract"]) == 5
    assert "it holds no data of srprov" in capsys.readouterr().err


def test_a_thousand_robots_fit_in_three_megabytes_and_five_seconds(tmp_path: Path) -> None:
    folder = write(tmp_path / "run", a_run(1000, 20))
    with within(10):  # half of it for this test's own parser
        page = page_of(folder, tmp_path / "page.html")
    assert (tmp_path / "page.html").stat().st_size < 3_000_000
    assert "900 more robots are left out; a page has 2000 at most" in page.text
    assert "940 robots that ended earlier have no lane here" in page.text
    assert wrong_numbers(page, json.loads((folder / "result.json").read_text())) == []


def test_a_run_that_was_killed_says_so(tmp_path: Path) -> None:
    files = a_run(3)
    del files["result.json"], files["probe.json"], files["facts.json"]
    files["events.jsonl"] = files["events.jsonl"][:1000]
    page = page_of(write(tmp_path / "run", files), tmp_path / "page.html")
    assert "! Not ended" in page.text
    for words in ("there is no result.json", "there is no facts.json", "events.jsonl has 1 lines that are no events"):
        assert words in page.text
    assert json.loads(extracted((tmp_path / "page.html").read_bytes()))["verb"] == "apply"


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("result.json", "[1]", "result.json is not what srprov writes: Expected `object`, got `array`"),
        ("result.json", '{"changed": "<b>"}', "Expected `int`, got `str` - at `$.changed`"),
        ("plan.json", "{" * 100_000, "plan.json is not what srprov writes"),
        ("plan.json", '{"plan": 1, "instance": "a", "steps": ' + "[" * 100_000, "plan.json is not what srprov writes"),
        ("facts.json", '{"robots": {"r": {"cpus": 1e999}}}', "facts.json is not what srprov writes"),
        ("events.jsonl", "\x00\n{}\n" + "[" * 50_000, "events.jsonl has 3 lines that are no events"),
        ("probe.json", '{"ok": true, "pairs": [{"from": "a"}]}', "probe.json is not what srprov writes"),
    ],
)  # fmt: skip
def test_what_is_broken_is_named_and_the_rest_is_shown(tmp_path: Path, name: str, content: str, says: str) -> None:
    page = page_of(write(tmp_path / "run", {**a_run(3), name: content}), tmp_path / "page.html")
    assert says in page.text
    assert "robot2" in page.text


def test_numbers_beyond_all_measure_break_nothing(tmp_path: Path) -> None:
    files: dict[str, Any] = a_run(3)
    events = [json.loads(line) for line in files["events.jsonl"].splitlines()]
    events += [
        {**events[0], "time": when, "duration_s": long} for when, long in ((1e308, 1.0), (-1e308, 1.0), (1.0, 1e308))
    ]
    files["events.jsonl"] = "".join(json.dumps(one) + "\n" for one in events)
    files["result.json"] |= {"cost": -1e308, "duration_s": 1e308, "changed": 10**17}
    files["probe.json"]["pairs"][0]["rtt_ms"] = [1e308, 1e308, 1e308]
    page = page_of(write(tmp_path / "run", files), tmp_path / "page.html")
    assert "nan" not in page.text.replace("naming", "") and wrong_numbers(page, files["result.json"]) == []


def test_long_texts_are_cut_and_say_so(tmp_path: Path) -> None:
    files = a_run(3, failed=True)
    long = "no such device\n" * 70_000
    files["result.json"]["steps"][-1]["message"] = files["plan.json"]["steps"][0]["cause"] = long
    files["assignment.json"]["decision"]["why_not"] = {"node-1": {f"robot{at}": f"{at}{long}" for at in range(3)}}
    files["facts.json"]["unreachable"] = {"robot9": long}
    page = page_of(write(tmp_path / "run", files), tmp_path / "page.html")
    assert (tmp_path / "page.html").stat().st_size < 150_000
    assert "… (1046000 more characters)" in page.text and "… (1049600 more characters)" in page.text
    assert extracted((tmp_path / "page.html").read_bytes()) == (tmp_path / "run" / "result.json").read_bytes()


def test_a_plan_is_a_page_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "plan.json").write_text(json.dumps(a_run(6)["plan.json"]))
    page = page_of(tmp_path / "plan.json", tmp_path / "page.html")
    loads_nothing(page)
    assert (
        "! Plan that destroys data" in page.text
        and "48 to add; 4 unchanged." in page.text
        and "1 step destroys data" in page.text
    )
    inside = json.loads(extracted((tmp_path / "page.html").read_bytes()))
    assert wrong_numbers(page, inside) == [] and len(inside["steps"]) == 48 and "proof" not in inside
    capsys.readouterr()
    assert run(["report", str(tmp_path / "plan.json"), "-o", str(tmp_path / "page.html"), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert list(Draft202012Validator(data.schema("report")).iter_errors(said)) == [] and said["kind"] == "plan"


def test_what_a_page_of_a_plan_leaves_out_is_counted(tmp_path: Path) -> None:
    """Who reviews a plan by its page, and applies it by its hash, sees what is asked for, or that there is more."""
    plan = a_run(2)["plan.json"]
    move = {"service": "node-1", "volume": "maps", "source": "robot1", "target": "robot2", "how": "move"}
    plan["permissions"] = [{"kind": "host-path", "service": "node-1", "what": f"/srv/{at:04}"} for at in range(2003)]
    plan["notes"] = [f"a note {at}" for at in range(2004)]
    plan["playbooks"] = [{"name": f"{at}.yml", "file": f"/x/{at}.yml", "place": "before"} for at in range(2005)]
    plan["data"] = [move] * 506
    (tmp_path / "plan.json").write_text(json.dumps(plan))
    text = page_of(tmp_path / "plan.json", tmp_path / "page.html").text
    assert all(f"and {more} more, in the data of this page" in text for more in (3, 4, 5))
    assert "data of 6 more, in the data of this page" in text


def test_what_is_grave_behind_a_long_name_is_in_a_page_of_a_plan(tmp_path: Path) -> None:
    """Notes, and what a new container publishes and mounts, end as late as whoever wrote the EDF likes."""
    plan = a_run(2)["plan.json"]
    long = "/dev/./" * 5_000
    plan["notes"] = [f"robot1: the device {long}sensor leads to /dev/bcache0 (a disk)"]
    plan["steps"][0] |= {"cause": f"not there {long}", "makes": f"mounts {long}, publishes 127.0.0.1:5000"}
    (tmp_path / "plan.json").write_text(json.dumps(plan))
    text = page_of(tmp_path / "plan.json", tmp_path / "page.html").text
    assert "leads to /dev/bcache0 (a disk)" in text and "publishes 127.0.0.1:5000" in text


@pytest.mark.parametrize("long", [395, 4096, 200_000])
def test_no_path_is_so_long_that_a_page_hides_what_is_grave_about_it(tmp_path: Path, long: int) -> None:
    """A container that may write to data makes such a folder there, with a link to `/etc` in it, for its next plan."""
    plan = a_run(2)["plan.json"]
    path = f"/srv/{'d' * long}"
    note = f"robot1: {path}, which 'a' mounts, leads to /etc (root may believe it)"
    plan["permissions"] = [{"kind": "host-path", "service": "a", "what": f"{path} (root may run it)"}]
    plan["notes"] = [note]
    (tmp_path / "plan.json").write_text(json.dumps(plan))
    text = page_of(tmp_path / "plan.json", tmp_path / "page.html").text
    assert "(root may run it)" in text and "leads to /etc (root may believe it)" in text
    assert (note in text) == (long < 9000) and ("more characters" in text) == (long > 9000)


def test_a_bundle_has_its_trials_and_what_each_robot_would_have_cost(tmp_path: Path) -> None:
    page = page_of(RACE, tmp_path / "page.html")
    loads_nothing(page)
    inside = json.loads(extracted((tmp_path / "page.html").read_bytes()))
    assert wrong_numbers(page, inside) == []
    assert sum(tag == "circle" for tag, _ in page.elements) == 3 * 17 + 3 * 18, "one attempt has no steps"
    shown = {pointer for pointer, _, _ in page.numbers}
    metrics = {f"/rows/{at}/{name}" for at, row in enumerate(inside["rows"]) for name in row if name.startswith("m_")}
    assert {one for one in metrics if inside["rows"][int(one.split("/")[2])][one.split("/")[3]] is not None} <= shown
    assert "18 of 18 trials count." in page.text and "tenths in 0.1 s, of attempts that count" in page.text
    assert "Cost of each service on each robot, alone" in page.text and "srprov verify" in page.text


def test_a_run_of_trials_has_a_page_before_it_has_ended_and_without_a_record(tmp_path: Path) -> None:
    folder = tmp_path / "race"
    with zipfile.ZipFile(RACE) as archive:
        archive.extractall(folder)
    whole = page_of(folder, tmp_path / "page.html")
    assert "18 of 18 trials count." in whole.text and "srprov verify" not in whole.text
    lines = (folder / "journal.jsonl").read_text().splitlines(keepends=True)
    (folder / "journal.jsonl").write_text("".join(lines[:85]) + lines[85][:20])
    begun = page_of(folder, tmp_path / "page.html")
    assert "! Not complete" in begun.text and "10 of 18 trials count: it has not ended, or was killed." in begun.text
    assert sum(tag == "circle" for tag, _ in begun.elements) == 3 * 9 + 3 * 10
    shutil.rmtree(folder / "sessions")
    bare = page_of(folder, tmp_path / "page.html")
    assert "it has no record of its sessions" in bare.text and "plots" in bare.ids and "placement" not in bare.ids


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["nowhere"], "there is no run 'nowhere', nor a file of that name"),
        (["."], ". is no record of a run"),
        (["text"], "text is no plan"),
        (["/dev/null"], "it is a device"),
        (["half.zip"], "half.zip is no bundle"),
    ],
)
def test_anything_else_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: list[str], says: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "text").write_text("hello")
    (tmp_path / "half.zip").write_bytes(RACE.read_bytes()[:5000])
    assert run(["report", *words, "-o", "page.html"]) == 5
    assert says in capsys.readouterr().err
    assert not (tmp_path / "page.html").exists()
    assert run(["report", "text"]) == 5


def test_values_without_end_are_refused_before_they_are_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """A plan of 256 MiB may hold 64 million texts of one letter."""
    monkeypatch.setattr(read, "_MOST_VALUES", 1000)
    data = b'{"plan": 1, "instance": "a", "notes": [' + b'"a",' * 999 + b'"a"]}'
    with pytest.raises(read.Unreadable, match="more than 1000 values"):
        read.decoded(data, PlanView)
    assert read.decoded(data.replace(b'"a",' * 99, b""), PlanView).instance == "a"


@pytest.mark.parametrize("data", [b'inventory = ["./inv.sh"]', b"", b'{"a": 1} x', b'{"a": [1, 2}'])
def test_what_is_no_json_is_not_taken_out_of_a_page(data: bytes) -> None:
    """Whoever wrote it chose that: it became the settings of who took it out."""
    for kind, packed in (("json", data), ("gzip", gzip.compress(data))):
        page = f'<a id="data" download="x" href="data:application/{kind};base64,{base64.b64encode(packed).decode()}"'
        with pytest.raises(ValueError, match="no JSON"):
            extracted(page.encode())
