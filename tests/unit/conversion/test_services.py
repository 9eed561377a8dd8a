"""One service of Compose: what an EDF has of it, and what is said of each key. Tables of cases, values in and out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.unit.conversion.making import agree, draft, project, said

CASES = Path(__file__).parents[2] / "cases" / "conversion"


def cases(name: str) -> list[Any]:
    every = yaml.safe_load((CASES / name).read_text(encoding="utf-8"))
    return [pytest.param(case, id=case["case"]) for case in every]


@pytest.mark.parametrize("case", cases("services.yml"))
def test_a_service_has_its_fields_and_the_rest_is_told(case: dict[str, Any], tmp_path: Path) -> None:
    services = {"a": {"image": "busybox:1", **case["given"]}}
    services |= {name: {"image": "busybox:1"} for name in case.get("others", ())}
    if "users" in case:
        services["user"] = {"image": "busybox:1", "environment": case["users"]}
    found = draft(project(services), tmp_path)
    assert found.edf["services"]["a"] == {"image": "busybox:1", **case["makes"]}
    assert agree(said(found), case.get("says", ())) == []


@pytest.mark.parametrize("case", cases("mounts.yml"))
def test_mounts_become_what_an_experiment_ships(case: dict[str, Any], tmp_path: Path) -> None:
    folder = tmp_path / "stack"
    for name in ("config", "maps"):
        (folder / name).mkdir(parents=True)
    for name in ("config/params.yml", "config/start.sh", "a.rviz", "tok.txt", "../other"):
        (folder / name).write_text("x")
    document = project({"a": {"image": "busybox:1", **case["given"]}}, **case.get("top", {}))
    found = draft(document, folder, home="pilot")
    assert found.edf["services"]["a"] == {"image": "busybox:1", **case["makes"]}
    assert agree(said(found), case.get("says", ())) == []
    assert found.edf.get("volumes", {}) == case.get("seeds", {})
    assert found.edf.get("secrets", {}) == case.get("secrets", {})
    assert sorted(found.copies) == case.get("copies", [])
    assert found.texts == case.get("texts", {})
