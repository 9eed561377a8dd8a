"""Settings that make an editor complete, explain and check EDFs and CDFs, by the schemas that ship with srprov.

Takes the schemas' addresses; returns text. Pure. All of these editors ask the YAML language server, so what differs is
only how its settings are written. Source: the server's documentation (`yaml.schemas`, `yaml.customTags`), and those of
the editors.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

EDITORS = ("vscode", "neovim", "helix")
ENDINGS = ("", ".yml", ".yaml")
"""What may follow `.edf` and `.cdf` in a name."""
TAGS = ("!replace mapping", "!replace sequence")


def server_settings(schemas: Mapping[str, str]) -> dict[str, Any]:
    """Return the part `yaml` of the language server's settings.

    Args:
        schemas: `edf` and `cdf` -> the address of the schema.
    """
    patterns = {address: [f"*.{kind}{ending}" for ending in ENDINGS] for kind, address in schemas.items()}
    return {"schemas": patterns, "customTags": list(TAGS)}


def editor_settings(editor: str, schemas: Mapping[str, str]) -> str:
    """Return the settings of one of EDITORS, as its file has them."""
    return {"vscode": _vscode, "neovim": _neovim, "helix": _helix}[editor](schemas)


def _vscode(schemas: Mapping[str, str]) -> str:
    """Return `settings.json`, for the extension that brings the YAML language server."""
    associations = {f"*.{kind}": "yaml" for kind in schemas}
    flat = {f"yaml.{name}": value for name, value in server_settings(schemas).items()}
    return json.dumps({"files.associations": associations, **flat}, indent=2) + "\n"


def _neovim(schemas: Mapping[str, str]) -> str:
    """Return Lua for `init.lua`, from Neovim 0.11 on; it adds to what the user has set for `yamlls`."""
    kinds = ", ".join(f'{kind} = "yaml"' for kind in schemas)
    settings = "\n".join("    " + line for line in _lua({"yaml": server_settings(schemas)}).splitlines()).lstrip()
    return (
        f"vim.filetype.add({{ extension = {{ {kinds} }} }})\n"
        'vim.lsp.config("yamlls", {\n'
        '    cmd = { "yaml-language-server", "--stdio" },\n'
        '    filetypes = { "yaml" },\n'
        f"    settings = {settings},\n"
        "})\n"
        'vim.lsp.enable("yamlls")\n'
    )


def _lua(value: object) -> str:
    """Return lists, maps and texts without control characters as Lua, whose texts are then written as in JSON."""
    if isinstance(value, Mapping):
        inside = [f"[{_lua(key)}] = {_lua(one)}," for key, one in value.items()]
    elif isinstance(value, list):
        inside = [f"{_lua(one)}," for one in value]
    else:
        return json.dumps(value, ensure_ascii=False)
    lines = [f"    {line}" for text in inside for line in text.splitlines()]
    return "\n".join(["{", *lines, "}"])


def _helix(schemas: Mapping[str, str]) -> str:
    """Return TOML for `languages.toml`: a language of its own, so that the list of YAML's endings stays as it is."""
    globs = ", ".join(f'{{ glob = "*.{kind}{ending}" }}' for kind in schemas for ending in ENDINGS)
    settings = server_settings(schemas)
    lines = [f"{json.dumps(address)} = {json.dumps(names)}" for address, names in settings["schemas"].items()]
    return "\n".join(
        (
            "[[language]]",
            'name = "srprov"',
            'scope = "source.yaml"',
            'grammar = "yaml"',
            'language-id = "yaml"',
            f"file-types = [{globs}]",
            'comment-token = "#"',
            'indent = { tab-width = 2, unit = "  " }',
            'language-servers = ["srprov-yaml"]',
            "",
            "[language-server.srprov-yaml]",
            'command = "yaml-language-server"',
            'args = ["--stdio"]',
            "",
            "[language-server.srprov-yaml.config.yaml]",
            f"customTags = {json.dumps(settings['customTags'])}",
            "",
            "[language-server.srprov-yaml.config.yaml.schemas]",
            *lines,
            "",
        )
    )
