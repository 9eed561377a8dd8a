"""What the examples become in Kubernetes, held to the API's own schemas, of old and new versions."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
from kubernetes_validate import utils

from tests.unit.exporting.clusters import documents, on_cluster
from tests.unit.exporting.exports import experiment
from tests.unit.exporting.test_kubernetes import FULL

EXAMPLES = sorted((Path(__file__).resolve().parents[3] / "examples").glob("*/*.edf"))
VERSIONS = [f"1.{minor}" for minor in range(25, 38)]


@pytest.fixture(autouse=True, scope="module")
def read_once() -> Iterator[None]:
    """Keep the schemas, megabytes of which are otherwise read anew for each document."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(utils, "schema_contents", functools.cache(utils.schema_contents))
        yield


def manifests(edf: Path) -> list[dict[str, Any]]:
    """Return all documents of an export, `--lossy` for those that ask for encryption."""
    made = on_cluster("kubernetes", edf, None, "all", lossy="encryption: wireguard" in edf.read_text())
    files = [one.path for one in made.files if one.path.endswith(".yaml") and not one.path.startswith("build/")]
    return [one for path in files for one in documents(made, path)]


@pytest.mark.parametrize("edf", EXAMPLES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_every_example_is_what_the_schemas_have(edf: Path) -> None:
    found = manifests(edf)
    assert {one["kind"] for one in found} >= {"Namespace", "NetworkPolicy"}
    for version in (VERSIONS[0], VERSIONS[-1]):
        for one in found:
            kubernetes_validate.validate(one, version, strict=True)


@pytest.mark.parametrize("version", VERSIONS)
def test_every_field_is_what_the_schemas_of_each_version_have(tmp_path: Path, version: str) -> None:
    edf = experiment(tmp_path, FULL, www__a="1", one_dot_txt="2")
    for one in manifests(edf):
        kubernetes_validate.validate(one, version, strict=True)


def test_a_field_that_is_not_in_the_schemas_is_found(tmp_path: Path) -> None:
    """The test of the tests above."""
    pod = next(
        one for one in manifests(experiment(tmp_path, FULL, www__a="1", one_dot_txt="2")) if one["kind"] == "Pod"
    )
    pod["spec"]["containers"][0]["comand"] = ["x"]
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(pod, VERSIONS[0], strict=True)
