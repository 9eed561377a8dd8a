"""`srprov fmt` and `srprov init`: what they write, what they leave alone, and how they end."""

from __future__ import annotations

import io
import os
import stat
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from srprov import data
from srprov.cli.main import run
from srprov.definitions import check_files, load_experiment
from srprov.definitions.starter import starter
from srprov.record import RunFolder
from tests.bounded import bounded
from tests.trial_folders import run_folder, write_experiment

ODD = "edf: 1\nservices: {a: {command: [x], image: busybox}} # one\nname: odd\n"
FORMATTED = "edf: 1\nname: odd\nservices: { a: { image: busybox, command: [x] } } # one\n"


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    folder = tmp_path / "work"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


def test_a_file_is_replaced_with_its_permissions(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "e.edf").write_text(ODD)
    (here / "e.edf").chmod(0o644)
    before = (here / "e.edf").stat().st_ino
    assert run(["fmt", "e.edf"]) == 0
    assert (here / "e.edf").read_text() == FORMATTED
    about = (here / "e.edf").stat()
    assert (stat.S_IMODE(about.st_mode), about.st_ino == before) == (0o644, False)
    assert capsys.readouterr() == ("e.edf\n", "1 file, 1 changed\n")
    assert run(["fmt", "e.edf"]) == 0
    assert (here / "e.edf").stat().st_ino == about.st_ino, "what is right already is left alone"
    assert os.listdir(here) == ["e.edf"]


def test_check_and_diff_change_nothing_and_say_so_by_the_code(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "e.edf").write_text(ODD)
    assert run(["fmt", "--check", "e.edf"]) == 2
    assert capsys.readouterr() == ("e.edf\n", "1 file, 1 would change\n")
    assert run(["fmt", "--diff", "e.edf"]) == 2
    out = capsys.readouterr().out
    assert out.startswith("--- e.edf\n+++ e.edf (formatted)\n") and "\n name: odd\n+services: { a: { image:" in out
    assert (here / "e.edf").read_text() == ODD
    (here / "e.edf").write_text(FORMATTED)
    assert run(["fmt", "--check", "--diff", "."]) == 0
    assert capsys.readouterr() == ("", "1 file, 0 would change\n")


