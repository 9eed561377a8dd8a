"""A build begins only when its bases bring no ONBUILD instructions, or the user allowed what those may do."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, cast

import pytest

from srprov.execution.triggers import kept_apart, refuse_triggers
from srprov.images.context import context_tar
from srprov.images.plan import ContextFile
from srprov.session import Progress, Session, no_progress
from srprov.wire import AnyQuery, EngineCall, Reply


class Robot:
    """An engine with images, and a registry to pull more from."""

    architecture, variant = "amd64", ""
    store: Mapping[str, Any] = MappingProxyType({})
    """What an engine tells of an image beside that, by the kind of its store."""

    def __init__(self, here: dict[str, Any], registry: dict[str, Any]) -> None:
        self.here, self.registry, self.pulled = here, registry, list[str]()

    def ask(self, queries: Sequence[AnyQuery]) -> Sequence[Reply]:
        return [self._told(getattr(one, "path", "").removeprefix("/images/").removesuffix("/json")) for one in queries]

    def _told(self, name: str) -> Reply:
        if name not in self.here:
            return Reply(status=404, ok=False, err="No such image")
        about = {"Os": "linux", "Architecture": self.architecture, "Variant": self.variant}
        about |= {"Id": "x", "Config": {"OnBuild": self.here[name]}, **self.store}
        return Reply(status=200, out=json.dumps(about))

    def execute(self, command: EngineCall, progress: Progress) -> Reply:
        params = dict(command.params)
        name, tag = params["fromImage"], params["tag"]
        self.pulled.append(f"{name} {tag}")
        found = {one: has for one, has in self.registry.items() if one.split(":")[0].split("@")[0] == name}
        self.here |= found
        return Reply(status=200, ok=bool(found), err="" if found else "no such image in the registry")


def refusal(robot: Robot, dockerfile: str) -> Reply | None:
    """Return what comes of looking at the bases of a build."""
    return refusal_of(robot, context_tar(dockerfile, [ContextFile(path="src/main.c", content=b"FROM other\n")]))


def refusal_of(robot: Robot, context: bytes) -> Reply | None:
    """Return what comes of looking at the bases of a build with these bytes as its context."""
    build = EngineCall(method="POST", path="/build", blob=context, stream=True)
    return refuse_triggers(build, cast(Session, robot), no_progress)


@pytest.mark.parametrize(
    "dockerfile",
    [
        "FROM evil/base:1\n",
        "FROM good AS one\nFROM scratch\nFR\\\nOM evil/base:1\nRUN x\n",
        "FROM good\nRUN <<END\nFROM evil/base:1\nEND\n",
        "FROM good\nFROM evil/base:1 \\",
    ],
)
@pytest.mark.parametrize("there", [True, False])
def test_a_build_on_a_base_with_triggers_is_refused(dockerfile: str, there: bool) -> None:
    """Whether the base is on the robot, or the build would pull it."""
    evil = {"evil/base:1": ["COPY --from=srprov/victim:1 /secret /stolen"]}
    refused = refusal(Robot({"good": None} | (evil if there else {}), evil), dockerfile)
    assert refused is not None and not refused.ok
    assert "evil/base:1 has ONBUILD instructions" in refused.err and "--allow built-image" in refused.err


def test_a_build_on_ordinary_bases_begins() -> None:
    robot = Robot({"good": None, "good:2": []}, {"other@sha256:1": None})
    text = "FROM good AS a\nFROM a AS b\nFROM good:2\nFROM scratch\nFROM other@sha256:1\nFROM $X\n"
    assert refusal(robot, text) is None
    assert robot.pulled == ["other sha256:1"]


@pytest.mark.parametrize("text", ["FROM srprov/x:1\n", "FROM good\nCOPY --from=docker.io/srprov/x:1 /a /a\n"])
def test_no_registry_is_asked_for_what_srprov_builds(text: str) -> None:
    """It would be on the robot under the tag of another experiment's build."""
    robot = Robot({"good": None}, {"srprov/x": None, "srprov/x:1": None, "docker.io/srprov/x": None})
    refused = refusal(robot, text)
    assert refused is not None and "no registry has what srprov builds" in refused.err and not robot.pulled
    assert refusal(Robot({"good": None, "srprov/x:1": None, "docker.io/srprov/x:1": None}, {}), text) is None


