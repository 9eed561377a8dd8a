"""Hostile words end to end: files reach containers byte for byte and run nothing; a robot that lies only shows."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.hostile import CANARY, unprintable
from tests.lab.conftest import Done, Lab, busybox, edf, part_of_lab

pytestmark = pytest.mark.lab

ROBOT = "robot10"
_TOUCH = f"touch /{CANARY}"
VALUES = [
    f"$({_TOUCH})", f"`{_TOUCH}`", f"'; {_TOUCH}; '", f'"; {_TOUCH}; "', f"\n{_TOUCH}\n", "{{7*7}}",
    "{% raw %}{{ 1 }}{% endraw %}", f"-oProxyCommand={_TOUCH}", "a\tb\r\nc\\n", "\x1b[31mred\x1b]0;t\x07",
    "\u202eevil\u2028", "é😀", "!!", "*", "~", "null", "&a *a", "| x", "%s%n",
]  # fmt: skip
LIES = r"""
set -e
cp -p /etc/os-release /etc/os-release.before
printf 'PRETTY_NAME="\033[2JLiar \033]0;owned\007 \342\200\256 $(touch /CANARY) {{7*7}}"\n' >/etc/os-release
hostname >/run/hostname.before
printf 'evil\033]0;x\007`id`\377' >/proc/sys/kernel/hostname
ip link add "$(printf 'd\033[31m$(id)')" type bridge
ip link add liar type bridge
ip link set liar alias "$(printf 'srprov:x\ny\033[1m\342\200\256')" up
evil=$(printf 'x\nhello: done in 0.1 s: 99 changed\033]0;owned\007\033[2J\342\200\256|<b>`id`')
docker network create --label "srprov.instance=$evil" --label "srprov.source=$evil" liar >/dev/null
docker volume create --label "srprov.instance=$evil" --label srprov.service="$evil" liar >/dev/null
docker create --name srprov.lies.web --label srprov.instance=lies --label srprov.service=web \
    --label "srprov.source=$evil" --label "srprov.config-hash=$evil" --label "srprov.config-parts=$evil=x" \
    --label "srprov.stop-grace=$evil" busybox true >/dev/null