def test_of_a_folder_only_definitions_are_taken_and_no_link_is_followed(
    here: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    outside = tmp_path / "outside.edf"
    outside.write_text(ODD)
    (here / ".hidden").mkdir()
    (here / "deep").mkdir()
    left = ["linked.edf", ".hidden/e.edf", "compose.yml", "inventory.yml", "notes.md"]
    (here / left[0]).symlink_to(outside)
    (here / "away").symlink_to(tmp_path)
    for name in left[1:]:
        (here / name).write_text(ODD)
    taken = ["e.edf", "deep/x.edf.yml", "deep/y.EDF.yaml"]
    for name in taken:
        (here / name).write_text(ODD)
    assert run(["fmt", "."]) == 0
    assert [(here / name).read_text() for name in taken] == [FORMATTED] * 3
    assert [(here / name).read_text() for name in left] == [ODD] * 5 and outside.read_text() == ODD
    assert (here / left[0]).is_symlink()
    assert "linked.edf is left as it is: it is a link\n" in capsys.readouterr().err


def records(folder: Path) -> list[Path]:
    """Make a record of a run and one of trials, each with an EDF that is not in its form; return these."""
    with RunFolder(folder / "runs", "run") as record:
        record.put("environment.json", lambda: "{}")
        record.put("inputs/e.edf", lambda: ODD)
    run_folder(folder / "results", write_experiment(folder / "race"))
    made = [folder / "runs/run/inputs/e.edf", folder / "results/sessions/1/inputs/race.edf"]
    made[1].write_text(ODD)
    return made


def test_records_stay_as_they_are(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A bundle, and who compares two runs, go by every byte of them."""
    kept = records(here)
    (here / "e.edf").write_text(ODD)
    assert run(["fmt", "."]) == 0
    assert (here / "e.edf").read_text() == FORMATTED
    for way in (kept[0], kept[1].relative_to(here), here / "runs/run", "results/sessions"):
        capsys.readouterr()
        assert run(["fmt", "--check", str(way)]) == 0
        assert f"{way} is left as it is: it lies in a record of srprov's own\n" in capsys.readouterr().err
    assert [one.read_text() for one in kept] == [ODD, ODD]


def test_nothing_below_srprov_s_own_folder_is_taken(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(here / "state"))
    (here / "state/srprov/owners").mkdir(parents=True)
    (here / "state/srprov/owners/e.edf").write_text(ODD)
    (here / "e.edf").write_text(ODD)
    assert run(["fmt", str(here)]) == 0
    assert (here / "state/srprov/owners/e.edf").read_text() == ODD != (here / "e.edf").read_text()


@pytest.mark.parametrize("word", ["linked", "linked/", "linked/below", "HERE/linked", "HERE/linked/"])
def test_no_linked_folder_is_entered_also_where_it_leads_to_one_beside_it(
    here: Path, capsys: pytest.CaptureFixture[str], word: str
) -> None:
    """What was unpacked in the home may have links to what else lies there."""
    (here / "own/below").mkdir(parents=True)
    (here / "own/below/e.edf").write_text(ODD)
    (here / "linked").symlink_to("own")
    assert run(["fmt", word.replace("HERE", str(here))]) == 5
    assert "nothing is written by way of it" in capsys.readouterr().err
    assert (here / "own/below/e.edf").read_text() == ODD


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("e.edf", "a: [1\n", "e.edf:2:1: error[SRP-102]: is not valid YAML"),
        ("e.edf", "%YAML 1.1\n---\na: 1\n", "e.edf:1:1: error[SRP-102]: cannot be brought into form: it"),
        ("inv.yml", "all: {hosts: {r1: }}\n", "inv.yml:1:1: error[SRP-104]: is neither an EDF nor a CDF"),
        ("compose.yml", "services: {a: {image: busybox}}\n", "is neither an EDF nor a CDF"),
        ("Dockerfile", "FROM busybox\n", "is neither an EDF nor a CDF"),
        ("none.edf", None, "there is no such file"),
    ],
)
def test_what_has_no_form_is_told_and_the_others_are_done(
    here: Path, capsys: pytest.CaptureFixture[str], name: str, text: str | None, words: str
) -> None:
    (here / "good.edf").write_text(ODD)
    if text is not None:
        (here / name).write_text(text)
    assert run(["fmt", name, "good.edf"]) == 5
    assert words in capsys.readouterr().err
    assert (here / "good.edf").read_text() == FORMATTED
    assert text is None or (here / name).read_text() == text


@pytest.mark.parametrize("word", ["away", "away/", "away/own.edf", "./away/below"])
def test_no_file_is_written_by_way_of_a_link_that_leads_out(
    here: Path, tmp_path_factory: pytest.TempPathFactory, capsys: pytest.CaptureFixture[str], word: str
) -> None:
    """Files of the user's were brought into form when a project had a link to their folder."""
    own = tmp_path_factory.mktemp("own")
    (own / "below").mkdir()
    for file in (own / "own.edf", own / "below/own.edf"):
        file.write_text(ODD)
    (here / "away").symlink_to(own)
    assert run(["fmt", word]) == 5
    assert "nothing is written by way of it" in capsys.readouterr().err
    assert (own / "own.edf").read_text() == ODD == (own / "below/own.edf").read_text()


@pytest.mark.parametrize("moment", ["srprov.definitions.formatting.canonical", "srprov.yamldoc.loader.read_text"])
def test_no_file_is_written_by_way_of_a_link_that_is_put_there_meanwhile(
    here: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], moment: str
) -> None:
    """A file of the user's was replaced when a folder above became a link while the text was brought into form."""
    own = tmp_path / "own"
    for folder in (own, here / "sub"):
        folder.mkdir()
        (folder / "e.edf").write_text(ODD)
    room, _, name = moment.rpartition(".")
    function = getattr(sys.modules[room], name)

    def swapping(*given: object, **more: object) -> object:
        if not (here / "moved").exists():
            (here / "sub").rename(here / "moved")
            (here / "sub").symlink_to(own)
        return function(*given, **more)

    monkeypatch.setattr(moment, swapping)
    assert run(["fmt", "."]) != 0
    assert "changed while it was read" in capsys.readouterr().err
    assert (own / "e.edf").read_text() == ODD and os.listdir(own) == ["e.edf"]


def test_a_link_that_is_named_is_refused(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "real.edf").write_text(ODD)
    (here / "link.edf").symlink_to("real.edf")
    assert run(["fmt", "link.edf"]) == 5
    assert "is a link, which would be replaced by a file" in capsys.readouterr().err
    assert (here / "real.edf").read_text() == ODD and (here / "link.edf").is_symlink()


@pytest.mark.parametrize("words", [("fmt", "."), ("fmt", "--diff", "camera.cdf"), ("fmt", "--check", "camera.cdf")])
def test_no_file_of_the_user_s_becomes_the_experiment_s(
    here: Path, tmp_path_factory: pytest.TempPathFactory, capsys: pytest.CaptureFixture[str], words: tuple[str, ...]
) -> None:
    """An archive makes a hard link, as which it is asked for; brought into form, it was a file like any other."""
    own = tmp_path_factory.mktemp("own") / "hosts.yml"
    own.write_text("github.com:\n    oauth_token: decoy\n")
    (here / "camera.cdf").hardlink_to(own)
    assert run(list(words)) == 5
    said = capsys.readouterr()
    assert "camera.cdf:1:1: error" in said.err and "has another name (a hard link), and is not read" in said.err
    assert "decoy" not in said.out + said.err and (here / "camera.cdf").samefile(own)


def test_standard_input_comes_back_on_standard_output(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for arguments, code, out in ((["-"], 0, FORMATTED), (["--check", "-"], 2, "")):
        monkeypatch.setattr("sys.stdin", SimpleNamespace(buffer=io.BytesIO(ODD.encode())))
        assert run(["fmt", *arguments]) == code
        assert capsys.readouterr().out == out


def test_a_new_experiment_is_valid_small_and_in_its_form(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["init", "My Robots_2"]) == 0
    told = capsys.readouterr()
    made = here / "My Robots_2"
    names = ["experiment.edf", "talker.cdf", "talker.sh", "inventory.yml", ".gitignore"]
    assert told.out.splitlines() == [f"My Robots_2/{name}" for name in names]
    assert "cd 'My Robots_2'" in told.err
    assert sorted(one.name for one in made.iterdir()) == sorted(names)
    assert check_files([str(made / name) for name in ("experiment.edf", "talker.cdf", "inventory.yml")]) == []
    found = load_experiment(str(made / "experiment.edf"))
    assert found.experiment.name == "my-robots-2" and len(found.experiment.services) == 2
    assert run(["fmt", "--check", str(made)]) == 0
    assert os.access(made / "talker.sh", os.X_OK)
    assert max(len(text.splitlines()) for text in starter("x").values()) <= 40


@pytest.mark.parametrize(
    ("folder", "name"), [("a" * 40, "a" * 32), ("2026", "2026"), ("---", "experiment"), ("Ä", "experiment")]
)
def test_an_experiment_is_called_as_its_folder_as_far_as_that_goes(here: Path, folder: str, name: str) -> None:
    assert (
        f"\nname: {name}\n" in starter(folder)["experiment.edf"]
        or f'\nname: "{name}"\n' in (starter(folder)["experiment.edf"])
    )


def test_nothing_is_overwritten_and_all_that_is_there_is_named(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "talker.cdf").write_text("mine")
    (here / ".gitignore").symlink_to("nowhere")
    assert run(["init"]) == 5
    assert "already there: talker.cdf, .gitignore" in capsys.readouterr().err
    assert sorted(os.listdir(here)) == [".gitignore", "talker.cdf"]
    assert (here / "talker.cdf").read_text() == "mine"


@pytest.mark.parametrize("name", ["group_vars", "host_vars"])
def test_an_inventory_is_begun_beside_nobody_s_variables(
    here: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """A project that was cloned may bring a ProxyCommand there, which `-i inventory.yml` would run."""
    (here / name).symlink_to("elsewhere")
    assert run(["init"]) == 5
    assert f"{name} would be read with the new inventory.yml" in capsys.readouterr().err
    assert os.listdir(here) == [name]
    assert run(["init", "--example", "hello"]) == 0


def test_no_experiment_is_begun_beside_a_lock_for_it(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A project that was cloned may bring one, which says what the new one's images are."""
    (here / "experiment.lock").write_text("{}")
    assert run(["init"]) == 5
    assert "already there: experiment.lock" in capsys.readouterr().err and os.listdir(here) == ["experiment.lock"]


def test_a_folder_that_cannot_be_made_is_told(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (here / "file").write_text("x")
    assert run(["init", "file/new"]) == 5
    assert "Not a directory" in capsys.readouterr().err


def test_every_example_that_ships_can_be_begun_with(here: Path) -> None:
    assert {"hello", "race"} <= set(data.example_names())
    for name in data.example_names():
        assert run(["init", name, "--example", name]) == 0
        assert check_files([str(here / name / "experiment.edf")]) == []
    assert (here / "hello/www/greeting.txt").is_file()
    assert run(["init", "x", "--example", "no-such"]) == 5


def test_a_stranger_s_file_is_compared_in_time(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Lines that come again and again between others that differ may each be matched with each."""
    lines = "".join(f"# s{n % 100}\nx-{n}:   {n}\n" for n in range(9_000))
    (here / "e.edf").write_text(f"edf: 1\nname: x\nservices: {{a: {{image: b}}}}\n{lines}")
    assert bounded(lambda: run(["fmt", "--diff", "e.edf"]), cpu_s=4.0) == 2


NESTED = "".join(f"{' ' * depth}a:\n" for depth in range(1, 55))
SIGNS = ", ".join(['"#"'] * 18_000)
LARGE = {
    "comments that are none": f"edf: 1\nx-a: [{'a, ' * 9_000}'{'#' * 500_000}']\n",
    "texts of a sign": f"edf: 1\nx-a: [{SIGNS}]\n",
    "empty lines": "edf: 1\nx-a:\n" + NESTED + " " * 56 + "b" + "\n" * 2_000_000,
    "many values": f"edf: 1\nx-a: [{'a, ' * 190_000}]\n",
    "megabytes": f"edf: 1\nx-a: {'a' * 7_000_000}\n",
}


@pytest.mark.parametrize("case", LARGE)
def test_a_stranger_s_file_is_brought_into_form_in_time(
    here: Path, capsys: pytest.CaptureFixture[str], case: str
) -> None:
    (here / "e.edf").write_text(LARGE[case])
    assert bounded(lambda: run(["fmt", "--check", "e.edf"]), cpu_s=4.0) in (0, 2, 5)


HEAD = "edf: 1\nname: a\nservices: {a: {image: b}}\n"
LINES = {
    "comments": "# c\n" * 400_000 + HEAD,
    "empty lines": HEAD + "\n" * 1_900_000 + "x-a: 1\n",
    "a long text": f"{HEAD}x-a: |\n" + "  #a: b\n" * 200_000,
    "ends of old Macs": "# c\r" * 400_000 + HEAD,
}


@pytest.mark.parametrize("case", LINES)
def test_more_lines_than_anybody_writes_are_refused(here: Path, case: str) -> None:
    for name in ("e.edf", "e.yml"):
        (here / name).write_text(LINES[case])
        assert bounded(lambda name=name: run(["fmt", name])) == 5
        assert (here / name).read_bytes() == LINES[case].encode()


def test_the_most_lines_are_brought_into_form_in_time(here: Path) -> None:
    (here / "e.edf").write_text("#c\n" * 99_000 + HEAD)
    assert bounded(lambda: run(["fmt", "--check", "e.edf"])) == 2


def test_a_text_of_signs_between_others_is_no_comment(here: Path) -> None:
    text = HEAD + "x-a: '#' # one\nx-b: |\n  # no\n\n  # comment\nx-c: [\"#\", '# #'] # two\n"
    (here / "e.edf").write_text(text)
    assert run(["fmt", "e.edf"]) == 0
    assert [line for line in (here / "e.edf").read_text().splitlines() if line.startswith("x-")] == [
        'x-a: "#" # one',
        "x-b: |",
        'x-c: ["#", "# #"] # two',
    ]
