"""The page that sets the paper and srprov side by side is made from results, and names what there is."""

from __future__ import annotations

import re

import pytest

from benchmarks import paper

ROOT = paper.DOCS.parents[1]


def test_docs_say_what_the_results_of_assignment_and_run_time_say() -> None:
    docs = paper.DOCS.read_text(encoding="utf-8")
    assert paper.written(docs) == docs, "python -m benchmarks.paper writes it anew"
    assert "| srprov, `--settle 0` |" in docs and "| fairness 0 |" in docs


@pytest.mark.parametrize("target", ["bench-containers", "bench-network", "bench-assignment", "bench-provisioning"])
def test_each_evaluation_has_a_target_that_measures_it_again(target: str) -> None:
    assert f"`make {target}`" in paper.DOCS.read_text(encoding="utf-8")
    assert re.search(rf"^{target}:.*## ", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)


def test_pictures_of_what_was_measured_are_there() -> None:
    pictures = re.findall(r"^!\[.*\]\(\.\./(.*)\)$", paper.DOCS.read_text(encoding="utf-8"), re.MULTILINE)
    assert len(pictures) >= 3
    assert [name for name in pictures if not (ROOT / name).exists()] == []
