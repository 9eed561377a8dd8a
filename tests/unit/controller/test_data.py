"""Where data is, who owns it, and what a plan says of it; values in and out."""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from srprov.controller.data import data_now, held_fast, holdings
from srprov.controller.data_owner import check_owner, check_saved
from srprov.controller.data_plan import plan_data
from srprov.controller.kept import remedy, volume_rows
from srprov.controller.owners import Owner, identity, keep, owners_folder, owners_of, read_owner
from srprov.controller.permissions import permit_run
from srprov.controller.request import PlanRequest
from srprov.definitions.containermodel import Mount
from srprov.definitions.expand import expand
from srprov.definitions.model import Experiment
from srprov.definitions.source import source_of
from srprov.errors import RefusedError, UsageError
from srprov.facts.model import HostFacts, Snapshot
from srprov.modules import MODULES
from srprov.planning.diff import diff, removal_plan
from srprov.planning.plan import Plan
from srprov.resource import Action, Observed, Resource
from srprov.wire import Reply
from tests.resources import resource
from tests.worlds import experiment, service

MINE = Owner(instance="x", edf="/e/x.edf", token="0123456789abcdef")
LOG = "srprov.x.log"
EARLY, LATE = "2026-11-22T09:00:00+02:00", "2026-11-22T08:00:00Z"
"""The later one by the clock sorts first as text."""


def volume(
    robot: str, created: str = EARLY, owner: Owner | None = MINE, copy: str = "", half: bool = False
) -> Observed:
    label = owner.label(robot, LOG) if owner else ""
    state = {"source": "", "owner": label, "copy": copy, "created": created, "place": "", "half": half}
    return Observed(module="volume", name=LOG, instance="x", state=state)


def robots(away: tuple[str, ...] = (), **found: Observed | None) -> Snapshot:
    return Snapshot(
        facts={name: HostFacts(name=name) for name in found if name not in away},
        observed={name: (one,) if one else () for name, one in found.items() if name not in away},
        unreachable=dict.fromkeys(away, "no route"),
    )


def web(**more: Any) -> Experiment:
    return experiment(service("web", mounts=(Mount(kind="volume", source="log", target="/l"),), **more), name="x")


def data_of(what: Experiment, seen: Snapshot, target: str, previous: dict[str, str], **wishes: Any) -> Any:
    request = PlanRequest(**{"owner": MINE, **wishes})
    now = data_now(what, seen, "x", previous, request)
    return now, plan_data(what, {"web": target}, now, seen, request)


def test_a_service_is_held_where_it_runs_else_where_its_newest_data_is() -> None:
    """By the moment that the engines name, whatever their time zones; a half copy is no data."""
    seen = robots(r1=volume("r1", LATE), r2=volume("r2", EARLY), r3=volume("r3", LATE, half=True))
    request = PlanRequest(owner=MINE)
    assert data_now(web(), seen, "x", {}, request).home == {"web": "r1"}
    assert data_now(web(), seen, "x", {"web": "r2"}, request).home == {"web": "r2"}
    assert data_now(web(), seen, "x", {"web": "r3"}, request).home == {"web": "r1"}
    held = held_fast(web(), {"web": "r1"}, seen).services["web"]
    assert held.data_on == "r1"
    assert held_fast(web(robot="r2"), {"web": "r1"}, seen).services["web"].data_on == ""


def test_a_move_of_data_is_said_and_refused_until_it_is_decided() -> None:
    """The plan names it; a run is refused without `--data`."""
    seen = robots(r1=volume("r1"), r2=None)
    _, undecided = data_of(web(robot="r2"), seen, "r2", {"web": "r1"})
    plan = Plan(instance="x", source="s", steps=(), data=undecided.moves)
    assert "data of web stays on r1" in plan.data[0].text
    with pytest.raises(RefusedError, match="data of web stays on r1") as refused:
        permit_run(plan, {"all"})
    assert refused.value.exit_code == 9
    for how in ("move", "leave"):
        _, decided = data_of(web(robot="r2"), seen, "r2", {"web": "r1"}, data=how)
        permit_run(replace(plan, data=decided.moves), ())
        assert bool(decided.copies) == (how == "move")


