"""Containers that a build left, and those that only look like it: whoever publishes an image gives it any label."""

from __future__ import annotations

import pytest

from srprov.modules.container_leftover import BUILD, LISTING, left_by_build

ID = "sha256:" + "ab" * 32


@pytest.mark.parametrize(
    ("name", "image", "state", "is_left"),
    [
        ("flamboyant_bhabha", ID, "exited", True),
        ("flamboyant_bhabha7", ID, "created", True),
        ("0123456789ab", ID, "exited", True),
        ("flamboyant_bhabha", ID, "running", False),
        (f"{LISTING}0123456789ab", ID, "running", True),
        ("mydb", ID, "exited", False),
        ("lab-db-1", ID, "exited", False),
        ("srprov.demo.db", ID, "exited", False),
        ("flamboyant_bhabha", "published/db", "exited", False),
        ("flamboyant_bhabha", "published/db:1", "exited", False),
        (f"{LISTING}../x", ID, "exited", False),
    ],
)
def test_a_container_of_a_published_image_with_the_mark_is_not_left_by_a_build(
    name: str, image: str, state: str, *, is_left: bool
) -> None:
    """Each apply on its robot removed it with its data, and said that a build had left it."""
    item = {"Names": [f"/{name}"], "Image": image, "Labels": {"srprov.instance": BUILD}}
    assert (left_by_build(item, {"state": state}) is not None) is is_left
