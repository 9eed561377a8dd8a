"""A lab's policy: what no flag allows, with the file and the line that say so."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from srprov.controller import labpolicy
from srprov.controller.labpolicy import enforce, narrowed, read_policies
from srprov.controller.permissions import permit_run
from srprov.controller.request import BundledImage
from srprov.definitions import load_inventory
from srprov.definitions.labpolicy import LabPolicy, load
from srprov.definitions.model import Host, Inventory
from srprov.errors import DefinitionError, RefusedError
from srprov.modules.image import ImageParams
from srprov.planning.plan import Plan
from srprov.planning.policy import Permission
from srprov.resource import Resource
from tests.fakes import World
from tests.worlds import experiment, plan_for, service

ARMS = Inventory(
    hosts={"r1": Host(name="r1", address="r1", groups=("arms",)), "r2": Host(name="r2", address="r2")}, groups={}
)


def policies(tmp_path: Path, text: str, own: str = "") -> tuple[LabPolicy, ...]:
    for name, content in (("etc", text), ("home", own)):
        (tmp_path / name).mkdir(exist_ok=True)
        if content:
            (tmp_path / name / "policy.yml").write_text("policy: 1\n" + content)
    return read_policies(tmp_path / "home", tmp_path / "etc")


def plan(given: tuple[LabPolicy, ...] = (), **fields: Any) -> Plan:
    return plan_for(World().add("r1"), experiment(service("a", **fields)), policies=given)


def refused(made: Plan, given: tuple[LabPolicy, ...], inventory: Inventory = ARMS) -> str:
    with pytest.raises(RefusedError) as caught:
        permit_run(made, ("all",), inventory, given)
    assert caught.value.exit_code == 9
    return caught.value.message


def test_without_a_file_nothing_is_forbidden(tmp_path: Path) -> None:
    assert read_policies(tmp_path / "home", tmp_path / "etc") == ()


def test_what_the_policy_forbids_no_flag_allows(tmp_path: Path) -> None:
    """The refusal names the policy's file and line."""
    given = policies(tmp_path, "registries: [docker.io]\nallow:\n  all: [host-network]\n")
    made = plan(network="host", cap_add=("SYS_ADMIN",))
    what = "a: SYS_ADMIN (as good as root on the robot)"
    place = f"{tmp_path / 'etc' / 'policy.yml'}:3 does not allow capability on r1 ({what})"
    assert refused(made, given) == place
    permit_run(plan(network="host"), ("all",), ARMS, given)


def test_kinds_are_allowed_per_group_of_the_inventory(tmp_path: Path) -> None:
    given = policies(tmp_path, "allow:\n  all: []\n  arms: [device]\n")
    made = plan(devices=(("/dev/x", "/dev/x", "rw"),))
    permit_run(made, ("all",), ARMS, given)
    elsewhere = replace(made, assignment={"a": "r2"})
    assert "does not allow device on r2" in refused(elsewhere, given)


def test_no_project_puts_a_robot_into_a_group_of_the_policy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its configuration names an inventory of its own; one that the user named has groups that count."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "hosts.ini").write_text("[arms]\nr1\n")
    given = policies(tmp_path, "allow:\n  all: []\n  arms: [device]\n")
    made = plan(devices=(("/dev/x", "/dev/x", "rw"),))
    permit_run(made, ("all",), load_inventory(["hosts.ini"]), given)
    with pytest.raises(RefusedError, match="does not allow device on r1") as caught:
        permit_run(made, ("all",), load_inventory(["hosts.ini"], unnamed=["hosts.ini"]), given)
    assert "-i" in caught.value.hint


def test_a_playbook_is_about_all_robots_also_where_a_service_has_its_name(tmp_path: Path) -> None:
    given = policies(tmp_path, "allow:\n  all: []\n  arms: [playbook]\n")
    asks = Permission(kind="playbook", service="a", what="states anything on the robots, as root")
    made = replace(plan(), permissions=(asks,))
    permit_run(made, ("all",), ARMS, given)
    elsewhere = replace(made.steps[0], host="r2")
    assert "does not allow playbook on r2" in refused(replace(made, steps=(elsewhere,)), given)


def test_a_plan_is_not_even_made(tmp_path: Path) -> None:
    with pytest.raises(RefusedError, match=r"policy\.yml:2 does not allow host-network on r1"):
        plan(policies(tmp_path, "allow: {all: []}\n"), network="host")