def test_a_base_that_cannot_be_looked_at_is_not_built_on() -> None:
    robot = Robot({}, {})
    refused = refusal(robot, "FROM lab:5000/gone\n")
    assert refused is not None and not refused.ok and robot.pulled == ["lab:5000/gone latest"]


@pytest.mark.parametrize(
    ("platform", "has", "begins"),
    [
        ("linux/amd64", ("amd64", ""), True),
        ("x86_64", ("amd64", ""), True),
        ("linux/arm64", ("arm64", "v8"), True),
        ("linux/arm64/v8", ("arm64", ""), True),
        ("linux/arm/v7", ("arm", "v7"), True),
        ("linux/arm64", ("amd64", ""), False),
        ("linux/386", ("amd64", ""), False),
        ("linux/amd64/v2", ("amd64", ""), False),
        ("linux/amd64", ("amd64", "v2"), False),
        ("linux/arm/v6", ("arm", "v7"), False),
        ("linux", ("amd64", ""), False),
        ("$P", ("amd64", ""), False),
        ("linux/amd64", ("", ""), False),
    ],
)
def test_a_base_is_built_on_for_the_platform_alone_that_was_looked_at(
    platform: str, has: tuple[str, str], begins: bool
) -> None:
    """An engine with containerd's store takes the image of the platform that FROM names, and pulls it for that."""
    robot = Robot({"good": None, "other": None}, {})
    robot.architecture, robot.variant = has
    refused = refusal(robot, f"FROM --platform={platform} good AS a\nFROM --platform=$NONE a\nFROM other\n")
    assert (refused is None) is begins
    assert refused is None or f"FROM --platform={platform}: good could be looked at for" in refused.err
    refused = refusal(robot, f"FROM good\nFROM \\\n --platform={platform} good\n")
    assert (refused is None) is begins


def entry(
    platform: str = "linux/amd64", *, there: bool = True, kind: str = "image", id_: str = "sha256:1"
) -> dict[str, Any]:
    """Return an entry of a list of images, as an engine with containerd's store tells it."""
    names = zip(("os", "architecture", "variant"), platform.split("/"), strict=False)
    return {"ID": id_, "Available": there, "Kind": kind, "Descriptor": {"platform": dict(names)}}


ATTESTED = entry("unknown/unknown", there=False, kind="attestation")


@pytest.mark.parametrize(
    ("entries", "begins"),
    [
        ([{"ID": "x", "Available": True, "Kind": "image", "Descriptor": {}}], True),
        ([entry(), ATTESTED], True),
        ([entry(), entry("linux/386", there=False), entry("windows/amd64", there=False), ATTESTED], True),
        # what is called an attestation is what a build gets, and nothing of it is told
        ([entry(kind="attestation"), entry("linux/arm64", there=False)], False),
        ([entry(kind="attestation"), entry("linux/arm64")], False),
        ([entry(), entry(there=True)], False),
        ([entry(), entry(there=False)], False),
        ([entry(), entry("linux/amd64/v2", there=False)], False),
        ([entry("Linux/x86_64"), entry(there=False)], False),
        ([entry(), entry("", there=False)], False),
        ([entry("")], False),
        ([entry("linux/arm64"), entry(there=False)], False),
    ],
)
def test_a_base_that_may_mean_several_images_is_not_built_on(entries: list[dict[str, Any]], begins: bool) -> None:
    """What an engine tells of a list of images need not be what it builds on: also of one that files are copied of."""
    for dockerfile in ("FROM one\n", "FROM two\nCOPY --from=one /x /x\n"):
        robot = Robot({"one": None, "two": None}, {})
        robot.store = {"Manifests": entries}
        refused = refusal(robot, dockerfile)
        assert (refused is None) is begins
        assert refused is None or "may mean several images" in refused.err


