"""An archive may give a file of the user's a further name in a project, or a link to it: no verb shows or writes it.

Each file that a project may have is such a link in turn, with words that can be read there and some that cannot.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from srprov.cli.main import run

CANARY = "canary7731"
WRONG = f'{CANARY} = [unclosed\n  {CANARY}\t{{ x "{CANARY}\n'
PROJECT = {
    "e.edf": """\
edf: 1
name: nav
services:
  a: {cdf: cdf/a.cdf, volumes: ["./cfg/app.yml:/app.yml", "./tree:/tree", "seeded:/s"], env_file: [app.env]}
  b: {cdf: docker/Dockerfile, data: [{path: bag.dat, target: /bag.dat}]}
volumes: {seeded: {seed: ./seed}}
parameters: {SPEED: [1]}
trials: {repetitions: 1, timeout: 20s, order: listed}
""",
    "cdf/a.cdf": "cdf: 1\nextends: base.cdf\nfiles: [{src: files/x, dest: /x}, {src: more, dest: /more}]\n",
    "cdf/base.cdf": "cdf: 1\nbase: busybox\ncommand: sleep 1\n",
    "cdf/files/x": "x\n",
    "cdf/more/y": "y\n",
    "docker/Dockerfile": "FROM busybox\nCOPY . /here\n",
    "docker/.dockerignore": "nothing\n",
    "docker/z": "z\n",
    "cfg/app.yml": "a: 1\n",
    "tree/t": "t\n",
    "seed/s": "s\n",
    "app.env": "A=b\n",
    "bag.dat": "bag\n",
    "e.lock": "",
    "srprov.toml": "",
    "compose.yml": """\
services:
  a: {env_file: [c.env], volumes: ["./cv:/cv"], build: ./cb, configs: [cc], extends: {file: ext.yml, service: e}}
configs: {cc: {file: ./cc.txt}}
""",
    "compose.override.yml": "services: {a: {command: sleep 1}}\n",
    ".env": "V=w\n",
    "c.env": "C=d\n",
    "cv/v": "v\n",
    "cb/Dockerfile": "FROM busybox\nCOPY q /q\n",
    "cb/q": "q\n",
    "cc.txt": "cc\n",
    "ext.yml": "services: {e: {image: busybox}}\n",
}
VALUES = {
    "e.edf": PROJECT["e.edf"].replace("edf: 1", f"edf: 1\ndescription: {CANARY}"),
    "cdf/a.cdf": f"{PROJECT['cdf/a.cdf']}command: echo {CANARY}\n",
    "cdf/base.cdf": PROJECT["cdf/base.cdf"].replace("sleep 1", CANARY),
    "docker/Dockerfile": f"FROM busybox\nENV A={CANARY}\n",
    "app.env": f"A={CANARY}\n",
    "srprov.toml": f"{CANARY} = 1\n",
    "compose.yml": PROJECT["compose.yml"].replace("{env_file", f"{{working_dir: /{CANARY}, env_file"),
    "compose.override.yml": f"services: {{a: {{hostname: {CANARY}}}}}\n",
    "c.env": f"C={CANARY}\n",
    "cb/Dockerfile": f"FROM busybox\nENV A={CANARY}\n",
    "cc.txt": CANARY,
    "ext.yml": f"services: {{e: {{image: busybox, hostname: {CANARY}}}}}\n",
}
"""Where a comment says nothing of what is done with a file."""
VERBS = (
    "validate e.edf",
    "validate .",
    "fmt --check --diff e.edf cdf/a.cdf cdf/base.cdf",
    "fmt e.edf cdf/a.cdf cdf/base.cdf",
    "trials e.edf",
    "build --show e.edf",
    "config",
    "export compose e.edf -o exported --allow host-path",
    "import compose compose.yml compose.override.yml -o imported",
)
MADE = ("exported", "imported")
UNSEEN = frozenset({"docker/.dockerignore", "bag.dat", "e.lock", ".env"})
"""Files whose words do not come to light when they are the project's own either: patterns, what is named by its hash
alone, and variables that nothing uses."""


def texts_for(name: str) -> tuple[str, ...]:
    """Return with what a file is tried: words that cannot be read there; a value, if it may have one, and a comment."""
    return (WRONG, f"{VALUES.get(name, PROJECT[name])}\n# {CANARY}\n")


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the user's home, with a project in it, where the caller is."""
    project = tmp_path / "home" / "nav"
    for name, text in PROJECT.items():
        (project / name).parent.mkdir(parents=True, exist_ok=True)
        if text:
            (project / name).write_text(text)
    monkeypatch.chdir(project)
    return project.parent


def came_to_light(capsys: pytest.CaptureFixture[str]) -> list[str]:
    """Run all verbs; return which of them showed the canary, or wrote it into a new folder; links tell nothing."""
    seen = []
    for folder in MADE:
        shutil.rmtree(folder, ignore_errors=True)
    for verb in VERBS:
        run(verb.split())
        said = capsys.readouterr()
        made = [path for folder in MADE for path in Path(folder).rglob("*") if path.is_file() and not path.is_symlink()]
        if CANARY in said.out + said.err or any(CANARY in path.read_text() for path in made):
            seen.append(verb)
    return seen


@pytest.mark.parametrize("link", [Path.hardlink_to, Path.symlink_to])
@pytest.mark.parametrize("name", PROJECT)
def test_no_verb_shows_or_writes_a_file_of_the_user_s(
    home: Path, capsys: pytest.CaptureFixture[str], name: str, link: Callable[[Path, Path], None]
) -> None:
    own = home / "own"
    for text in texts_for(name):
        own.write_text(text)
        (home / "nav" / name).unlink(missing_ok=True)
        link(home / "nav" / name, own)
        assert came_to_light(capsys) == []
        assert own.read_text() == text


@pytest.mark.parametrize("name", sorted(PROJECT.keys() - UNSEEN))
def test_the_same_words_in_a_file_of_the_project_come_to_light(
    home: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    """So the check above can fail."""
    found = []
    for text in texts_for(name):
        (home / "nav" / name).write_text(text)
        found += came_to_light(capsys)
    assert found
