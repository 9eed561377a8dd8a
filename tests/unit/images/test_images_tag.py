"""The content tag: equal content, equal tag; anything that goes in, another one."""

import io
import tarfile

import pytest
from controller_disk import Disk
from msgspec.structs import replace

from srprov.definitions.containermodel import BuildFile, ContainerDefinition, Requirements, Runtime
from srprov.errors import DefinitionError, Location
from srprov.images.plan import ImagePlan
from srprov.images.tag import locate_failure, plan_image

FILES = {"/lab/talker.py": b"print(1)", "/lab/conf/a.yml": b"a: 1"}
CDF = ContainerDefinition(
    name="talker",
    file="/lab/talker.cdf",
    folder="/lab",
    base="debian:bookworm",
    apt=("curl",),
    files=(
        BuildFile(source="/lab/talker.py", dest="/opt/talker.py", mode="0755"),
        BuildFile(source="/lab/conf", dest="/etc/talker"),
    ),
    run=("true", "false"),
    lines={"base": 2, "run.0": 7, "run.1": 8, "files.1": 5},
)
DOCKERFILE = b"ARG TAG=12\nFROM debian:${TAG} AS build\nRUN make\nFROM scratch\nCOPY --from=build /x /x\n"


@pytest.fixture
def lab() -> Disk:
    return Disk(FILES)


def plan(cdf: ContainerDefinition, lab: Disk) -> ImagePlan:
    return plan_image(cdf, lab.listing, lab.read)


def test_the_plan_is_complete(lab: Disk) -> None:
    found = plan(replace(CDF, platforms=("linux/arm64",)), lab)
    assert found.tag == "srprov/talker:ba52aa2d34507f84d392433d7909ce23"
    assert (found.base, found.pinned, found.platforms) == ("docker.io/library/debian:bookworm", False, ("linux/arm64",))
    with tarfile.open(fileobj=io.BytesIO(found.context)) as tar:
        assert tar.getnames() == ["Dockerfile", "files", "files/0", "files/1", "files/1/a.yml"]
        assert tar.getmember("files/0").mode == 0o755
        dockerfile = tar.extractfile("Dockerfile")
        assert dockerfile is not None
        assert dockerfile.read().decode() == found.dockerfile


def test_equal_definitions_in_other_folders_have_one_tag(lab: Disk) -> None:
    moved = replace(
        CDF,
        file="/home/x/t.cdf",
        folder="/home/x",
        lines={},
        location=Location("t.cdf", 9),
        base="docker.io/library/debian:bookworm",
        description="another word",
        requires=Requirements(tags=("lidar",)),
        files=tuple(replace(f, source=f.source.replace("/lab", "/home/x"), mode=f.mode.lstrip("0")) for f in CDF.files),
    )
    there = Disk({name.replace("/lab", "/home/x"): content for name, content in FILES.items()})
    one, two = plan(CDF, lab), plan(moved, there)
    assert one.tag == two.tag
    assert one.context == two.context


@pytest.mark.parametrize(
    "change",
    [
        {"base": "debian:trixie"},
        {"base": "debian:bookworm@sha256:" + "0" * 64},
        {"apt": ("curl", "jq")},
        {"pip": ("numpy",)},
        {"run": ("true",)},
        {"build_environment": {"A": "1"}},
        {"runtime": Runtime(command=("x",))},
        {"files": CDF.files[:1]},
        {"files": (replace(CDF.files[0], mode="0644"), CDF.files[1])},
        {"name": "listener"},
    ],
    ids=str,
)
def test_whatever_goes_in_changes_the_tag(lab: Disk, change: dict[str, object]) -> None:
    assert plan(replace(CDF, **change), lab).tag != plan(CDF, lab).tag


def test_a_files_content_and_executable_bit_change_the_tag(lab: Disk) -> None:
    tags = {
        plan(CDF, lab).tag,
        plan(CDF, Disk({**FILES, "/lab/conf/a.yml": b"a: 2"})).tag,
        plan(CDF, Disk(FILES, x=("/lab/conf/a.yml",))).tag,
        plan(CDF, Disk({**FILES, "/lab/conf/b.yml": b""})).tag,
    }
    assert len(tags) == 4


@pytest.mark.parametrize(
    ("name", "repository"),
    [("talker", "talker"), ("My Talker_2", "my-talker-2"), ("--", "cdf"), ("grüße", "gr-e"), ("a" * 200, "a" * 100)],
)
def test_names_become_repositories(lab: Disk, name: str, repository: str) -> None:
    assert plan(replace(CDF, name=name), lab).tag.split(":")[0] == f"srprov/{repository}"


