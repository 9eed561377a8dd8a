"""What a plan file may say of an image that srprov builds: what its build context says, and nothing else."""

from __future__ import annotations

import pytest

from srprov.controller.image_claim import is_own_image
from srprov.images.context import context_tar
from srprov.modules.image import ImageParams

TAG = "srprov/x:1"


def context(*lines: str) -> bytes:
    return context_tar("\n".join((*lines, "")), ())


@pytest.mark.parametrize(
    ("lines", "base"),
    [
        (["FROM ros:humble"], "ros:humble"),
        (["FROM docker.io/library/ros:humble"], "ros:humble"),
        (["FROM gcc AS made", "FROM ubuntu:22.04", "COPY --from=made /x /x"], "ubuntu:22.04"),
        (["FROM ubuntu:22.04 AS first", "FROM first"], "ubuntu:22.04"),
    ],
)
def test_what_an_image_was_built_on_is_what_its_context_says(lines: list[str], base: str) -> None:
    """Layers of another one that the robot has were the builder's by its word alone, and left with the image."""
    for said in (base, "", "srprov/victim:2", "gcc:latest"):
        want = ImageParams(source="copy", from_="r1", id="sha256:1", base=said)
        assert is_own_image(want, TAG, context(*lines), ()) is (said in (base, ""))


def test_who_builds_it_is_in_the_plan_or_it_has_an_id() -> None:
    for id_, built, own in (("", (), False), ("", [("r1", TAG)], True), ("", [("r2", TAG)], False), ("a", (), True)):
        want = ImageParams(source="copy", from_="r1", id=id_)
        assert is_own_image(want, TAG, context("FROM x"), built) is own


def test_what_is_built_is_its_context() -> None:
    for blob, own in ((context("FROM x"), True), (context("FROM y"), False)):
        assert is_own_image(ImageParams(source="build", blob=blob), TAG, context("FROM x"), ()) is own
