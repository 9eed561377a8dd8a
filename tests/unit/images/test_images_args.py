"""Values for ARG, and the stage that is built, written into the Dockerfile: nothing travels beside the context."""

from __future__ import annotations

import pytest
from controller_disk import Disk
from msgspec.structs import replace

from srprov.definitions.containermodel import ContainerDefinition
from srprov.definitions.dockerfile import until_stage
from srprov.errors import DefinitionError
from srprov.images.args import with_args, with_digests
from srprov.images.tag import plan_image
from tests.bounded import bounded

TEXT = """\
ARG DISTRO=humble
FROM ros:${DISTRO} AS build
arg \\
  # why
  WHO=me \\

  DISTRO
RUN echo ARG WHO=x
FROM scratch
COPY --from=build /x /x
ARG OTHER="a b" WHO
"""


def test_each_arg_of_the_name_has_the_value_and_lines_keep_their_numbers() -> None:
    found = with_args(TEXT, {"WHO": 'say "$hi"\\', "DISTRO": "jazzy"})
    assert found.split("\n") == [
        'ARG DISTRO="jazzy"',
        "FROM ros:${DISTRO} AS build",
        'ARG WHO="say \\"\\$hi\\"\\\\" DISTRO="jazzy"',
        *[""] * 4,
        "RUN echo ARG WHO=x",
        "FROM scratch",
        "COPY --from=build /x /x",
        'ARG OTHER="a b" WHO="say \\"\\$hi\\"\\\\"',
        "",
    ]
    assert with_args(TEXT, {}) == TEXT


@pytest.mark.parametrize(("text", "value"), [("ARG A=x\\ y B\n", "1"), ('ARG B="\n', "1"), ("ARG B\n", "1\nRUN evil")])
def test_what_cannot_be_written_for_sure_is_refused(text: str, value: str) -> None:
    with pytest.raises(ValueError, match=r"write one ARG for each name|line break"):
        with_args(f"FROM x\n{text}", {"B": value})


@pytest.mark.parametrize(("target", "lines"), [("", 11), ("build", 8), ("BUILD", 8), ("0", 8), ("1", 11)])
def test_a_target_ends_the_dockerfile(target: str, lines: int) -> None:
    assert until_stage(TEXT, target) == "\n".join([*TEXT.split("\n")[:lines], ""])


def test_both_are_in_the_tag_and_a_later_stage_is_not() -> None:
    def tag(text: str, **more: object) -> str:
        made = ContainerDefinition(
            name="t", file="/t.cdf", folder="/", dockerfile="/d/Dockerfile", dockerfile_text=text
        )
        cdf = replace(made, **more)  # type: ignore[arg-type]
        disk = Disk({"/d/Dockerfile": text.encode(), "/src/a": b"1"})
        return plan_image(cdf, disk.listing, disk.read).tag

    given = [{}, {"build_args": {"WHO": "a"}}, {"build_args": {"WHO": "b"}}, {"target": "build"}, {"context": "/src"}]
    tags = [tag(TEXT, **more) for more in given]
    assert len(set(tags)) == 5
    assert tag(f"{TEXT}RUN x\n", target="build") == tags[3]


def test_the_marks_stand_at_the_end_of_the_stage_that_is_built() -> None:
    disk = Disk({"/d/Dockerfile": TEXT.encode()})
    cdf = ContainerDefinition(
        name="t", file="/t.cdf", folder="/", dockerfile="/d/Dockerfile", dockerfile_text=TEXT, target="build"
    )
    text = plan_image(cdf, disk.listing, disk.read).dockerfile
    assert text.count("FROM") == 1
    assert text.endswith('LABEL srprov.cdf="t"\nLABEL srprov.instance=""\n')
    with pytest.raises(DefinitionError) as refused:
        plan_image(replace(cdf, target="x"), disk.listing, disk.read)
    assert refused.value.problems[0].path == "dockerfile"


@pytest.mark.parametrize(
    ("text", "pinned"),
    [
        ("FROM \\\n# debian is small\n  debian\nUSER a\n", "FROM debian@1\n\n\nUSER a\n"),
        ("FROM debian\\\n AS a\nUSER a\n", "FROM debian@1 AS a\n\nUSER a\n"),
        ("FROM deb\\\nian\nUSER a\n", "FROM debian@1\n\nUSER a\n"),
        ("FROM a\nCOPY \\\n # --from=debian\n --from=debian b c\n", "FROM a\nCOPY --from=debian@1 b c\n\n\n"),
        ("FROM a\nONBUILD COPY --from=debian b c\n", "FROM a\nONBUILD COPY --from=debian@1 b c\n"),
        (
            "FROM a\nRUN --mount=type=cache,target=/c --mount=from=debian,target=/d ls --from=debian\n",
            "FROM a\nRUN --mount=type=cache,target=/c --mount=from=debian@1,target=/d ls --from=debian\n",
        ),
        ("FROM a AS debian\nCOPY --from=debian b c\n", "FROM a AS debian\nCOPY --from=debian@1 b c\n"),
        ("FROM a AS debian\nFROM a\nCOPY --from=debian b c\n", "FROM a AS debian\nFROM a\nCOPY --from=debian b c\n"),
        ("FROM debian-slim\nRUN echo \\\n  debian\n", "FROM debian-slim\nRUN echo \\\n  debian\n"),
    ],
)
def test_a_name_that_a_lock_has_is_a_digest_wherever_it_stands(text: str, pinned: str) -> None:
    """A comment within an instruction took the digest, and the name that counts stayed a tag."""
    assert with_digests(text, {"debian": "debian@1"}) == pinned


def test_digests_are_looked_up_by_name() -> None:
    """All names of a lock were gone through again for each instruction."""
    pins = {f"g{number}": f"g{number}@sha256:x" for number in range(1000)}
    text = "".join(f"FROM {name}\n" for name in pins) + "A\n" * 50_000
    assert "FROM g999@sha256:x\n" in bounded(lambda: with_digests(text, pins))