def test_the_stricter_of_two_files_wins(tmp_path: Path) -> None:
    given = policies(tmp_path, "allow: {all: [all]}\nlimits: {pids: {max: 100}}\n", "allow: {all: [gpu]}\n")
    fit = plan(network="host", pids_limit=100)
    assert "home/policy.yml:2 does not allow host-network" in refused(fit, given)
    assert "etc/policy.yml:3 does not allow pids without a limit" in refused(plan(), given)


def test_a_flag_for_what_no_robot_may_be_asked_for_is_refused_at_once(tmp_path: Path) -> None:
    """Before a secret is read or a playbook rendered; `all` becomes what the lab allows."""
    given = policies(tmp_path, "allow: {all: [gpu], arms: [device]}\n")
    with pytest.raises(RefusedError, match=r"policy\.yml:2 does not allow secret on any robot"):
        narrowed(("secret", "gpu"), given)
    assert narrowed(("all",), given) == {"gpu", "device"}
    assert narrowed(("all",), ()) == {"all"}


def container(made: Plan) -> Any:
    return next(step.want.params for step in made.steps if step.want and step.module == "container")


LIMITS = "limits:\n  memory: {default: 256m, max: 1g}\n  cpus: {max: 2}\n  pids: {default: 100, max: 200}\n"


def test_each_container_gets_the_limits_that_it_does_not_ask_for(tmp_path: Path) -> None:
    run = container(plan(policies(tmp_path, LIMITS), pids_limit=150)).run
    assert (run.mem_limit, run.cpus, run.pids_limit) == (256 << 20, 2, 150)


def test_the_least_default_counts_and_no_default_is_above_a_maximum(tmp_path: Path) -> None:
    given = policies(tmp_path, "limits: {cpus: {default: 3}, pids: {default: 50}}\n", "limits: {cpus: {max: 2}}\n")
    run = container(plan(given)).run
    assert (run.mem_limit, run.cpus, run.pids_limit) == (0, 2, 50)


@pytest.mark.parametrize(
    ("fields", "what"),
    [
        ({"mem_limit": 2 << 30}, "policy.yml:3 does not allow 2048 MiB of memory for srprov.hello.a on r1"),
        ({"cpus": 2.5}, "policy.yml:4 does not allow 2.5 CPUs"),
        ({"pids_limit": 201}, "policy.yml:5 does not allow 201 processes"),
        ({"shm_size": 2 << 30}, "policy.yml:3 does not allow shm_size"),
    ],
)
def test_more_than_the_maximum_is_refused(tmp_path: Path, fields: dict[str, Any], what: str) -> None:
    given = policies(tmp_path, LIMITS)
    with pytest.raises(RefusedError) as caught:
        plan(given, **fields)
    assert what in caught.value.message


def test_a_container_without_limits_is_refused_whoever_made_the_plan(tmp_path: Path) -> None:
    """A plan from a file, or a user's playbook, had no defaults filled in."""
    assert "memory without a limit" in refused(plan(), policies(tmp_path, LIMITS))


def test_limits_reach_the_engine() -> None:
    from srprov.modules.container_body import engine_body

    host = engine_body(container(plan(mem_limit=1 << 28, cpus=1.5, pids_limit=64)))["HostConfig"]
    assert (host["Memory"], host["MemorySwap"], host["PidsLimit"]) == (1 << 28, 1 << 28, 64)
    assert (host["CpuPeriod"], host["CpuQuota"]) == (100_000, 150_000)


@pytest.mark.parametrize(
    ("registries", "allowed"),
    [("[docker.io]", True), ("[docker.io/library]", True), ("[docker.io/lib]", False), ("[ghcr.io]", False)],
)
def test_images_come_from_the_registries_of_the_lab(tmp_path: Path, registries: str, allowed: bool) -> None:
    given = policies(tmp_path, f"registries: {registries}\n")
    if allowed:
        enforce(plan(), ARMS, given)
    else:
        message = refused(plan(), given)
        assert "policy.yml:2 does not allow the image busybox:latest on r1: its registry is not among" in message