def test_files_that_are_not_there_are_problems_at_their_lines() -> None:
    with pytest.raises(DefinitionError) as caught:
        plan(CDF, Disk({"/other": b""}))
    assert [(p.location.line, p.path, p.message) for p in caught.value.problems] == [
        (1, "files.0", "No such file or directory"),
        (5, "files.1", "No such file or directory"),
    ]


def test_a_ready_image_has_nothing_to_build(lab: Disk) -> None:
    with pytest.raises(ValueError, match="ready image"):
        plan(replace(CDF, base="", image="debian"), lab)


def from_dockerfile(text: bytes, **change: object) -> ImagePlan:
    cdf = ContainerDefinition(
        name="lidar",
        file="/lab/lidar.cdf",
        folder="/lab",
        dockerfile="/lab/lidar/Dockerfile",
        dockerfile_text=text.decode(),
        **change,
    )
    return plan(cdf, Disk({"/lab/lidar/Dockerfile": text, "/lab/lidar/src/x.c": b"x"}))


def test_a_dockerfile_is_built_as_it_is_and_marked_as_ours() -> None:
    found = from_dockerfile(DOCKERFILE)
    arg, first, *rest = DOCKERFILE.decode().splitlines()
    mark = "LABEL srprov.instance=.build"
    make, second, copy = rest
    named = ['LABEL srprov.cdf="lidar"', 'LABEL srprov.instance=""']
    assert found.dockerfile.splitlines() == [arg, first, mark, make, second, mark, copy, *named]
    with tarfile.open(fileobj=io.BytesIO(found.context)) as tar:
        assert tar.getnames() == ["Dockerfile", "src", "src/x.c"]
    assert found.lines[4] == Location("/lab/lidar/Dockerfile", 3)
    assert 3 not in found.lines
    assert from_dockerfile(DOCKERFILE.replace(b"\n", b"\r\n")).tag == found.tag


@pytest.mark.parametrize(
    ("text", "base", "pinned"),
    [
        (b"FROM debian:12\n", "docker.io/library/debian:12", False),
        (b"from --platform=linux/arm64 ghcr.io/a/b@sha256:" + b"0" * 64, "ghcr.io/a/b@sha256:" + "0" * 64, True),
        (b"FROM a AS x\nFROM b\nFROM x\n", "docker.io/library/a:latest", False),
        (b"FROM scratch\n", "scratch", True),
        (DOCKERFILE, "scratch", False),
        (b"FROM ${BASE}\n", "${BASE}", False),
        (b"", "", False),
    ],
)
def test_what_a_dockerfile_starts_from(text: bytes, base: str, pinned: bool) -> None:
    found = from_dockerfile(text)
    assert (found.base, found.pinned) == (base, pinned)


def test_what_a_dockerfile_cannot_take_is_refused() -> None:
    with pytest.raises(DefinitionError) as caught:
        from_dockerfile(b"FROM a\n", apt=("curl",), run=("true",))
    assert [problem.path for problem in caught.value.problems] == ["packages.apt", "run"]


@pytest.mark.parametrize(
    ("output", "line"),
    [
        ('Step 1/7 : FROM debian:bookworm\nStep 7/9 : RUN ["/bin/sh"]\nThe command returned a non-zero code: 1', 8),
        ("Step 1/7 : FROM debian:bookworm\npull access denied", 2),
        ("dockerfile parse error line 1: unknown instruction", 2),
        ("dockerfile parse error on line 9: unknown", 8),
        ("Dockerfile:8\n--------------------", 7),
        ("no space left on device", None),
        ("Step 99/7 : x", None),
    ],
)
def test_a_failed_build_points_to_the_definition(lab: Disk, output: str, line: int | None) -> None:
    found = locate_failure(plan(CDF, lab), output)
    assert (found.line if found else None) == line


def test_definitions_whose_hashes_begin_alike_have_tags_of_their_own() -> None:
    """Two processors find such a pair within half an hour: of 16 digits, the image of one ran as that of the other."""
    one = b'echo "I am the reviewed program"; sleep 3600\n'
    other = b'echo "EVIL ran, as $(id -u), sees $(ls /host 2>/dev/null | tr "\\n" " ")"; sleep 3600\n'
    tool = ContainerDefinition(
        name="tool", file="/t/t.cdf", folder="/t", base="busybox", files=(BuildFile(source="/t/app", dest="/app"),),
        runtime=Runtime(command=("sh", "/app/run.sh")),
    )  # fmt: skip
    tags = []
    for script, name in ((one, "z9bc259c33c95bdc6"), (other, "z8225d206f71aa11b")):
        files = {"/t/app/run.sh": script, f"/t/app/p{'a' * 15}": b"", f"/t/app/{name}": b""}
        tags.append(plan(tool, Disk(files)).tag.partition(":")[2])
    assert [tag[:16] for tag in tags] == ["03282b4efda83693"] * 2
    assert tags[0] != tags[1]
