"""Containers that a build left, and those that only look like it: whoever publishes an image gives it any label."""

from __future__ import annotations

import json

import pytest

from srprov.modules import MODULES
from srprov.modules.container_leftover import BUILD, BUILD_HOST, LISTING, left_by_build
from srprov.modules.image import ImageParams
from srprov.wire import EngineCall, Reply

ID = "sha256:" + "ab" * 32
KEY = "cd" * 32


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
    item = {"Id": KEY, "Names": [f"/{name}"], "Image": image, "Labels": {"srprov.instance": BUILD}}
    assert (left_by_build(item, {"state": state}, {KEY}) is not None) is is_left


def test_a_container_of_what_somebody_built_on_such_an_image_is_not_left_by_a_build() -> None:
    """The engine's list has its image by the id, too, as soon as the name is another image's; it was removed."""
    item = {"Id": KEY, "Names": ["/brave_cartwright"], "Image": ID, "State": "exited"}
    container = MODULES["container"]
    listed = Reply(status=200, out=json.dumps([{**item, "Labels": {"srprov.instance": BUILD}}]))
    kept = f"/var/lib/docker/containers/{KEY}/hostconfig.json:"
    others = [f'{kept}"Memory":0', f'{kept}"ExtraHosts":["fleet:127.0.0.1"']
    assert container.parse((listed, Reply(status=0, out="\n".join(others)))) == ()
    of_a_build = Reply(status=0, out="\n".join([*others, f'{kept}"ExtraHosts":["{BUILD_HOST}"']))
    (left,) = container.parse((listed, of_a_build))
    assert left.name == "brave_cartwright" and left.state["leftover"]


def test_a_build_is_asked_for_with_the_host_by_which_its_containers_are_known() -> None:
    change = MODULES["image"].check("srprov/a:1", ImageParams(source="build", blob=b"x"), None)
    assert change is not None and isinstance(command := change.commands[0], EngineCall)
    assert dict(command.params)["extrahosts"] == BUILD_HOST
