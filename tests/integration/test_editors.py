"""What an editor with the YAML language server makes of EDFs and CDFs, with the settings of `srprov schema --editor`.

The server is fetched by npm, at one version; a long test therefore.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from srprov import data
from srprov.cli.editor_settings import editor_settings, server_settings
from srprov.yamldoc import loader
from srprov.yamldoc.nodes import Map, Node, Scalar, Seq
from tests.integration.language_server import LanguageServer
from tests.unit.definitions.examples import BASE, CDF, EDF

SERVER = "yaml-language-server@1.25.0"
LUA = "lupa==2.6"
RUN_LUA = """\
import json, sys
from lupa.luajit21 import LuaRuntime, lua_type

lua = LuaRuntime()
lua.execute('''
told = {}
vim = {
    filetype = { add = function(about) told.filetypes = about end },
    lsp = { config = function(name, about) told.config = about end, enable = function(name) told.enabled = name end },
}
''')
lua.execute(sys.stdin.read())


def plain(value):
    if lua_type(value) != "table":
        return value
    keys = list(value)
    return [plain(value[key]) for key in keys] if keys[0] == 1 else {key: plain(value[key]) for key in keys}


print(json.dumps(plain(lua.globals().told)))
"""
ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = sorted([*ROOT.glob("examples/*/*.edf"), *ROOT.glob("examples/*/*.cdf")])

pytestmark = [
    pytest.mark.soak,
    pytest.mark.skipif(not (shutil.which("node") and shutil.which("npm")), reason="needs Node.js and npm"),
]


@pytest.fixture(scope="module")
def command(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, ...]:
    """Fetch the language server; return what starts it."""
    folder = tmp_path_factory.mktemp("node")
    fetch = ("npm", "install", "--silent", "--no-audit", "--no-fund", "--ignore-scripts", "--prefix", str(folder))
    subprocess.run((*fetch, SERVER), check=True, timeout=300)
    return ("node", str(folder / "node_modules/yaml-language-server/bin/yaml-language-server"), "--stdio")


@pytest.fixture(scope="module")
def server(command: tuple[str, ...]) -> Iterator[LanguageServer]:
    """Start it on this repository, with the schemas of this installation."""
    schemas = {kind: data.schema_path(kind).as_uri() for kind in ("edf", "cdf")}
    with LanguageServer(command, ROOT, server_settings(schemas)) as running:
        yield running


def keys(node: Node, within: str = "") -> Iterator[tuple[Scalar, str]]:
    """Return every key of a document, and where its map stands."""
    if isinstance(node, Map):
        for name, value in node.entries.items():
            yield node.keys[name], within
            yield from keys(value, f"{within}.{name}")
    elif isinstance(node, Seq):
        for item in node.items:
            yield from keys(item, f"{within}[]")


def properties(path: Path) -> dict[str, Any]:
    """Return what may stand at the top of a file, by its name."""
    found = data.schema(path.suffix[1:])["properties"]
    assert isinstance(found, dict)
    return found


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_every_example_is_right_explained_and_completed(server: LanguageServer, path: Path) -> None:
    """No mark on it; a hover over each key explains it; an empty line at its end offers what is not there yet."""
    text = path.read_text(encoding="utf-8").rstrip() + "\n\n"
    assert server.open(path, text) == []
    root = loader.read(path)
    assert isinstance(root, Map)
    for key, within in keys(root):
        told = server.at("hover", path, key.line - 1, key.column)
        said = told["contents"]["value"] if told else ""
        assert len(said.splitlines()) > 1, f"{within}.{key.text}"
    offered = server.at("completion", path, text.count("\n"), 0)["items"]
    assert {one["label"] for one in offered} >= set(properties(path)) - set(root.entries)
    for one in offered:
        assert one["label"] not in properties(path) or one["documentation"], one


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_a_key_that_does_not_exist_is_marked_in_every_example(server: LanguageServer, path: Path) -> None:
    text = path.read_text(encoding="utf-8").rstrip() + "\nnonsense: 1\n"
    (problem,) = server.open(path.with_name(f"changed-{path.name}"), text)
    assert problem["range"]["start"] == {"line": text.count("\n") - 1, "character": 0}
    assert "nonsense" in problem["message"]


@pytest.mark.parametrize("ending", ["", ".yml", ".yaml"])
def test_a_service_is_completed_by_all_of_its_keys_whatever_the_file_is_called(
    server: LanguageServer, tmp_path: Path, ending: str
) -> None:
    path = tmp_path / f"e.edf{ending}"
    assert server.open(path, "edf: 1\nname: a\nservices:\n  a:\n    image: x\n    ") == []
    offered = server.at("completion", path, 5, 4)["items"]
    known = data.schema("edf")["properties"]["services"]["additionalProperties"]["properties"]
    assert {one["label"] for one in offered} >= set(known) - {"image"}
    assert len(known) > 50


@pytest.mark.parametrize(
    ("name", "text"),
    [("full.edf", EDF), ("full.cdf", CDF), ("base.cdf.yml", BASE),
     ("tag.cdf", "cdf: 1\nextends: base.cdf\nenvironment: !replace {A: 1}\ncommand: !replace [go]\n")],
)  # fmt: skip
def test_documents_with_every_field_and_the_tag_have_no_mark(
    server: LanguageServer, tmp_path: Path, name: str, text: str
) -> None:
    """The server reads YAML 1.2, to which `yes` and `no` are words: it marks them where a boolean is wanted."""
    marks = [text.splitlines()[one["range"]["start"]["line"]] for one in server.open(tmp_path / name, text)]
    assert all("gpu: yes" in line or "privileged: no" in line for line in marks), marks
    plain = text.replace("gpu: yes", "gpu: true").replace("privileged: no", "privileged: false")
    assert server.open(tmp_path / f"plain-{name}", plain) == []


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("edf: 2\nname: a\nservices: {a: {image: x}}\n", 0),
        ("edf: 1\nname: A B\nservices: {a: {image: x}}\n", 1),
        ("edf: 1\nname: a\nservices:\n  a:\n    image: x\n    cost: 101\n", 5),
        ("edf: 1\nname: a\nservices:\n  a: {image: x}\n  a: {image: y}\n", 4),
        ("edf: 1\nname: a\nservices: {}\n", 2),
    ],
)
def test_what_the_schema_refuses_is_marked_at_its_line(
    server: LanguageServer, tmp_path: Path, text: str, line: int
) -> None:
    problems = server.open(tmp_path / "bad.edf", text)
    assert line in {one["range"]["start"]["line"] for one in problems}, problems


def test_what_the_manual_says_for_a_team_and_for_other_names_works(command: tuple[str, ...], tmp_path: Path) -> None:
    """Schemas in the repository by relative paths, and a line at the head of a file whose name says nothing."""
    manual = (ROOT / "docs/editors.md").read_text(encoding="utf-8")
    settings = json.loads(manual.split("```json\n")[1].split("```")[0])
    (line,) = re.findall("^# yaml-language-server: .*", manual, re.MULTILINE)
    (tmp_path / ".vscode").mkdir()
    for kind in ("edf", "cdf"):
        (tmp_path / f".vscode/{kind}.schema.json").write_text(data.schema_text(kind), encoding="utf-8")
    (tmp_path / "edf.schema.json").write_text(data.schema_text("edf"), encoding="utf-8")
    yaml = {key.removeprefix("yaml."): value for key, value in settings.items() if key.startswith("yaml.")}
    with LanguageServer(command, tmp_path, yaml) as running:
        for name, text in (("a.edf", ""), ("b.cdf.yml", ""), ("experiment.yml", f"{line}\n")):
            (problem, *_) = running.open(tmp_path / name, f"{text}nonsense: 1\n")
            assert "srprov " in problem["source"], name
        assert running.open(tmp_path / "other.yml", "nonsense: 1\n") == []


def test_the_lua_for_neovim_says_the_same(tmp_path: Path) -> None:
    """Run by LuaJIT, as Neovim does, with a `vim` that keeps what it is told."""
    fetch = (sys.executable, "-m", "pip", "install", "-q", "--target", str(tmp_path), LUA)
    subprocess.run(fetch, check=True, timeout=300)
    schemas = {kind: data.schema_path(kind).as_uri() for kind in ("edf", "cdf")}
    (tmp_path / "run.py").write_text(RUN_LUA, encoding="utf-8")
    done = subprocess.run(
        (sys.executable, "run.py"),
        cwd=tmp_path,
        input=editor_settings("neovim", schemas),
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done
    told = json.loads(done.stdout)
    assert told["filetypes"] == {"extension": {"edf": "yaml", "cdf": "yaml"}} and told["enabled"] == "yamlls"
    assert told["config"]["settings"] == {"yaml": server_settings(schemas)}
    assert told["config"]["cmd"] == ["yaml-language-server", "--stdio"]