def test_data_on_a_robot_out_of_reach_is_left_only_by_word() -> None:
    """What ran there may hold data that cannot be seen; it cannot be copied."""
    seen = robots(("r1",), r1=volume("r1"), r2=None)
    _, undecided = data_of(web(), seen, "r2", {"web": "r1"})
    assert [(one.source, one.how) for one in undecided.moves] == [("r1", "")]
    with pytest.raises(RefusedError, match="cannot be reached, so it cannot be moved"):
        data_of(web(), seen, "r2", {"web": "r1"}, data="move")
    assert data_of(web(), seen, "r2", {"web": "r1"}, data="leave")[1].moves[0].how == "leave"


def test_data_is_not_copied_over_other_data() -> None:
    """A volume of the name on the target is refused, also one that was copied away from there."""
    both = robots(r1=volume("r1"), r2=volume("r2"))
    with pytest.raises(RefusedError, match="r2 has a volume"):
        data_of(web(robot="r2"), both, "r2", {"web": "r1"}, data="move")
    label = MINE.copy_label("r1", EARLY, "r2", LOG)
    finished = robots(r1=volume("r1"), r2=volume("r2", LATE, copy=label))
    with pytest.raises(RefusedError, match="r1 has a volume"):
        data_of(web(robot="r1"), finished, "r1", {"web": "r1"}, data="move")


def test_a_whole_copy_replaces_its_source_only_with_the_owners_label_and_word() -> None:
    """A robot cannot claim to have a copy; and what is there since is another volume."""
    label = MINE.copy_label("r1", EARLY, "r2", LOG)
    whole = robots(r1=volume("r1"), r2=volume("r2", LATE, copy=label))
    now, plan = data_of(web(), whole, "r2", {"web": "r1"}, data="move")
    assert now.home == {"web": "r2"} and plan.copies == {("r2", LOG): ("r1", label)}
    assert [(one.source, one.target, one.how) for one in plan.moves] == [("r1", "r2", "move")], "it is said, too"
    _, quiet = data_of(web(), whole, "r2", {"web": "r2"})
    assert quiet.copies == {} and "--data move removes it on r1" in quiet.notes[0]
    for seen in (
        robots(r1=volume("r1"), r2=volume("r2", LATE, copy="f" * 40)),
        robots(r1=volume("r1", LATE), r2=volume("r2", LATE, copy=label)),
    ):
        assert holdings(seen, "x", MINE, adopt=False).copied == {}


def test_what_somebody_else_made_is_neither_attached_nor_passed_over() -> None:
    """Not on the robot, not elsewhere; a robot that claims data beside the owner's own changes nothing."""
    other = Owner(instance="x", token="ffff")
    for seen in (robots(r1=volume("r1", owner=other), r2=None), robots(r1=volume("r1", owner=None), r2=None)):
        for target in ("r1", "r2"):
            with pytest.raises(RefusedError, match=f"{LOG} on r1"):
                data_of(web(), seen, target, {})
            data_of(web(), seen, target, {"web": target}, adopt=True)
    claimed = robots(r1=volume("r1"), r2=volume("r2", LATE, owner=other))
    now, _ = data_of(web(), claimed, "r1", {})
    assert now.home == {"web": "r1"}
    with pytest.raises(RefusedError, match=f"{LOG} on r2"):
        check_owner(web(), {"web": "r2"}, now)
    assert MINE.label("r1", LOG) != MINE.label("r2", LOG), "a label is worth nothing on another robot"


