"""From which robot another gets an image: a tag that a robot lists is its own word."""

from __future__ import annotations

import base64
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from srprov.controller import bundled as bundles
from srprov.controller.image_builders import counted, proofs_of
from srprov.controller.remembering import note_built
from srprov.controller.request import BundledImage
from srprov.controller.robot_images import check_there, robot_images
from srprov.definitions.containermodel import Runtime
from srprov.definitions.model import Experiment, Host, Inventory, Service
from srprov.errors import UsageError
from srprov.facts.model import Docker, HostFacts, Snapshot
from srprov.facts.stored_look import StoredLook
from srprov.image_reference import parse_reference
from srprov.images.plan import ImagePlan
from srprov.record.memory import built_for, known_images, note_images
from srprov.resource import Observed
from srprov.transport import on_record
from srprov.transport.openssh.host_keys import fingerprint

TAG = "srprov/x:0123456789abcdef"
BUILT = built_for(TAG, "amd64")


def sources(
    known: dict[str, set[str]], builders: tuple[str, ...] = (), bundled: dict[str, BundledImage] | None = None,
    away: tuple[str, ...] = (), base: str = "x", known_base: str = "x:latest", **ids: str,
) -> dict[str, tuple[str, str]]:  # fmt: skip
    """Return robot -> (source, from) of the image that `b` runs, where robots list an image of an id under its tag.

    `known` has `ID NAME` of what was built, by whom.
    """
    plan = ImagePlan(tag=TAG, dockerfile="FROM x", context=b"tar", base=base, pinned=True)
    docker = Docker(version="20.10", api_version="1.41")
    facts = {name: HostFacts(name=name, arch="amd64", docker=docker) for name in ("a", "b", "c")}
    facts["arm"] = HostFacts(name="arm", arch="arm64", docker=docker)
    observed = {
        name: (Observed(module="image", name=TAG, instance="", state={"id": ids.get(name, ""), "labels": {}}),)
        * (name in ids)
        for name in facts
    }
    inputs: Any = SimpleNamespace(
        experiment=SimpleNamespace(services={"one": SimpleNamespace(name="one", image="", cdf="x")}),
        placed={"one": "b"},
        images={"x": plan},
        references={},
        snapshot=Snapshot(facts=facts, observed=observed),
        known_images=counted(
            {key: {f"{one} proof" for one in some} for key, some in known.items()},
            {TAG},
            builders,
            Snapshot(facts=facts, observed=observed, unreachable=dict.fromkeys(away, "")),
            lambda name: {f"{name} proof"},
        ),
        copy_way="",
        copied={},
        bundled=bundled or {},
        images_for=(),
        builders=builders,
    )
    found = robot_images(inputs, {})
    assert all(one["runs"] == ["amd64", "386"] for images in found.values() for one in images)
    assert bundled or all(
        one.get("id", "") in ("", ids.get(one.get("from", ""))) for images in found.values() for one in images
    )
    copies = [(host, one) for host, images in found.items() for one in images if one["source"] == "copy"]
    assert all(one["base"] == (known_base if one["from"] != host else "") for host, one in copies)
    return {
        host: (one["source"], f"{one.get('from', '')} {one.get('id', '')}".strip())
        for host, images in found.items()
        for one in images
    }


@pytest.mark.parametrize("name", [TAG, f"docker.io/{TAG}", "index.docker.io/srprov/x", f"srprov/x@sha256:{'1' * 64}"])
@pytest.mark.parametrize("of_a_cdf", [True, False])
def test_no_registry_is_asked_for_what_srprov_builds(name: str, of_a_cdf: bool) -> None:
    """Whoever has that name on Docker Hub gave a robot his own image under the tag of another experiment's build."""
    facts = HostFacts(name="b", arch="amd64", docker=Docker(version="20.10", api_version="1.41"))
    service = SimpleNamespace(name="one", image="" if of_a_cdf else name, cdf="x" if of_a_cdf else "")
    there = parse_reference(name).familiar

    def checked(*present: str, seen: bool = True) -> None:
        images = tuple(Observed(module="image", name=one, instance="", state={"id": "1"}) for one in present)
        snapshot = Snapshot(facts={"b": facts}, observed={"b": images})
        inputs: Any = SimpleNamespace(
            experiment=SimpleNamespace(services={"one": service}), placed={"one": "b"}, images={}, snapshot=snapshot,
            references={"x": name}, bundled={},
        )  # fmt: skip
        check_there(inputs, seen=seen)

    service.runtime = Runtime()
    with pytest.raises(UsageError, match=r"no registry has what srprov builds: one: srprov/x\S* is not on b"):
        checked("srprov/y:1")
    checked(there)
    checked(seen=False)


