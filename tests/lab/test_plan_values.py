"""What a plan says to change, value by value, on real robots: exactly what was edited, and what Docker then has."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from srprov import data
from tests.lab.conftest import Done, Lab, busybox, edf, part_of_lab

pytestmark = pytest.mark.lab

TOKENS = ("canary-old-93b1", "canary-new-7c02")
PASSWORDS = ("canary-password-11", "canary-password-22")
"""In a variable of the EDF, where they do not belong: only the exact commands show them."""
Told = dict[str, dict[str, Any]]


class Site:
    """An experiment with one service for each kind of change."""

    def __init__(self, lab: Lab, folder: Path) -> None:
        self.lab, self.folder = lab, folder
        self.inventory = part_of_lab(lab, ["robot1", "robot2"], folder / "lab.yml")
        self.path = str(folder / "values.edf")
        (folder / "conf").mkdir()
        self.files("rate: 2\n", "level: 1\n")
        self.outputs: list[Done] = []

    def files(self, app: str, sub: str) -> None:
        (self.folder / "app.yml").write_text("a: 1\n" + app + "z: 9\n")
        (self.folder / "conf" / "same.yml").write_text("s: 1\n")
        (self.folder / "conf" / "sub.yml").write_text(sub)

    def write(self, **changed: dict[str, Any]) -> None:
        """Write the EDF; each service as it begins, but for what is given."""
        begin: dict[str, dict[str, Any]] = {
            "env": {"robot": "robot1", "environment": {"RATE": "2", "WORD": "a b", "DB_PASSWORD": PASSWORDS[0]}},
            "cmd": {"robot": "robot1"},
            "mounts": {"robot": "robot2", "volumes": ["./app.yml:/etc/app.yml", "./conf:/conf"]},
            "port": {"robot": "robot2", "ports": ["18080:80"]},
            "plain": {"robot": "robot2", "secrets": ["token"], "healthcheck": {"test": ["CMD", "true"]}},
        }
        services = {name: busybox(**{**one, **changed.get(name, {})}) for name, one in begin.items()}
        text = edf("values", services, secrets={"token": {"env": "VALUES_TOKEN"}}, placement={"slots_per_robot": 3})
        Path(self.path).write_text(text, encoding="utf-8")

    def run(self, verb: str, *words: str, token: str = TOKENS[0], file: str = "", code: int = 0) -> Done:
        done = self.lab.srprov(
            verb, file or self.path, "-i", self.inventory, "--allow", "secret", *words, env={"VALUES_TOKEN": token}
        )
        assert done.code == code, done
        self.outputs.append(done)
        return done

    def told(self, done: Done) -> Told:
        """Give the differences of each service's container, and of secrets, by name and field."""
        assert list(Draft202012Validator(data.schema("plan")).iter_errors(done.json)) == []
        return {
            step["name"].removeprefix("srprov.values."): {
                one["field"]: one.get("note") or one.get("diff") or [one["old"], one["new"]]
                for one in step["differences"]
            }
            for step in done.json["steps"]
            if "differences" in step
        }

    def environment(self) -> Mapping[str, str]:
        found = self.lab.inspect("robot1", "srprov.values.env")["Config"]["Env"]
        return dict(line.split("=", 1) for line in found)


@pytest.fixture
def site(lab: Lab, tmp_path: Path) -> Site:
    """Give the experiment, applied."""
    site = Site(lab, tmp_path)
    site.write()
    site.run("apply", "--yes", "--settle", "0", "--no-probe")
    return site