def test_a_token_is_kept_under_instance_and_real_path_and_read_by_its_owner_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Through a link it is the same file; a broken file counts as none."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    edf = tmp_path / "x.edf"
    edf.touch()
    (tmp_path / "link.edf").symlink_to(edf)
    fresh = read_owner("../../x", str(edf))
    assert fresh != read_owner("../../x", str(edf)) and fresh.token not in repr(fresh)
    item = volume("r1", owner=None)
    keep(dataclasses.replace(fresh, source="s", adopted=frozenset({identity("r1", item)})))
    (file,) = owners_folder().iterdir()
    assert (file.stat().st_mode & 0o777, file.parent.stat().st_mode & 0o777) == (0o600, 0o700)
    again = read_owner("../../x", str(tmp_path / "link.edf"))
    assert again.token == fresh.token and again.knows("r1", item) and not again.knows("r2", item)
    assert read_owner("y", str(edf)).token != fresh.token
    assert [one.token for one in owners_of("../../x", "s")] == [fresh.token] and owners_of("../../x", "t") == ()
    for text in ("", "{", json.dumps({"token": 1}), "[" * 100_000):
        file.write_text(text, encoding="utf-8")
        assert read_owner("../../x", str(edf)).token != fresh.token


@pytest.mark.parametrize("first", ["", "https://lab.example/nav"])
def test_a_token_is_none_of_another_repository_s_at_the_same_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, first: str
) -> None:
    """The user's own is gone, its data was kept, and a stranger's was cloned to that folder."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    edf = tmp_path / "nav" / "nav.edf"
    edf.parent.mkdir()

    def made(url: str) -> Owner:
        """Read and keep the owner, as an `apply` does, of the EDF of a checkout from there; or of a plain folder."""
        shutil.rmtree(edf.parent)
        (edf.parent / ".git").mkdir(parents=True)
        (edf.parent / ".git" / "config").write_text(f'[remote "origin"]\nurl = {url}\n' if url else "")
        owner = read_owner("nav", str(edf))
        keep(dataclasses.replace(owner, source=source_of(str(edf))))
        return owner

    mine = made(first)
    strange = made("https://evil.example/nav")
    assert strange.token != mine.token and not strange.knows("r1", volume("r1", owner=mine))
    assert made(first).token == mine.token and made("https://evil.example/nav").token == strange.token


def test_a_token_stays_where_the_machine_is_called_otherwise(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    owner = read_owner("nav", str(tmp_path / "nav.edf"))
    keep(dataclasses.replace(owner, source=f"me@before:{tmp_path}/nav.edf"))
    assert read_owner("nav", str(tmp_path / "nav.edf")).token == owner.token


def test_a_token_beside_a_repository_s_stays_where_the_machine_is_called_otherwise(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    edf = str(tmp_path / "nav.edf")
    keep(dataclasses.replace(read_owner("nav", edf), source="https://lab.example/nav#nav.edf"))
    owner = read_owner("nav", edf)
    keep(dataclasses.replace(owner, source=f"me@before:{edf}"))
    assert read_owner("nav", edf).token == owner.token


def test_a_plan_from_a_file_is_held_against_the_tokens_of_who_wrote_it() -> None:
    """What its steps mount, make or remove."""
    seen = robots(r1=volume("r1"))
    plan = Plan(instance="x", source="s", steps=removal_plan(seen.observed, "x", volumes=True))
    for owners in ([], [dataclasses.replace(MINE, token="another")]):
        with pytest.raises(RefusedError, match=f"{LOG} on r1"):
            check_saved(plan, (), seen, owners)
    check_saved(plan, (), seen, [MINE])
    with pytest.raises(RefusedError):
        check_saved(replace(plan, instance="y"), (), seen, [MINE])


def test_each_replica_has_a_volume_of_its_own() -> None:
    """And one on each robot has the name as it stands."""
    mounts = (Mount(kind="volume", source="log", target="/l"), Mount(kind="tree", source="/e/t", target="/t"))
    one = service("web", mounts=mounts)
    some = expand(experiment(replace(one, replicas=2)), {})
    assert [[m.source for m in s.runtime.mounts] for s in some.services.values()] == [
        ["log-1", "/e/t"],
        ["log-2", "/e/t"],
    ]
    everywhere = expand(experiment(replace(one, per_robot=())), {"r1": [], "r2": []})
    assert {m.source for s in everywhere.services.values() for m in s.runtime.mounts} == {"log", "/e/t"}


def test_data_that_was_kept_on_a_robot_out_of_reach_is_not_forgotten() -> None:
    """Nothing runs and no record is left; the owner knows where the volume was made last."""
    seen = robots(("r1",), r1=volume("r1"), r2=None)
    knows = dataclasses.replace(MINE, places={LOG: "r1"})
    now, plan = data_of(web(), seen, "r2", {}, owner=knows)
    assert now.home == {"web": "r1"} and [(one.source, one.how) for one in plan.moves] == [("r1", "")]
    here = robots(r1=None, r2=None)
    assert data_of(web(), here, "r2", {}, owner=knows)[1].moves == (), "it can be seen that it is gone"


def test_a_plan_cannot_have_data_removed_that_was_not_copied() -> None:
    """A volume that is on the target for another reason is no copy, and the proof in a file is worked out again."""

    def wants(copy: str) -> Resource:
        written = {"instance": "x", "source": "s", "from": "r1", "copy": copy}
        return resource("volume", LOG, written, host="r2", source="p")

    label = MINE.copy_label("r1", EARLY, "r2", LOG)
    left = robots(r1=volume("r1"), r2=volume("r2", LATE, copy="a" * 40))
    for copy in ("", label, "b" * 40):
        assert diff([wants(copy)], left.observed, "x")[0] == (), "nothing was copied, so nothing is removed"
    plan = Plan(instance="x", source="s", steps=())
    for copy in ("", "a" * 40):
        with pytest.raises(RefusedError, match=f"{LOG} on r1"):
            check_saved(plan, [wants(copy)], left, [MINE])
    check_saved(plan, [wants(label)], left, [MINE])
    whole = robots(r1=volume("r1"), r2=volume("r2", LATE, copy=label))
    (removal,) = diff([wants(label)], whole.observed, "x")[0]
    assert (removal.host, removal.change.action, removal.change.destructive) == ("r1", Action.DELETE, False)


def test_kept_data_is_removed_on_its_robot_alone() -> None:
    """A robot may call a volume of its own one of an instance that runs on others: `doctor` says what removes it."""
    box = Observed(module="container", name="srprov.x.a", instance="x", state={})
    found = Snapshot(facts={}, observed={"r1": (volume("r1"),), "r2": (box, volume("r2"))})
    (row,) = volume_rows(found, "", kept=True)
    assert remedy(row) == "srprov destroy --instance x --volumes --limit r1"


def test_what_a_robot_says_of_its_volumes_makes_nobody_forget_the_token(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With `--adopt` labels of a robot are kept beside the token by which the volumes of all robots are known."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    keep(MINE)
    said = [
        {"Name": f"srprov.x.v{one}", "CreatedAt": "9" * 60_000, "Labels": {"srprov.owner": "f" * 60_000}}
        for one in range(30)
    ]
    replies = [Reply(status=200, out=json.dumps({"Volumes": said})), Reply(status=200, out="{}")]
    found = MODULES["volume"].parse(replies)
    snapshot = Snapshot(facts={"r1": HostFacts(name="r1")}, observed={"r1": found}, unreachable={})
    adopted = holdings(snapshot, "x", MINE, adopt=True).adopted
    assert len(adopted) == 30
    keep(dataclasses.replace(MINE, adopted=adopted))
    assert read_owner("x", MINE.edf).token == MINE.token

    many = frozenset(str(one) * 200 for one in range(2000))
    with pytest.raises(UsageError, match="cannot write"):
        keep(dataclasses.replace(MINE, adopted=many))
    assert read_owner("x", MINE.edf).token == MINE.token
