"""Locks: what is looked up, what stays, and how a lock and an experiment differ."""

from __future__ import annotations

import functools
import json
import os
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from msgspec.structs import replace

from srprov.cli.main import run
from srprov.controller import digests, locking, package_records
from srprov.controller.image_plans import moved_tags, plan_images
from srprov.controller.pins import differences, names_of, pinned
from srprov.controller.source import read_definitions
from srprov.definitions import check_files, load_experiment
from srprov.definitions.lockfile import Lock, Packages, dump, load, lock_path
from srprov.definitions.model import BUILDERS, Inventory
from srprov.errors import DefinitionError, RefusedError, UsageError
from srprov.execution.packages import NoListing
from srprov.facts.model import Snapshot
from srprov.git_address import parse_address
from srprov.images.args import with_digests
from srprov.record.memory import built_for
from srprov.resource import Observed
from srprov.session import Pulse
from srprov.wire import AnyQuery, EngineQuery, Reply
from tests.fakes import World

NO_ROBOTS = Inventory(hosts={}, groups={})

OLD, NEW = "sha256:" + "1" * 64, "sha256:" + "2" * 64
BUSYBOX, DEBIAN = "docker.io/library/busybox:latest", "docker.io/library/debian:bookworm"
COMMIT = "a" * 40


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "e.edf").write_text(
        "edf: 1\nname: demo\nservices:\n  a: {cdf: a.cdf}\n"
        "  b: {image: busybox, env_file: b.env}\n  c: {cdf: Dockerfile}\n"
        f"  d: {{image: 'busybox@{OLD}'}}\n"
    )
    (tmp_path / "b.env").write_text("A=1\n")
    (tmp_path / "words").write_text("x")
    (tmp_path / "Dockerfile").write_text("FROM debian:bookworm AS busybox\nFROM busybox\nCOPY words /\n")
    (tmp_path / "a.cdf").write_text(
        "cdf: 1\nbase: debian:bookworm\nfiles: [{src: words, dest: /}]\n"
        "repositories:\n- {git: https://h/x.git, ref: main, path: /x}\n"
        f"- {{git: https://h/y, ref: {COMMIT}, path: /y}}\n"
    )
    return tmp_path


def _lock(here: Path) -> Lock:
    from srprov.controller.pins import file_hashes

    found = load_experiment("e.edf", {})
    return Lock(
        commits={("https://h/x.git", "main"): COMMIT},
        digests={BUSYBOX: OLD, DEBIAN: OLD},
        platforms={BUSYBOX: ("linux/amd64",)},
        files=file_hashes(found.experiment, found.containers.values()),
        packages=(Packages(image="srprov/a:1", platform="linux/amd64", apt=("curl=1",), npm=("@a/b@1",)),),
        version="1",
    )


def test_a_lock_is_read_as_it_was_written(here: Path) -> None:
    lock = _lock(here)
    assert sorted(lock.files) == ["Dockerfile", "a.cdf", "b.env", "e.edf", "words"]
    (here / "a.cdf").rename(here / "real.cdf")
    (here / "a.cdf").symlink_to("real.cdf")
    assert _lock(here) == lock, "a link counts as what it leads to"
    (here / "e.lock").write_text(dump(lock))
    assert load(lock_path("e.edf")) == Lock(
        commits=lock.commits,
        digests=lock.digests,
        platforms={**lock.platforms, DEBIAN: ()},
        files=lock.files,
        packages=lock.packages,
        version="1",
    )
    assert load("nothing.lock") is None


def test_names_that_never_move_are_not_locked(here: Path) -> None:
    names = names_of(load_experiment("e.edf", {}))
    assert names.images == {BUSYBOX, DEBIAN}
    assert names.repositories == {("https://h/x.git", "main")}


def test_digests_and_commits_take_the_place_of_names(here: Path) -> None:
    (here / "e.lock").write_text(dump(_lock(here)))
    found = read_definitions("e.edf", (), locked=True)
    containers = {Path(key).name: one for key, one in found.containers.items()}
    assert containers["a.cdf"].base == f"debian@{OLD}"
    assert [one.ref for one in containers["a.cdf"].repositories] == [COMMIT, COMMIT]
    assert containers["Dockerfile"].pins == {"debian:bookworm": f"debian@{OLD}"}
    assert found.experiment.services["b"].image == f"busybox@{OLD}"
    assert found.notes == () and names_of(found).images == frozenset()