def test_a_copy_says_what_the_image_was_built_on_as_engines_name_it() -> None:
    for base, name in {"docker.io/library/ros:humble": "ros:humble", "${BASE}": ""}.items():
        assert sources({}, base=base, known_base=name)["b"][0] == "copy"


def test_an_image_that_this_machine_had_built_is_copied_by_its_id() -> None:
    assert sources({BUILT: {"sha256:1 c", "sha256:2 a"}}, c="sha256:1") == {"b": ("copy", "c sha256:1")}


def test_an_image_of_a_bundle_comes_from_this_machine_wherever_its_name_leads() -> None:
    found = sources(
        {BUILT: {"sha256:1 c"}}, b="sha256:1", c="sha256:1", bundled={"one": BundledImage("sha256:5", "amd64")}
    )
    assert found == {"b": ("cache", "sha256:5")}


def test_a_service_has_the_image_of_a_bundle_that_its_robot_runs() -> None:
    """No registry is asked for it, whatever the experiment says; what nobody needs is not built."""
    docker = Docker(version="20.10", api_version="1.41")
    facts = {name: HostFacts(name=name, arch=name, docker=docker) for name in ("amd64", "arm64", "riscv64")}
    arm, amd = BundledImage("sha256:" + "a" * 64, "arm64"), BundledImage("sha256:" + "b" * 64, "amd64")
    services = {
        name: Service(name=name, cdf="x", runtime=Runtime(pull_policy="always")) for name in ("one", "two", "off")
    }
    experiment = Experiment(name="x", file="/x.edf", folder="/", services=services)
    placed = {"one": "amd64", "two": "riscv64", "off": "away"}
    mine, changed = bundles.chosen(dict.fromkeys(services, (arm, amd)), experiment, placed, facts)
    assert mine == {"one": amd} and amd.name == "srprov/bundled:" + "b" * 64
    assert {name: one.runtime.pull_policy for name, one in changed.services.items()} == {
        "one": "missing", "two": "always", "off": "always",
    }  # fmt: skip
    containers: Any = {"x": 1, "y": 2}
    assert bundles.to_build(containers, changed, mine) == {"x": 1} and bundles.unbuilt(containers, changed, mine) == {
        "y"
    }
    assert bundles.to_build(containers, changed, {}) == containers and not bundles.unbuilt(containers, changed, {})
    whole = dict.fromkeys(services, amd)
    assert bundles.to_build(containers, changed, whole) == {}


@pytest.mark.parametrize("known", [{}, {BUILT: {"sha256:1 a"}}])
def test_a_robot_that_lists_the_tag_of_another_image_is_no_source(known: dict[str, set[str]]) -> None:
    """It is built anew, by a robot that does not say that it has it already."""
    assert sources(known, a="sha256:evil") == {"b": ("build", "")}


def test_without_anybody_who_has_it_the_first_robot_builds() -> None:
    assert sources({}) == {"a": ("build", ""), "b": ("copy", "a")}


def test_images_are_built_by_builders_of_the_robots_architecture() -> None:
    assert sources({}, builders=("arm", "c")) == {"c": ("build", ""), "b": ("copy", "c")}
    assert sources({BUILT: {"sha256:1 c"}}, builders=("c",), a="sha256:1") == {"b": ("copy", "a sha256:1")}


def test_where_builders_are_named_no_other_robot_builds_for_others() -> None:
    """The one that is named is away, or of another architecture, which is each robot's own word."""
    assert sources({}, builders=("arm",)) == {"b": ("build", "")}
    assert sources({}, builders=("x",), away=("x",)) == {"b": ("build", "")}
    for away in (), ("x",):
        built_by_a = {BUILT: {"sha256:evil a"}}
        assert sources(built_by_a, builders=("arm", "x"), a="sha256:evil", away=away) == {"b": ("build", "")}
    assert sources({BUILT: {"sha256:1 x"}}, builders=("x",), a="sha256:1", away=("x",)) == {"b": ("copy", "a sha256:1")}


def test_what_was_built_by_a_robot_that_would_not_build_now_is_no_source() -> None:
    """It was alone then, and built for itself; or it is another laboratory's, of which one here has the image."""
    mine = {BUILT: {"sha256:evil a"}}
    assert sources(mine, a="sha256:evil") == {"b": ("copy", "a sha256:evil")}, "it is who builds here"
    assert sources(mine, builders=("c",), a="sha256:evil") == {"c": ("build", ""), "b": ("copy", "c")}
    assert sources(mine, builders=("c",), a="sha256:evil", away=("a",)) == {"c": ("build", ""), "b": ("copy", "c")}
    assert sources({BUILT: {"sha256:evil other"}}, c="sha256:evil") == {"a": ("build", ""), "b": ("copy", "a")}
    assert sources({BUILT: {"sha256:1 other"}}, c="sha256:1", away=("other",)) == {"b": ("copy", "c sha256:1")}
    facts = {"a": HostFacts(name="a", arch="amd64", docker=Docker(version="20.10", api_version="1.41"))}
    known = {BUILT: {"sha256:1 a another-key", "sha256:2", "sha256:3 a key"}}
    found = counted(known, {TAG}, (), Snapshot(facts=facts, observed={}), key)
    assert counted(known, {TAG}, ("c",), Snapshot(facts=facts, observed={}), key) == {BUILT: frozenset()}
    nobody = StoredLook(Inventory(hosts={}, groups={}), Snapshot(facts=facts, observed={}))
    assert counted(known, {TAG}, (), nobody.first(), proofs_of(nobody, nobody.first())) == {BUILT: frozenset()}
    assert found == {BUILT: {"sha256:3"}}, "a name alone is no proof, and what an older srprov noted has none"