"""
TRUTH = r"""
mv /etc/os-release.before /etc/os-release; cat /run/hostname.before >/proc/sys/kernel/hostname; rm /run/hostname.before
ip link del liar; ip link del "$(printf 'd\033[31m$(id)')"; rm -f /CANARY
docker rm -f srprov.lies.web; docker network rm liar; docker volume rm liar
"""


def shows(done: Done) -> Done:
    """Check that what was printed only shows, and give it back."""
    assert unprintable(done.out) == [] and unprintable(done.err) == [], done
    assert "this is a bug in srprov" not in done.err, done
    return done


def test_hostile_values_reach_the_container_as_they_are(lab: Lab, tmp_path: Path) -> None:
    """Command, environment, working folder, and the path in the label of the source; nothing runs on either side."""
    folder = tmp_path / f"it's $(touch {CANARY}) {{{{7*7}}}} \x1b[31m"
    folder.mkdir()
    path = folder / "x.edf"
    environment = {f"WORD_{number}": value for number, value in enumerate(VALUES)}
    one = {
        **busybox("sleep", "86400", *VALUES), "entrypoint": ["sh", "-c", 'shift; exec sleep 86400', "x"],
        "environment": environment, "robot": ROBOT, "working_dir": "/$(touch x) {{7*7}}",
    }  # fmt: skip
    # YAML knows no halves of characters, which JSON may write
    path.write_text(json.dumps(json.loads(edf("hostile", {"one": one})), ensure_ascii=False), encoding="utf-8")
    inventory = part_of_lab(lab, [ROBOT], tmp_path / "lab.yml")
    shows(lab.srprov("plan", str(path), "-i", inventory, "-v"))
    applied = shows(lab.srprov("apply", str(path), "-i", inventory, "--yes", "--settle", "0"))
    assert applied.code == 0, applied

    seen = lab.inspect(ROBOT, "srprov.hostile.one")
    assert seen["Config"]["Cmd"] == ["sleep", "86400", *VALUES]
    assert {f"{key}={value}" for key, value in environment.items()} <= set(seen["Config"]["Env"])
    assert seen["Config"]["WorkingDir"] == "/$(touch x) {{7*7}}"
    assert seen["Config"]["Labels"]["srprov.source"].endswith(f"{path}")
    inside = lab.shell(ROBOT, "docker", "exec", "srprov.hostile.one", "sh", "-c", 'printf %s "$WORD_5$WORD_0"').out
    assert inside == "{{7*7}}" + f"$(touch /{CANARY})"
    assert shows(lab.srprov("plan", str(path), "-i", inventory, "--detailed-exitcode")).code == 0
    find = f"find / -xdev -name '*{CANARY}*' -not -path '/proc/*' 2>/dev/null; true"
    assert lab.shell(ROBOT, "sh", "-c", find).out == ""
    assert not [found for place in (lab.folder, Path("/"), folder, tmp_path) if (found := place / CANARY).exists()]


@pytest.mark.parametrize("name", [f"$(touch /{CANARY})", "a\nb", "-rf", "a/b", "{{7*7}}", "a\u202eb", "..", "a b", ""])
def test_a_hostile_service_name_is_refused_at_its_line(lab_of_module: Lab, tmp_path: Path, name: str) -> None:
    """Before any robot is asked, with exit 5 and the rule."""
    path = tmp_path / "x.edf"
    path.write_text(edf("hostile", {name: busybox()}), encoding="utf-8")
    inventory = part_of_lab(lab_of_module, [ROBOT], tmp_path / "lab.yml")
    refused = shows(lab_of_module.srprov("plan", str(path), "-i", inventory))
    assert refused.code == 5, refused
    assert f"{path}:" in refused.err and "error[SRP-1" in refused.err, refused


@pytest.fixture
def liar(lab: Lab, tmp_path: Path) -> Iterator[tuple[Lab, str]]:
    """Give a lab with a robot whose every word is hostile; afterwards it tells the truth again."""
    lab.shell(ROBOT, "docker", "pull", "-q", "busybox")
    lab.shell(ROBOT, "sh", "-c", LIES.replace("CANARY", CANARY))
    try:
        yield lab, part_of_lab(lab, [ROBOT, "robot11"], tmp_path / "lab.yml")
    finally:
        lab.shell(ROBOT, "sh", "-c", TRUTH.replace("CANARY", CANARY), check=False)


def test_a_robot_that_lies_only_shows(liar: tuple[Lab, str], tmp_path: Path) -> None:
    """Names, versions, labels and logs with escapes, newlines and markup: nothing but printable text of every verb."""
    lab, inventory = liar
    path = tmp_path / "talk.edf"
    noise = r"printf '\033]0;owned\007\033[2J\r\342\200\256hello: done\n\377\302\233x\n'; sleep 86400"
    services = {"loud": busybox("sh", "-c", noise, robot=ROBOT), "calm": busybox(robot="robot11")}
    path.write_text(edf("talk", services), encoding="utf-8")
    file = str(path)

    facts = shows(lab.srprov("facts", "-i", inventory, "--json")).json["robots"][ROBOT]
    assert "Liar" in facts["os"] and facts["os"].isprintable() and "{{7*7}}" in facts["os"]
    assert facts["hostname"].startswith("evil") and facts["hostname"].isprintable()
    for words in (
        ("facts", "-i", inventory), ("doctor", "-i", inventory), ("doctor", "-i", inventory, "--json"),
        ("assign", file, "-i", inventory, "--explain"), ("assign", file, "-i", inventory, "--json"),
        ("plan", file, "-i", inventory, "-v"), ("plan", file, "-i", inventory, "--format", "markdown"),
        ("plan", file, "-i", inventory, "--json"), ("apply", file, "-i", inventory, "--yes", "--settle", "0"),
        ("apply", file, "-i", inventory, "--yes", "--json"), ("status", "-i", inventory),
        ("status", "-i", inventory, "--json"), ("locks", "-i", inventory),
    ):  # fmt: skip
        done = shows(lab.srprov(*words))
        assert done.code == 0, done
        assert not [line for line in (done.out + done.err).splitlines() if line.startswith("hello: done in")], done
        if "--json" in words:
            json.loads(done.out)
    told = shows(lab.srprov("logs", file, "-i", inventory))
    assert told.code == 0 and "hello: done" in told.out, told

    # whose experiment it is, by the word of the robot: refused, and the robot's words stay inside of that sentence
    path.write_text(edf("lies", {"web": busybox(robot=ROBOT)}), encoding="utf-8")
    for more in ([], ["--format", "markdown"], ["--json"]):
        refused = shows(lab.srprov("plan", file, "-i", inventory, *more))
        assert refused.code == 9 and "was made from x" in refused.err, refused
        assert not [line for line in refused.err.splitlines() if line.startswith("hello: done")], refused
    for form in ("text", "markdown", "json"):
        adopted = shows(lab.srprov("plan", file, "-i", inventory, "--adopt", "--format", form))
        assert adopted.code == 0, adopted
        assert form != "markdown" or "<b>" not in adopted.out
    assert lab.shell(ROBOT, "sh", "-c", f"ls -d /{CANARY} 2>&1; true").out.count("No such") == 1