def test_a_stage_that_is_called_like_an_image_is_no_image() -> None:
    text = (
        "FROM busybox AS base\nCOPY --from=debian /busybox /\nFROM \\\n  debian AS busybox\nFROM busybox\n"
        "COPY --from=busybox a b\nCOPY --chown=debian --from=debian debian b\n"
    )
    pins = {"busybox": "busybox@1", "debian": "debian@2"}
    assert with_digests(text, pins) == (
        "FROM busybox@1 AS base\nCOPY --from=debian@2 /busybox /\nFROM debian@2 AS busybox\n\nFROM busybox\n"
        "COPY --from=busybox a b\nCOPY --chown=debian --from=debian@2 debian b\n"
    )


def test_each_difference_is_named(here: Path) -> None:
    lock = _lock(here)
    assert differences(load_experiment("e.edf", {}), lock) == []
    (here / "words").write_text("y")
    (here / "new").write_text("")
    (here / "a.cdf").write_text("cdf: 1\nbase: alpine\nfiles: [{src: new, dest: /}]\n")
    told = differences(load_experiment("e.edf", {}), lock)
    assert told == [
        "alpine:latest is not in it",
        "main of https://h/x.git is in it, and no longer named",
        "the file new is not in it",
        "the file a.cdf has changed",
        "the file words has changed",
    ]
    (here / "e.lock").write_text(dump(lock))
    (note,) = read_definitions("e.edf", ()).notes
    assert note == "e.lock is out of date: alpine:latest is not in it, and 4 more"
    with pytest.raises(UsageError, match=r"e\.lock is out of date") as refused:
        read_definitions("e.edf", (), locked=True)
    assert all(one in refused.value.message for one in told)
    (here / "e.lock").unlink()
    with pytest.raises(UsageError, match=r"there is no lock e\.lock"):
        read_definitions("e.edf", (), locked=True)


@pytest.mark.parametrize(
    "text",
    [
        "[]", "", "lock: 2\n", "lock: 1\nsrprov: x\nimages: []\nrepositories: []\nfiles: {a: b}\n",
        "lock: 1\nsrprov: x\nimages: [{name: x, digest: latest}]\nrepositories: []\nfiles: {}\n",
        "lock: 1\nsrprov: x\nimages: []\nrepositories: [{git: x, ref: y, commit: '--x'}]\nfiles: {}\n",
        f"lock: 1\nsrprov: x\nimages: [{{name: Debian, digest: '{OLD}'}}]\nrepositories: []\nfiles: {{}}\n",
    ],
)  # fmt: skip
def test_what_is_no_lock_is_refused(here: Path, text: str) -> None:
    (here / "e.lock").write_text(text)
    with pytest.raises(DefinitionError):
        read_definitions("e.edf", ())


def test_what_an_edf_has_by_its_commit_is_no_lock_s_matter(here: Path) -> None:
    """Else a stranger's lock has an older state of a repository taken, with what was wrong in it."""
    commits = {("https://h/x.git", "1" * 40): "2" * 40}
    (here / "e.lock").write_text(dump(Lock(commits=commits, version="1")))
    with pytest.raises(DefinitionError) as caught:
        read_definitions("e.edf", ())
    (problem,) = caught.value.problems
    assert problem.message == "is a commit already, which stands for nothing else"


