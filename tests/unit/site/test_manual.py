"""Pages of the manual say what is so: links lead somewhere, kinds of permission are asked for by their examples."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import pytest
import yaml

from srprov.cli.main import _VERBS
from srprov.definitions import load_experiment
from srprov.planning.policy import KINDS, permissions
from tests.pages import ROOT
from tools.site import fields, verbs
from tools.site.markup import code, text
from tools.site.pages import GROUPS, REST, arranged
from tools.site.stage import links, sources, stage

PERMISSIONS = (ROOT / "docs" / "permissions.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"^\| `([a-z-]+)` \| `([^`]+)`", PERMISSIONS, re.MULTILINE)
OTHER = {"git", "playbook", "secret", "secret-command"}
"""Kinds whose examples need more than one line of an EDF."""


@pytest.mark.parametrize(("kind", "line"), [one for one in EXAMPLES if one[0] not in OTHER])
def test_the_example_of_a_permission_asks_for_it_and_for_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, line: str
) -> None:
    folder, shared = tmp_path / "e", tmp_path / "shared"
    for each in (folder, shared):
        each.mkdir()
    (shared / "talker.cdf").write_text("cdf: 1\nname: talker\nbase: busybox\n")
    monkeypatch.setenv("LAB_NAME", "hall")
    asked = yaml.safe_load(line)
    top = {key: asked.pop(key) for key in [*asked] if kind == "unit"}
    image = {} if {"image", "cdf"} & asked.keys() else {"image": "busybox"}
    edf = {"edf": 1, "name": "x", "services": {"a": {**image, **asked}}, **top}
    (folder / "x.edf").write_text(json.dumps(edf))
    found = {one.kind for one in permissions(load_experiment(str(folder / "x.edf")).experiment)}
    assert found == {kind}


def test_every_kind_of_permission_has_its_line() -> None:
    assert [kind for kind, _ in EXAMPLES if kind not in KINDS] == []
    assert {kind for kind, _ in EXAMPLES} == set(KINDS)


def test_every_page_has_its_place_in_the_navigation() -> None:
    named = [page for pages in GROUPS.values() for page in pages]
    assert sorted(named) == sorted(set(named))
    found = {name.removesuffix(".md") for name in sources(ROOT)}
    made = {name.removesuffix(".md") for name in (*verbs.pages(), *fields.pages(ROOT / "schemas"))}
    assert sorted(set(named) - found - made) == [], "named and not there"
    assert arranged({"docs/robot", "docs/new"})[REST] == ["docs/new"], "a page without a place is shown, too"
    assert REST not in arranged({"docs/robot", "benchmarks/images/results/images"}), "but for tables of results"


def anchors(page: Path) -> set[str]:
    """Return the anchors of a page's headings, as GitHub and MyST make them."""
    found, fence = set(), False
    for line in page.read_text(encoding="utf-8").splitlines():
        fence ^= line.lstrip().startswith("```")
        if not fence and re.match(r"#{1,6} ", line):
            title = re.sub(r"[`*]", "", line.lstrip("#").strip()).lower()
            found.add(re.sub(r"[^\w\- ]", "", title).replace(" ", "-"))
    return found


@pytest.mark.parametrize("name", sources(ROOT))
def test_links_lead_somewhere(name: str) -> None:
    lost = []
    for target in links((ROOT / name).read_text(encoding="utf-8")):
        if re.match(r"https?:|mailto:", target):
            continue
        path, _, anchor = target.partition("#")
        where = Path(os.path.normpath((ROOT / name).parent / path)) if path else ROOT / name
        if not where.exists() or (anchor and anchor not in anchors(where)):
            lost.append(target)
    assert lost == []