def test_a_list_of_variants_of_arm_is_built_on() -> None:
    robot = Robot({"one": None}, {})
    robot.architecture, robot.variant = "arm", "v6"
    robot.store = {
        "Manifests": [entry("linux/arm/v5", there=False), entry("linux/arm/v6"), entry("linux/arm/v7", there=False)]
    }
    assert refusal(robot, "FROM one\n") is None


@pytest.mark.parametrize(("digest", "begins"), [("one@sha256:1", True), ("one@x", False)])
def test_an_engine_that_tells_no_list_is_believed_with_a_classic_store_alone(digest: str, begins: bool) -> None:
    """There an image's id is its configuration's hash; in containerd's it is the digest that a registry knows."""
    robot = Robot({"one": None}, {})
    robot.store = {"RepoDigests": [digest]}
    assert (refusal(robot, "FROM one\n") is None) is begins


def test_all_that_a_build_takes_is_pulled_before_anything_is_looked_at() -> None:
    """What comes during a build may be what a name means from then on."""
    text = (
        "FROM good AS a\nCOPY --from=other /x /x\nFROM good\nCOPY --from=a /x /\nCOPY --from=0 /x /\nRUN x --from=no\n"
    )
    robot = Robot({"good": None}, {"other": ["RUN x"]})
    assert refusal(robot, text) is None and robot.pulled == ["other latest"]
    refused = refusal(Robot({"good": None}, {}), text)
    assert refused is not None and "no such image in the registry" in refused.err


WHOLE = context_tar("FROM good\n", [])


@pytest.mark.parametrize(
    "context",
    [
        b"",
        b"FROM good\n",
        WHOLE[:-512],
        WHOLE + WHOLE,
        WHOLE.replace(b"Dockerfile", b"dockerfile"),
        WHOLE.replace(b"ustar", b"other"),
        context_tar("#" * (8 << 20) + "\nFROM good\n", []),
        # a builder unpacks what lies below a link where the link points to: here, in place of the Dockerfile
        context_tar("FROM good\n", [ContextFile(path="l", link="."), ContextFile(path="l/Dockerfile", content=b"")]),
    ],
    ids=["empty", "no tar", "cut", "two tars", "no Dockerfile", "another header", "too large", "below a link"],
)
def test_a_context_that_srprov_does_not_write_is_not_built(context: bytes) -> None:
    """Said as a failure of the build, before anything is asked of the robot."""
    robot = Robot({}, {})
    refused = refusal_of(robot, context)
    assert refused is not None and not refused.ok and not robot.pulled
    assert refused.err.startswith("the build's context is not such as srprov writes: ")


@pytest.mark.parametrize(
    ("dockerfile", "apart"),
    [
        ("FROM scratch\nCOPY rootfs /\n", True),
        ("FROM golang AS b\nRUN x\nFROM scratch\nCOPY --from=b /x /x\n", True),
        ("ARG B=scratch\nFROM $B\nCOPY rootfs /\n", True),
        ("FROM $A${B}h\n", True),
        ("FROM ${A:-${B}}\n", True),
        ('FROM "scratch"\n', True),
        ("FROM scrat\\\\ch\n", True),
        ("FROM ${SCR:-ATCH}\n", True),
        ("ARG ROS_DISTRO=noetic\nFROM ros:${ROS_DISTRO}\n", False),
        ("FROM ros:${ROS_DISTRO:-noetic}-base\n", False),
        ("FROM $REGISTRY/ros\n", False),
        ("FROM debian\nCOPY scratch /\n", False),
        ("FROM debian AS a\nFROM a\nRUN x\n", False),
    ],
)
def test_what_begins_with_nothing_is_built_on_no_image_that_says_it_began_so(dockerfile: str, apart: bool) -> None:
    """An engine before 25 takes any image without a parent, as one that was pulled, for that build's first step."""
    build = EngineCall(method="POST", path="/build", params=(("t", "x"),), blob=context_tar(dockerfile, []))
    assert (("nocache", "true") in kept_apart(build).params) is apart
    other = EngineCall(method="POST", path="/containers/create", body="{}")
    assert kept_apart(other) is other
