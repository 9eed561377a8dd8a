"""`srprov schema`: the list of schemas, and settings for editors that name those of EDFs and CDFs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import pytest

from srprov import data
from srprov.cli.editor_settings import EDITORS, editor_settings, server_settings
from srprov.cli.main import run

tomllib = pytest.importorskip("tomllib", reason="Python 3.10 has none")


def printed(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    capsys.readouterr()
    assert run(["schema", *words]) == 0
    return capsys.readouterr().out


def test_without_a_kind_all_are_listed_with_what_they_are_of(capsys: pytest.CaptureFixture[str]) -> None:
    lines = printed(capsys).splitlines()
    assert [line.split()[0] for line in lines if line[0] != " "] == list(data.schema_kinds())
    assert any("--events FILE" in line for line in lines)


def test_settings_for_editors_name_the_schemas_that_are_installed(capsys: pytest.CaptureFixture[str]) -> None:
    """In VS Code's and Helix's the same reaches the language server: the files' names, the schemas, the tag."""
    code = json.loads(printed(capsys, "--editor", "vscode"))
    assert code["files.associations"] == {"*.edf": "yaml", "*.cdf": "yaml"}
    server: dict[str, Any] = {key.removeprefix("yaml."): value for key, value in code.items() if key[:5] == "yaml."}
    for (address, patterns), kind in zip(server["schemas"].items(), ("edf", "cdf"), strict=True):
        assert json.loads(Path(unquote(urlsplit(address).path)).read_text()) == data.schema(kind)
        assert patterns == [f"*.{kind}", f"*.{kind}.yml", f"*.{kind}.yaml"]
    helix = tomllib.loads(printed(capsys, "--editor", "helix"))
    assert helix["language-server"]["srprov-yaml"]["config"]["yaml"] == server
    (language,) = helix["language"]
    assert [one["glob"] for one in language["file-types"]] == [
        one for all_ in server["schemas"].values() for one in all_
    ]
    lua = printed(capsys, "--editor", "neovim")
    assert all(f'["{address}"] = {{' in lua for address in server["schemas"])
    assert '"!replace mapping",' in lua and 'vim.lsp.enable("yamlls")' in lua


@pytest.mark.parametrize("editor", EDITORS)
def test_an_address_with_odd_characters_ends_no_text_of_the_settings(editor: str) -> None:
    """Addresses come from a path; `Path.as_uri` leaves letters, digits and `~` alone, and writes the rest as %xx."""
    address = Path('/opt/a "b" \\ ]] é\n/edf.schema.json').as_uri()
    text = editor_settings(editor, {"edf": address})
    assert text.count(address) == 1 and text.isascii()
    assert list(server_settings({"edf": address})["schemas"]) == [address]


def test_settings_and_a_schema_at_once_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["schema", "edf", "--editor", "vscode"]) == 5
    assert "leave out 'edf', or --editor" in capsys.readouterr().err