def test_a_plan_names_exactly_the_values_that_were_edited(site: Site) -> None:
    """One variable, one command, one mounted file, one port, one secret; nothing else, and no secret in any output."""
    lab = site.lab
    assert site.told(site.run("plan", "--json", "--detailed-exitcode")) == {}

    site.files("rate: 4\n", "level: 2\n")
    site.write(
        env={"environment": {"RATE": "4", "WORD": "a b", "DB_PASSWORD": PASSWORDS[1]}},
        cmd={"command": ["sleep", "90000"]},
        port={"ports": ["18081:80"]},
    )
    before = lab.everywhere(["robot1", "robot2"])
    planned = site.run("plan", "--json", token=TOKENS[1])

    assert site.told(planned) == {
        "env": {"environment.RATE": ["2", "4"], "environment.DB_PASSWORD": "secret, changed"},
        "cmd": {"command": ["sleep 86400", "sleep 90000"]},
        "mounts": {
            "volumes./etc/app.yml": ["@@ -1,3 +1,3 @@", " a: 1", "-rate: 2", "+rate: 4", " z: 9"],
            "volumes./conf": "1 changed: sub.yml",
        },
        "port": {"ports": ["18080:80/tcp", "18081:80/tcp"]},
        "/run/srprov/values/secrets/token": {"value": "secret, changed"},
    }
    text = site.run("plan", token=TOKENS[1]).out
    assert "      environment.RATE: 2 -> 4\n" in text and "        -rate: 2\n        +rate: 4\n" in text
    assert "\x1b" not in text
    markdown = site.run("plan", "--format", "markdown", token=TOKENS[1]).out
    assert "- environment.RATE: 2\n+ environment.RATE: 4\n" in markdown
    assert f"<!-- srprov-plan sha256:{planned.json['hash']} -->" in markdown
    assert f"Its hash, for `apply --expect`: {planned.json['hash']}\n" in text

    refused = site.run("apply", "--yes", "--expect", "0" * 64, token=TOKENS[1], code=6)
    assert "not the plan that was reviewed" in refused.err
    assert lab.everywhere(["robot1", "robot2"]) == before
    assert site.environment()["RATE"] == "2"

    words = ("--yes", "--settle", "0", "--no-probe", "--expect", planned.json["hash"][:32])
    site.run("apply", *words, token=TOKENS[1])
    assert site.environment()["RATE"] == "4"
    assert lab.inspect("robot1", "srprov.values.cmd")["Config"]["Cmd"] == ["sleep", "90000"]
    bound = lab.inspect("robot2", "srprov.values.port")["HostConfig"]["PortBindings"]
    assert [end["HostPort"] for end in bound["80/tcp"]] == ["18081"]
    assert lab.containers("robot2")["srprov.values.plain"] == before["robot2"]["srprov.values.plain"]
    assert site.told(site.run("plan", "--json", "--detailed-exitcode", token=TOKENS[1])) == {}
    for done in site.outputs:
        assert [word for word in TOKENS if word in done.out + done.err] == []
    assert [word for word in PASSWORDS if word in text + markdown] == []


def test_a_stale_plan_names_values_and_a_forged_one_is_refused(site: Site, tmp_path: Path) -> None:
    """What somebody else applied meanwhile stands in the refusal; a file whose values were edited is refused too."""
    file = str(tmp_path / "plan.json")
    site.write(env={"environment": {"RATE": "4", "WORD": "a b"}})
    site.run("plan", "-o", file)
    shown = Path(file).read_text()
    forged = str(tmp_path / "forged.json")
    step = next(one for one in json.loads(shown)["steps"] if one["name"] == "srprov.values.env")
    assert {"field": "environment.RATE", "old": "2", "new": "4"} in step["differences"]
    Path(forged).write_text(shown.replace('"old": "2"', '"old": "3"'))
    lied = site.run("apply", "--yes", "--adopt", file=forged, code=9)
    assert "this plan was not written on this controller, and would change instance 'values'" in lied.err

    site.write(env={"environment": {"RATE": "3", "WORD": "a b"}}, cmd={"command": ["sleep", "90000"]})
    site.run("apply", "--yes", "--settle", "0", "--no-probe")
    stale = site.run("apply", "--yes", file=file, code=6)

    assert "robot1: container:srprov.values.env: environment.RATE: was 2, is 3\n" in stale.err
    assert "robot1: container:srprov.values.cmd: command: was sleep 86400, is sleep 90000\n" in stale.err
    assert " hash: was " not in stale.err and " parts " not in stale.err
    assert site.environment()["RATE"] == "3"
    for text in (*(done.out + done.err for done in site.outputs), shown):
        assert [word for word in TOKENS if word in text] == []
