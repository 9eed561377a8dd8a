"""A bundle that is replayed where another one was before: what that one left is not its own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from srprov.cli.inputs import named_instance
from srprov.controller.owners import Owner, keep, note_bundle, owners_of, read_owner, with_bundle
from srprov.errors import RefusedError
from tests.fakes import World
from tests.worlds import experiment, plan_for, run, service


@pytest.fixture(autouse=True)
def _own_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def test_each_bundle_has_a_token_of_its_own(tmp_path: Path) -> None:
    """By the path alone, a stranger's container had the data that somebody else's bundle had left."""
    edf = str(tmp_path / "again/experiment/tour.edf")
    note_bundle("tour", edf, "a")
    mine = read_owner("tour", edf)
    assert mine.token and with_bundle("x", mine) == "x, bundle a"
    note_bundle("tour", edf, "a")
    assert read_owner("tour", edf) == mine, "the same bundle goes on"
    note_bundle("tour", edf, "b")
    other = read_owner("tour", edf)
    assert with_bundle("x", other) == "x, bundle b"
    assert other.label("r1", "srprov.tour.data") != mine.label("r1", "srprov.tour.data")


def test_a_bundle_that_comes_back_has_what_was_made_of_it(tmp_path: Path) -> None:
    """Who only tried another one, which was refused, lost his own data to `--adopt`, and was told that it was none."""
    edf = str(tmp_path / "tour.edf")
    note_bundle("tour", edf, "a")
    mine = read_owner("tour", edf)
    for other in ("b", "c"):
        note_bundle("tour", edf, other)
        assert read_owner("tour", edf).token != mine.token
    note_bundle("tour", edf, "a")
    now = read_owner("tour", edf)
    assert (now.token, now.bundle) == (mine.token, "a")


def test_a_bundle_that_comes_back_has_what_it_took_over(tmp_path: Path) -> None:
    """As a newer bundle has the data of an older one by `--adopt`, which is said once."""
    edf = str(tmp_path / "tour.edf")
    note_bundle("tour", edf, "newer")
    keep(replace(read_owner("tour", edf), adopted=frozenset({"r1/data/1"}), places={"data": "r1"}))
    mine = read_owner("tour", edf)
    note_bundle("tour", edf, "b")
    other = read_owner("tour", edf)
    assert other.token != mine.token and not other.adopted and not other.places
    note_bundle("tour", edf, "newer")
    now = read_owner("tour", edf)
    assert (now.token, now.adopted, dict(now.places)) == (mine.token, mine.adopted, {"data": "r1"})


def test_a_repository_that_lay_there_before_has_its_own_token_still(tmp_path: Path) -> None:
    """And the bundle in its place one of its own, which is found again."""
    edf = str(tmp_path / "tour.edf")
    keep(Owner(instance="tour", edf=edf, source="https://lab.example/tour#tour.edf", token="t"))
    note_bundle("tour", edf, "b")
    mine = read_owner("tour", edf)
    assert mine.bundle == "b" and mine.token != "t"
    (tmp_path / ".git").mkdir()
    (tmp_path / ".git" / "config").write_text('[remote "origin"]\nurl = https://lab.example/tour\n')
    assert read_owner("tour", edf).token == "t"


def test_an_experiment_that_lay_there_before_leaves_nothing_either(tmp_path: Path) -> None:
    """Whatever its instances are called, and also what they had taken over."""
    edf = str(tmp_path / "tour.edf")
    for name in ("tour", "second"):
        keep(Owner(instance=name, edf=edf, token="t", adopted=frozenset({"r1/x/y"}), places={"x": "r1"}))
    keep(Owner(instance="tour", edf=f"{edf}.other", token="t"))
    note_bundle("tour", edf, "b")
    for name in ("tour", "second"):
        now = read_owner(name, edf)
        assert now.bundle == "b" and now.token != "t" and not now.adopted and not now.places
    assert read_owner("tour", f"{edf}.other").token == "t"


def test_what_another_bundle_left_is_taken_over_by_word_alone(tmp_path: Path) -> None:
    """Containers too: a service that both have would go on with what it holds, also when this one ran elsewhere first.

    As in a lab, where whoever does not know a bundle tries it.
    """
    edf = str(tmp_path / "hello.edf")
    what = experiment(service("web", robot="r1"))
    world, other = World().add("r1"), World().add("r1")
    note_bundle("hello", edf, "a")
    assert run(world, plan_for(world, what, owner=read_owner("hello", edf))).exit_code == 0
    note_bundle("hello", edf, "b")
    owner = read_owner("hello", edf)
    assert run(other, plan_for(other, what, owner=owner)).exit_code == 0
    with pytest.raises(RefusedError, match=r"made from .*/hello.edf, bundle a, not from .*/hello.edf, bundle b"):
        plan_for(world, what, owner=owner)
    assert plan_for(world, what, owner=owner, adopt=True)
    note_bundle("hello", edf, "a")
    assert not plan_for(world, what, owner=read_owner("hello", edf)).steps, "it comes back"


def test_a_further_edf_of_a_bundle_has_nothing_of_an_earlier_one_either(tmp_path: Path) -> None:
    """A bundle may bring several, and run trials of one that nobody knows: the next `apply` was of another one."""
    home = tmp_path / "again/experiment"
    for name in ("tour", "lab/tour"):
        keep(Owner(instance="tour", edf=str(home / f"{name}.edf"), token="t", bundle="a"))
    keep(Owner(instance="tour", edf=str(tmp_path / "again/experiments/tour.edf"), token="t"))
    note_bundle("other", str(home / "other.edf"), "b", str(home))
    for name in ("tour", "lab/tour"):
        now = read_owner("tour", str(home / f"{name}.edf"))
        assert now.bundle == "b" and now.token != "t"
    assert read_owner("tour", str(tmp_path / "again/experiments/tour.edf")).token == "t", "it lies elsewhere"
    note_bundle("tour", str(home / "tour.edf"), "a", str(home))
    assert read_owner("tour", str(home / "tour.edf")).token == "t"


def test_who_goes_on_with_what_is_there_means_no_other_bundle_s(tmp_path: Path) -> None:
    """`collect` brought its logs, `exec` gave it the user's words, and `stop` stopped it, by the path alone."""
    edf = tmp_path / "tour.edf"
    edf.write_text("{edf: 1, name: tour, services: {a: {image: busybox}}}")
    note_bundle("tour", str(edf), "a")
    name, source = named_instance(str(edf), "")
    assert name == "tour" and source.endswith("/tour.edf, bundle a")
    note_bundle("tour", str(edf), "b")
    assert named_instance(str(edf), "") == ("tour", source.replace("bundle a", "bundle b"))
    assert named_instance(str(edf), "mine") == ("mine", source.removesuffix(", bundle a"))


def test_a_source_in_a_repository_is_found_again_with_its_bundle(tmp_path: Path) -> None:
    """Who owns an instance is kept by the repository; a plan names the bundle, too, and keeps both."""
    edf = str(tmp_path / "tour.edf")
    (tmp_path / ".git").mkdir()
    (tmp_path / ".git" / "config").write_text('[remote "origin"]\nurl = https://lab.example/tour\n')
    note_bundle("tour", edf, "b")
    mine = read_owner("tour", edf)
    source = with_bundle("https://lab.example/tour#tour.edf", mine)
    assert (mine.bundle, mine.source) == ("b", source)
    keep(replace(mine, source=source, places={"x": "r1"}))
    now = read_owner("tour", edf)
    assert (now.token, now.places) == (mine.token, {"x": "r1"})
    assert owners_of("tour", source) == (now,), "a plan file of it is known"
    note_bundle("tour", edf, "c")
    other = read_owner("tour", edf)
    assert other.token != mine.token
    assert owners_of("tour", source.replace("bundle b", "bundle c")) == (other,), "before anything is made of it"
