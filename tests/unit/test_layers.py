"""Which layers a robot lacks, by chain ids."""

from __future__ import annotations

import hashlib
import json

import pytest

from srprov.layers import (
    Image,
    architecture_of,
    chain_ids,
    foreign,
    has_classic_store,
    history_sizes,
    manifest,
    missing_layers,
    read_config,
    read_image,
)


def digest(name: str) -> str:
    return f"sha256:{hashlib.sha256(name.encode()).hexdigest()}"


def image(*layers: str) -> Image:
    return Image(digest(f"config of {layers}"), tuple(map(digest, layers)))


def test_a_chain_id_is_made_as_the_image_specification_says() -> None:
    a, b, c = map(digest, "abc")
    two = f"sha256:{hashlib.sha256(f'{a} {b}'.encode()).hexdigest()}"
    assert chain_ids([a, b, c]) == [a, two, f"sha256:{hashlib.sha256(f'{two} {c}'.encode()).hexdigest()}"]
    assert chain_ids([]) == []


def test_what_lies_on_a_known_chain_is_missing_and_nothing_below_it() -> None:
    wanted = image("base", "apt", "code")
    assert missing_layers(wanted, [image("base"), image("base", "apt", "old")]) == (digest("code"),)
    assert missing_layers(wanted, [wanted]) == ()
    assert missing_layers(wanted, []) == wanted.diff_ids


def test_the_same_layer_on_another_base_is_missing() -> None:
    assert missing_layers(image("base", "code"), [image("base"), image("other", "code")]) == (digest("code"),)


def test_an_archive_lists_the_image_with_all_layers_under_the_one_tag() -> None:
    (entry,) = json.loads(manifest(image("base", "code"), "srprov/x:1"))
    assert entry["RepoTags"] == ["srprov/x:1"] and len(entry["Layers"]) == 2
    assert entry["Layers"][0] == digest("base").removeprefix("sha256:") + ".tar.gz"


@pytest.mark.parametrize(
    "said",
    [
        None,
        [],
        {},
        {"Id": "x", "RootFS": {"Layers": [digest("a")]}},
        {"Id": digest("i"), "RootFS": {"Layers": []}},
        {"Id": digest("i"), "RootFS": {"Layers": ["../x"]}},
        {"Id": digest("i"), "RootFS": {"Layers": [1]}},
        {"Id": digest("i"), "RootFS": {"Layers": [digest("a")] * 600}},
        {"Id": digest("i"), "RootFS": []},
    ],
)
def test_what_is_no_image_is_none(said: object) -> None:
    assert read_image(said) is None


def test_an_image_is_read_from_what_the_engine_says_and_from_its_configuration() -> None:
    layers = [digest("a"), digest("b")]
    want = Image(digest("i"), tuple(layers))
    assert read_image({"Id": digest("i"), "RootFS": {"Type": "layers", "Layers": layers}}) == want
    assert read_config(digest("i"), {"rootfs": {"type": "layers", "diff_ids": layers}}) == want
    said = {"Id": digest("i"), "Architecture": "arm64", "RootFS": {"Type": "layers", "Layers": layers}}
    config = {"architecture": "arm64", "rootfs": {"type": "layers", "diff_ids": layers}}
    assert read_image(said) == read_config(digest("i"), config) == Image(digest("i"), tuple(layers), "arm64")


def test_the_store_is_told_by_the_driver() -> None:
    assert has_classic_store({"Driver": "overlay2", "DriverStatus": [["Backing Filesystem", "extfs"]]})
    assert has_classic_store({"Driver": "vfs", "DriverStatus": None})
    contained = {"Driver": "overlayfs", "DriverStatus": [["driver-type", "io.containerd.snapshotter.v1"]]}
    assert not has_classic_store(contained) and not has_classic_store({}) and not has_classic_store(None)


def test_sizes_of_layers_are_known_only_where_each_has_one() -> None:
    history = [{"Size": 5}, {"Size": 0}, {"Size": 70}]
    assert history_sizes(history, 2) == [70, 5]
    assert history_sizes(history, 3) is None and history_sizes(None, 1) is None


@pytest.mark.parametrize(
    ("architecture", "runs", "why"),
    [
        ("arm64", ("arm64", "arm"), ""),
        ("arm", ("arm64", "arm"), ""),
        ("", ("arm64",), ""),
        ("amd64", (), ""),
        ("amd64", ("arm64", "arm"), "it is an image for amd64, and the robot runs arm64 and arm"),
    ],
)
def test_a_robot_runs_images_of_its_architectures(architecture: str, runs: tuple[str, ...], why: str) -> None:
    assert foreign(architecture, runs) == why


@pytest.mark.parametrize("said", [None, 5, ["arm64"], "arm 64", "\x1b[31m", "x" * 21])
def test_an_architecture_that_is_none_is_not_known(said: object) -> None:
    assert architecture_of(said) == ""


@pytest.mark.parametrize(
    ("top", "inside"),
    [({"RootFS": {"diff_ids": [digest("other")]}}, {}), ({"root\u017fs": 1, "rootf\u017f": {}}, {}),
     ({}, {"Diff_IDs": [digest("other")]}), ({"Architecture": "arm64"}, {})],
)  # fmt: skip
def test_a_configuration_that_engines_read_in_another_way_is_none(
    top: dict[str, object], inside: dict[str, object]
) -> None:
    """They take a name in any case: the last one would name other layers than those that are compared."""
    config = {"rootfs": {"type": "layers", "diff_ids": [digest("a")], **inside}, **top}
    assert read_config(digest("i"), config) is None