def test_the_stage_has_every_page_and_what_pages_link_to(tmp_path: Path) -> None:
    pages = stage(ROOT, tmp_path)
    assert {"README.md", "docs/tutorial.md", "reference/verbs/apply.md", "reference/fields/edf.md"} <= set(pages)
    assert all((tmp_path / page).is_file() for page in pages)
    home = (tmp_path / "README.md").read_text()
    assert all(f":caption: {title}" in home for title in GROUPS) and "](examples/hello/README.md)" in home
    assert "```mermaid" not in (tmp_path / "docs/architecture.md").read_text()
    assert "<!-- run" not in (tmp_path / "docs/debugging.md").read_text()
    apply = (tmp_path / "reference/verbs/apply.md").read_text()
    result = (tmp_path / "benchmarks/images/results/images.md").read_text()
    assert result.startswith("---\norphan: true\n---\n\n# Results: images\n\n"), "a table has no title of its own"
    assert "`--allow` KIND" in apply and "`SRPROV_APPLY_ALLOW`" in apply
    edf = (tmp_path / "reference/fields/edf.md").read_text()
    names = json.loads((ROOT / "schemas/edf.schema.json").read_text())["properties"]
    assert [name for name in names if f"| `{name}`" not in edf] == []


def test_a_page_that_links_to_nothing_is_refused(tmp_path: Path) -> None:
    (tmp_path / "schemas").mkdir()
    (tmp_path / "README.md").write_text("[gone](docs/gone.md)\n")
    with pytest.raises(FileNotFoundError, match=r"README.md: docs/gone.md"):
        stage(tmp_path, tmp_path / "out")


def test_text_is_shown_as_it_is() -> None:
    assert text("a|b *c* `d*e` <f> [g]") == r"a\|b \*c\* `d*e` \<f\> \[g\]"
    assert code("a`b|c") == "``a`b\\|c``"


COMPARISON = (ROOT / "docs" / "comparison.md").read_text(encoding="utf-8")


def test_the_table_of_what_is_looked_for_names_tests_that_there_are() -> None:
    has, _, has_not = COMPARISON.partition("## Has not")
    rows = [re.split(r"(?<!\\)\|", line)[1:-1] for line in has.splitlines() if line.startswith("| ")][1:]
    assert len(rows) >= 25 and {len(row) for row in rows} == {7}
    lost = []
    for row in rows:
        file, _, name = row[-1].strip().strip("`").partition("::")
        source = (ROOT / file).read_text(encoding="utf-8") if (ROOT / file).is_file() else ""
        if not re.search(rf"^def {name or 'test_'}", source, re.MULTILINE):
            lost.append(row[-1])
    assert lost == []
    reasons = [line.split("|")[3].strip() for line in has_not.splitlines() if line.startswith("| ")][1:]
    assert reasons and all(len(reason.split()) > 4 for reason in reasons)


def test_every_verb_that_the_table_names_is_one() -> None:
    named = re.findall(r"^\|(?:[^|]*\|){5} ([^|]*)\|", COMPARISON, re.MULTILINE)
    words = {word for cell in named for word in re.findall(r"`([a-z]+)[` ]", cell)}
    assert {"plan", "apply", "logs"} <= words & set(_VERBS)


@pytest.mark.parametrize("page", ["from-ansible.md", "from-kubernetes.md"])
def test_what_stands_on_the_right_side_of_another_tools_file_is_an_experiment(tmp_path: Path, page: str) -> None:
    lines = (ROOT / "docs" / page).read_text(encoding="utf-8").splitlines()
    head = next(at for at, line in enumerate(lines) if "# experiment.edf" in line)
    column = lines[head].index("# experiment.edf")
    end = next(at for at, line in enumerate(lines) if at > head and line == "```")
    path = tmp_path / "x.edf"
    path.write_text("\n".join(line[column:] for line in lines[head:end]) + "\n")
    assert len(load_experiment(str(path)).experiment.services) >= 1
    left = yaml.safe_load("\n".join(line[:column] for line in lines[head:end]))
    assert left, "the other tool's file is YAML, too"