@pytest.mark.parametrize(
    ("registries", "allowed"),
    [("[docker.io/srprov/bundled]", True), ("[docker.io/library]", False), ("[ghcr.io]", False)],
)
def test_images_of_a_bundle_come_from_a_registry_of_their_own(tmp_path: Path, registries: str, allowed: bool) -> None:
    """Whatever the experiment calls them; also one that is on the robot already."""
    image = BundledImage(f"sha256:{'5' * 64}", "")
    given = policies(tmp_path, f"registries: {registries}\n")
    there = World().add("r1")
    there.robots["r1"].engine.images[image.name] = {}
    for world, brought in ((World().add("r1"), {image.name}), (there, set())):
        made = plan_for(world, experiment(service("a")), bundled={"a": (image,)})
        assert {one.name for one in made.steps if one.module == "image"} == brought
        if allowed:
            enforce(made, ARMS, given)
        else:
            message = refused(made, given)
            assert f"does not allow the image {image.name} on r1: its registry is not among" in message


@pytest.mark.parametrize(
    ("text", "wrong"),
    [
        ("FROM ghcr.io/x/y\n", "ghcr.io/x/y"),
        ("FROM debian\nCOPY --from=quay.io/x /a /a\n", "quay.io/x"),
        ("ARG X=debian\nFROM $X\n", "$X"),
        ("FROM debian AS one\nFROM one\n", ""),
    ],
)
def test_a_build_starts_from_the_registries_of_the_lab(tmp_path: Path, text: str, wrong: str) -> None:
    from srprov.images.context import context_tar

    given = policies(tmp_path, "registries: [docker.io]\n")
    made = plan()
    image = next(step for step in made.steps if step.module == "image")
    assert image.want is not None
    build = Resource(
        host="r1", module="image", name="srprov/x:1", written={},
        params=ImageParams(source="build", blob=context_tar(text, ())),
    )  # fmt: skip
    built = replace(made, steps=(replace(image, want=build),))
    if wrong:
        assert f"the image {wrong} on r1" in refused(built, given)
    else:
        enforce(built, ARMS, given)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("allow: {all: [privilegd]}\n", "there is no kind 'privilegd' of permission"),
        ("limits: {memory: {default: 2g, max: 1g}}\n", "the default is more than the maximum"),
        ("limits: {disk: {max: 1}}\n", "unknown key 'disk'"),
        ("limits: {pids: {max: 0}}\n", "0 is less than 1"),
        ("limits: {cpus: {max: 1e-320}}\n", "less than an engine takes"),
        ("limits: {memory: {max: 0.0000001k}}\n", "less than an engine takes"),
        ("permit: {}\n", "unknown key 'permit'"),
    ],
)
def test_a_mistake_in_a_policy_is_an_error_at_its_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(DefinitionError) as caught:
        policies(tmp_path, text)
    assert message in caught.value.problems[0].message
    assert caught.value.problems[0].location.line == 2


def test_a_policy_that_others_can_write_is_refused(tmp_path: Path) -> None:
    policies(tmp_path, "allow: {}\n")
    (tmp_path / "etc" / "policy.yml").chmod(0o666)
    with pytest.raises(DefinitionError) as caught:
        read_policies(tmp_path / "home", tmp_path / "etc")
    assert "others can write" in caught.value.problems[0].message


def test_the_manual_explains_every_kind() -> None:
    manual = (Path(__file__).parents[3] / "docs" / "policy.md").read_text(encoding="utf-8")
    assert [kind for kind in labpolicy.KINDS if f"`{kind}`" not in manual] == []


def test_every_amount_of_the_schema_is_known() -> None:
    from srprov.data import schema

    limits = schema("policy")["properties"]["limits"]["properties"]
    assert set(limits) == set(labpolicy._AMOUNTS)


def test_a_policy_in_whose_place_others_can_put_one_is_none(tmp_path: Path) -> None:
    """They rename the folder, and nothing is forbidden any more."""
    path = tmp_path / "shared" / "srprov" / "policy.yml"
    path.parent.mkdir(parents=True)
    path.write_text("policy: 1\n")
    path.chmod(0o600)
    assert load(str(path), ()) is not None
    path.chmod(0o664)  # as a umask of 002 makes it: the user's own group is nobody else
    assert load(str(path), ()) is not None
    path.parents[1].chmod(0o777)
    with pytest.raises(DefinitionError) as refused:
        load(str(path), ())
    assert "others can write" in refused.value.problems[0].message