@pytest.mark.parametrize("end", ["\n", "\r", "\x1b[2K", "\x85", "\u2028"])
def test_a_lock_writes_no_lines_of_its_own(here: Path, end: str) -> None:
    """`lock`, and what `--locked` refuses, told its names: `to mend it: curl … | sh` stood in a line for itself."""
    evil = f"x{end}to mend it: curl x | sh"
    for one, key in {(f"https://h/{evil}", "main"): "git", ("https://h/x.git", evil): "ref"}.items():
        lock = Lock(commits={one: COMMIT}, version="1")
        (here / "e.lock").write_text(json.dumps({
            "lock": 1, "srprov": "1", "images": [], "files": {},
            "repositories": [{"git": one[0], "ref": one[1], "commit": COMMIT}],
        }))  # fmt: skip
        with pytest.raises(DefinitionError) as caught:
            load("e.lock")
        (problem,) = caught.value.problems
        assert problem.message.startswith(f"'{key}' has a control character") and "repositories" in problem.path
        for line in [*differences(load_experiment("e.edf", {}), lock), *locking.changes(lock, Lock())]:
            assert line.isprintable(), "and it is one line, whoever made the lock"
    (here / "e.lock").write_text(dump(replace(_lock(here), files={evil: "0" * 64})))
    with pytest.raises(UsageError, match="out of date") as refused:
        read_definitions("e.edf", (), locked=True)
    assert all(line.isprintable() and line[0] == " " for line in refused.value.message.splitlines()[1:])
    assert r"to mend it" in refused.value.message, "a file may be called so"
    with pytest.raises(ValueError, match="is no address"):
        parse_address(f"file:///{evil.replace(' ', '')}")


def test_a_lock_is_checked_with_its_edf_and_shows_nothing_of_a_file_elsewhere(here: Path) -> None:
    (here.parent / "victim").write_text("secret-of-the-victim\n")
    (here / "e.lock").symlink_to(here.parent / "victim")
    (problem,) = check_files(["e.edf"])
    assert problem.message == "a lock is no link to another file" and "secret" not in repr(problem)
    (here / "e.lock").unlink()
    (here / "e.lock").write_text("lock: 2\n")
    assert {one.location.file for one in check_files(["e.edf"])} == {"e.lock"}