def key(name: str) -> set[str]:
    """Tell what a robot proves to be."""
    return {f"{name} key"}


def test_a_builder_that_is_away_goes_by_the_host_keys_that_are_on_record_for_it(tmp_path: Path) -> None:
    """Another inventory may give its name to a robot that built for itself alone."""
    blob, other = (base64.b64encode(text).decode() for text in (b"its own", b"another's"))
    file = tmp_path / "known_hosts"
    file.write_text(f"10.0.0.1 ssh-ed25519 {blob}\n10.0.0.9 ssh-ed25519 {other}\n", encoding="utf-8")
    options = (("userknownhostsfile", str(file)), ("globalknownhostsfile", "none"))
    host = Host(name="x", address="10.0.0.1", ssh_options=options)
    facts = {"c": HostFacts(name="c", arch="amd64", docker=Docker(version="20.10", api_version="1.41"))}
    away = Snapshot(facts=facts, observed={}, unreachable={"x": "", "y": ""})
    look = StoredLook(Inventory(hosts={"x": host}, groups={}), away)
    right, wrong = (f"x {fingerprint(text)}" for text in (b"its own", b"another's"))
    known = {BUILT: {f"sha256:1 {right}", f"sha256:evil {wrong}", "sha256:evil y key", "sha256:evil x"}}
    assert counted(known, {TAG}, ("x", "c"), away, proofs_of(look, away)) == {BUILT: {"sha256:1"}}
    file.write_text(f"{file.read_text()}@revoked * ssh-ed25519 {blob}\n", encoding="utf-8")
    assert counted(known, {TAG}, ("x", "c"), away, proofs_of(look, away)) == {BUILT: frozenset()}
    assert on_record(Host(name="x", address="x", connection="local")) == {"x local"}
    unsettled = Host(name="x", address="10.0.0.1", ssh_options=(*options, ("port", "none")))
    assert on_record(unsettled) == frozenset()


def test_a_robot_that_names_another_one_as_builder_in_an_id_is_no_source() -> None:
    """It said so when it built alone; the one that it names is a builder here, and is away."""
    said = {BUILT: {"sha256:evil x a"}}
    assert sources(said, builders=("x", "c"), a="sha256:evil", away=("x",)) == {"c": ("build", ""), "b": ("copy", "c")}


def test_what_was_built_for_another_architecture_is_no_source() -> None:
    """A robot may say for a while that it is of one that has no builder, and builds for itself then."""
    lied = {built_for(TAG, "arm64"): {"sha256:evil a"}}
    assert sources(lied, a="sha256:evil") == {"b": ("build", "")}
    assert sources(lied, builders=("c",), a="sha256:evil") == {"c": ("build", ""), "b": ("copy", "c")}


def test_what_a_builder_has_counts_whoever_had_it_built() -> None:
    """Somebody else had it built there; no other robot builds it in its place."""
    assert sources({}, builders=("c",), c="sha256:1") == {"b": ("copy", "c sha256:1")}


def test_ids_of_what_a_run_had_built_are_remembered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))

    def result(source: str, after: object) -> Any:
        want = SimpleNamespace(module="image", name=TAG, params=SimpleNamespace(source=source, runs=("amd64", "386")))
        return SimpleNamespace(step=SimpleNamespace(want=want, host="a"), after=after)

    ran: Any = SimpleNamespace(
        results=[result("build", {"id": "sha256:1"}), result("copy", {"id": "sha256:2"}), result("build", None)]
    )
    sessions: Any = {"a": SimpleNamespace(identity="a key")}
    assert note_built(ran, sessions) == "" and known_images() == {BUILT: {"sha256:1 a key"}}
    assert note_images({BUILT: ["sha256:3 b key"]}) == ""
    assert known_images() == {BUILT: {"sha256:1 a key", "sha256:3 b key"}}
    (tmp_path / "srprov" / "images.json").write_text("[", encoding="utf-8")
    assert known_images() == {}