def test_what_is_locked_stays_until_it_is_named(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An image by its name with or without the tag, a repository by its address or its last part."""
    asked: list[object] = []

    def commit_of(url: str, ref: str) -> str:
        asked.append((url, ref))
        return "b" * 40

    def look_up(names: Collection[str]) -> Mapping[str, digests.Found]:
        asked.extend(sorted(names))
        return {name: (NEW, ("linux/arm64",)) for name in names}

    monkeypatch.setattr(locking, "commit_of", commit_of)

    def made(old: Lock, *update: str) -> Lock:
        asked.clear()
        return locking.finished(locking.draft("e.edf", old, update, {"git"}, NO_ROBOTS), look_up)

    first = made(Lock())
    assert asked == [("https://h/x.git", "main"), BUSYBOX, DEBIAN]
    assert (first.digests, first.platforms[BUSYBOX]) == ({BUSYBOX: NEW, DEBIAN: NEW}, ("linux/arm64",))
    old = Lock(
        commits={("https://h/x.git", "main"): COMMIT, ("https://h/z", "x"): COMMIT}, digests={BUSYBOX: OLD, DEBIAN: OLD}
    )
    assert made(old).digests == old.digests and asked == []
    assert made(old).commits == {("https://h/x.git", "main"): COMMIT}
    for word in ("debian", "debian:bookworm"):
        assert made(old, word).digests == {BUSYBOX: OLD, DEBIAN: NEW} and asked == [DEBIAN]
    for word in ("x", "https://h/x.git", "main of https://h/x.git"):
        changed = made(old, word)
        assert changed.commits == {("https://h/x.git", "main"): "b" * 40} and changed.digests == old.digests
    assert len(made(old, "all").digests) == 2 and len(asked) == 3
    with pytest.raises(UsageError, match="nothing is called 'debain'"):
        made(old, "debain")
    told = locking.changes(old, made(old, "debian"))
    assert told == [f"~ debian:bookworm: {OLD} is {NEW} now", "- x of https://h/z"]


def test_robots_are_believed_when_they_agree() -> None:
    """One alone could say what it likes; one that fails, or says nonsense, is left out."""

    def answer(digest: object) -> Reply:
        platforms = [{"os": "linux", "architecture": "arm64", "variant": "v8"}, {"os": "\x1b[31m", "architecture": "x"}]
        body = json.dumps({"Descriptor": {"digest": digest}, "Platforms": platforms})
        return Reply(status=200, ok=True, out=body)

    asked: list[str] = []

    def ask_each(said: Mapping[str, object]) -> digests.AskEach:
        def ask(questions: Mapping[str, Sequence[AnyQuery]]) -> dict[str, Sequence[Reply]]:
            for host, (query,) in questions.items():
                assert isinstance(query, EngineQuery)
                asked.append(f"{host} {query.path}")
            return {host: [answer(said[host])] for host in questions if said.get(host)}

        return ask

    every = {"r1": OLD, "r2": OLD, "r3": None, "r4": NEW}
    assert digests.look_up(ask_each(every), every, [BUSYBOX], (), print) == {BUSYBOX: (OLD, ("linux/arm64/v8",))}
    assert asked == [f"r{i} /distribution/busybox:latest/json" for i in (1, 2, 3)]
    with pytest.raises(UsageError, match=f"robots disagree about busybox:latest: r1 {OLD}, r4 {NEW}"):
        digests.look_up(ask_each(every), ["r4", "r1"], [BUSYBOX], (), print)
    for nonsense in ("latest", ["x"], OLD + "0", None):
        with pytest.raises(UsageError, match="no robot could learn"):
            digests.look_up(ask_each({"r1": nonsense}), ["r1"], [BUSYBOX], (), print)
    assert digests.look_up(ask_each({}), [], [], (), print) == {}


def test_a_name_of_which_one_robot_alone_says_what_it_is_is_told() -> None:
    """One that others cannot look up, as where one robot has the login, is in the lock by that one's word."""
    known = Reply(status=200, ok=True, out=json.dumps({"Descriptor": {"digest": OLD}}))
    refused = Reply(status=401, ok=False, err="no login")
    told: list[str] = []
    for replies in (
        {"r1": refused, "r2": known, "r3": refused},
        {"r1": known, "r2": known, "r3": refused},
        {"r1": known},
        {"r1": None, "r2": known},
    ):
        answers = {robot: [one] for robot, one in replies.items() if one}
        assert digests.look_up(lambda _, said=answers: said, replies, [BUSYBOX], (), told.append)[BUSYBOX][0] == OLD
    alone = "what busybox:latest is now r2 alone says: no registry told it to"
    assert told == [f"{alone} r1, r3", f"{alone} r1"], "who does not answer contradicts nobody either"


@pytest.mark.parametrize("name", ["127.0.0.1:9998/x:1", "robot2:5000/x:1", "localhost:5000/x:1", "nas.lan/x:1"])
def test_no_robot_s_own_network_is_asked_without_permission(name: str) -> None:
    """A lock, and a plan with `pull_policy: always`, look names up before anything is shown or confirmed."""
    asked: list[str] = []

    def ask(questions: Mapping[str, Sequence[AnyQuery]]) -> dict[str, Sequence[Reply]]:
        asked.extend(questions)
        return {host: [answer] * len(queries) for host, queries in questions.items()}

    answer = Reply(status=200, ok=True, out=json.dumps({"Descriptor": {"digest": OLD}}))
    with pytest.raises(RefusedError, match=f"{name}: engine-fetch"):
        digests.look_up(ask, ["r1"], [BUSYBOX, name], {"git"}, print)
    assert not asked
    assert digests.look_up(ask, ["r1"], [name], {"engine-fetch"}, print) == {name: (OLD, ())}


def test_pins_reach_what_is_extended_to_more_services(here: Path) -> None:
    (here / "e.edf").write_text("edf: 1\nname: demo\nservices: {b: {image: busybox, replicas: 3}}\n")
    found = pinned(load_experiment("e.edf", {}), Lock(digests={BUSYBOX: OLD}))
    assert found.experiment.services["b"].image == f"busybox@{OLD}"


def test_a_tag_that_a_robot_has_for_another_digest_is_noted_as_moved() -> None:
    """By what robots list anyway: tag and digest of one image. One without a digest was built there."""

    def has(*names: str, of: str) -> list[Observed]:
        return [Observed(module="image", name=name, instance="", state={"id": of}) for name in names]

    observed = {
        "r1": has("busybox:latest", f"busybox@{NEW}", f"other@{OLD}", of="1"),
        "r2": [*has("busybox:latest", f"busybox@{NEW}", f"busybox@{OLD}", of="2"), *has("debian:bookworm", of="3")],
        "r3": [*has("busybox:1", f"busybox@{NEW}", of="1"), *has("busybox:latest", f"busybox@{OLD}", of="2")],
    }
    snapshot = Snapshot(facts={}, observed={robot: tuple(items) for robot, items in observed.items()})
    (note,) = moved_tags({BUSYBOX: OLD, DEBIAN: OLD}, snapshot)
    assert note == f"busybox:latest has moved: it is {NEW[:19]}… on r1, the lock has {OLD[:19]}…"


class _Fleet:
    """Two robots with engines, of which images are known by name; each tells the packages of an image by its id."""

    def __init__(self, images: Mapping[str, Mapping[str, str]]) -> None:
        self.images, self.inventory = images, NO_ROBOTS
        self.robots = World().add(*images)
        self.facts = dict.fromkeys(images, SimpleNamespace(docker=True, arch="amd64"))
        self.read: list[str] = []
        for name, robot in self.robots.robots.items():
            robot.ask = functools.partial(self._ask, name)  # type: ignore[method-assign]

    def first(self) -> Any:
        return self

    def ask_each(self, questions: Mapping[str, Sequence[AnyQuery]]) -> dict[str, list[Reply]]:
        return {host: self._ask(host, queries) for host, queries in questions.items()}

    def _ask(self, host: str, queries: Sequence[AnyQuery]) -> list[Reply]:
        names = [getattr(one, "path", "").removeprefix("/images/").removesuffix("/json") for one in queries]
        found = [self.images[host].get(name, "") for name in names]
        bodies = [json.dumps({"Id": one, "Os": "linux", "Architecture": "amd64"}) for one in found]
        return [Reply(status=200, ok=bool(one), out=body) for one, body in zip(found, bodies, strict=True)]

    def packages_in(self, session: Any, image: str) -> dict[str, frozenset[str]]:
        assert session.holder is not None, "its robot is locked"
        self.read.append(f"{session.host} {image}")
        if image == "broken":
            raise NoListing("it has no shell")
        more = {"built"} if image == "built" else set()
        return {"apt": frozenset({"libc6=2", *more}), "pip": frozenset(more), "npm": frozenset()}


def test_what_a_build_added_to_its_base_is_recorded_once(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the image is the one that was built from here; it stays until it is named, or the image is another."""
    (here / "e.edf").write_text("edf: 1\nname: demo\nservices: {c: {cdf: Dockerfile}}\n")
    lock = Lock(digests={BUSYBOX: OLD, DEBIAN: OLD})
    (tag,) = (one.tag for one in plan_images(pinned(load_experiment("e.edf", {}), lock).containers)[0].values())
    base = f"debian@{OLD}"
    known = {built_for(tag, "amd64"): frozenset({"built r2 key", "broken r1 key"})}
    monkeypatch.setattr(package_records, "known_images", lambda: known)

    def recorded(
        images: Mapping[str, Mapping[str, str]], old: Lock = lock, *update: str, inventory: Inventory = NO_ROBOTS
    ) -> Any:
        fleet = _Fleet(images)
        fleet.inventory = inventory
        monkeypatch.setattr(package_records, "packages_in", fleet.packages_in)
        made = locking.draft("e.edf", old, update, (), NO_ROBOTS)
        look: Any = fleet
        return (*package_records.with_records(lock, made, look, fleet.robots.sessions()), fleet)

    new, told, fleet = recorded({"r1": {tag: "foreign", base: "base"}, "r2": {tag: "built", base: "base"}})
    (one,) = new.packages
    assert one == Packages(image=tag, platform="linux/amd64", apt=("built",), pip=("built",))
    assert fleet.read == ["r2 base", "r2 built"] and told == [
        f"{tag} on r2: 2 packages beyond those of its base are in the lock"
    ]
    assert all(robot.holder is None for robot in fleet.robots.robots.values()), "no lock is left"

    again, told, fleet = recorded({"r2": {tag: "built", base: "base"}}, new)
    assert again.packages == new.packages and (told, fleet.read) == ([], [])
    assert len(recorded({"r2": {tag: "built", base: "base"}}, new, tag.partition(":")[0])[2].read) == 2
    stale = Lock(packages=(Packages(image="srprov/other:1", platform="linux/amd64"),))
    assert recorded({"r2": {}}, stale)[0].packages == ()

    both = {tag: "built", base: "base"}
    (line,) = recorded({"r1": both, "r2": both})[1]
    assert line == f"{tag} on r2: 2 packages beyond those of its base are in the lock"
    others = Inventory(hosts={}, groups={BUILDERS: ("r3",)})
    for there, inventory in (({"r1": both, "r3": both}, NO_ROBOTS), ({"r1": {}, "r2": both}, others)):
        (line,) = recorded(there, inventory=inventory)[1]
        assert line.endswith("are in the lock, by the word of a robot from which others do not have it"), line

    for images, why in (
        ({tag: "foreign", base: "base"}, "no robot has an image of it that was built from here"),
        ({tag: "built"}, f"its base {base} is not there any more"),
        ({tag: "broken", base: "base"}, "it has no shell"),
    ):
        none, (line,), _ = recorded({"r1": images})
        assert none.packages == () and "the packages in it are not in the lock" in line and why in line


def test_a_robot_that_is_held_is_not_read(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (here / "e.edf").write_text("edf: 1\nname: demo\nservices: {c: {cdf: Dockerfile}}\n")
    lock = Lock(digests={BUSYBOX: OLD, DEBIAN: OLD})
    (tag,) = (one.tag for one in plan_images(pinned(load_experiment("e.edf", {}), lock).containers)[0].values())
    monkeypatch.setattr(package_records, "known_images", lambda: {built_for(tag, "amd64"): frozenset({"built r1 key"})})
    fleet = _Fleet({"r1": {tag: "built"}})
    monkeypatch.setattr(package_records, "packages_in", fleet.packages_in)
    held = fleet.robots.robots["r1"].open_lock_channel("", ['{"owner": "anna@lab"}'], Pulse())
    look: Any = fleet
    draft = locking.draft("e.edf", lock, (), (), NO_ROBOTS)
    none, (line,) = package_records.with_records(lock, draft, look, fleet.robots.sessions())
    assert none.packages == () and "r1 is held by anna@lab" in line and fleet.read == []
    assert fleet.robots.robots["r1"].holder is held


def test_a_lock_is_never_out_of_date_for_its_records(here: Path) -> None:
    found = load_experiment("e.edf", {})
    assert differences(found, replace(_lock(here), packages=())) == differences(found, _lock(here)) == []


def test_whatever_platforms_a_robot_tells_the_lock_can_be_read_again(tmp_path: Path) -> None:
    """Nor is what the others tell left out: a plan for a robot of another architecture is refused."""

    def told(platforms: list[dict[str, str]]) -> Reply:
        return Reply(status=200, out=json.dumps({"Descriptor": {"digest": OLD}, "Platforms": platforms}))

    lies = [{"os": "linux", "architecture": "x" * 60_000}, *({"os": f"o{n}", "architecture": "a"} for n in range(2000))]
    replies = {"r1": [told(lies)], "r2": [told([{"os": "linux", "architecture": "amd64"}])]}
    digest, platforms = digests.look_up(lambda _asked: replies, ["r1", "r2"], [BUSYBOX], (), print)[BUSYBOX]
    assert "linux/amd64" in platforms
    odd = package_records._platform({"Os": "linux", "Architecture": "\u00b2" * 60_000})
    path = tmp_path / "e.lock"
    path.write_text(dump(Lock(digests={BUSYBOX: digest}, platforms={BUSYBOX: platforms}, version="1")))
    read = load(str(path))
    assert read is not None and read.platforms[BUSYBOX] == platforms and odd == ""


def test_a_file_whose_name_is_no_text_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It ended in a traceback."""
    monkeypatch.chdir(tmp_path)
    Path("maps").mkdir()
    (tmp_path / "maps" / os.fsdecode(b"\xfe")).write_text("a")
    image = f"busybox@sha256:{64 * '1'}"
    Path("e.edf").write_text(f"edf: 1\nname: x\nservices: {{a: {{image: '{image}', volumes: ['./maps:/m:ro']}}}}\n")
    Path("inv.yml").write_text("all: {hosts: {r1: {ansible_host: 127.0.0.1, ansible_port: 1}}}\n")
    assert run(["lock", "e.edf", "-i", "inv.yml"]) == 5
    assert "has a name that is not UTF-8: maps/\\udcfe" in capsys.readouterr().err and not Path("e.lock").exists()
