"""The steps that modules make of hostile experiments and robots, in real shells: they do what was meant, and no more.

Every program that a script may call is a shell function that writes its arguments down, so nothing of this machine is
touched; PATH holds only canaries, which nobody means to call. The frames are those of transport.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from srprov.errors import SrprovError
from srprov.facts.links import parse_links
from srprov.modules import MODULES
from srprov.modules.module import MEMORY_ROOT, STATE_ROOT
from srprov.modules.secret import secret_path
from srprov.network.record import read_record
from srprov.planning.plan import Plan, Step
from srprov.resource import Observed
from srprov.transport.shell.frames import Frames, batch
from srprov.transport.shell.secret_script import secret_script
from srprov.transport.shell.shell import excerpt
from srprov.wire import EngineCall, Put, Run, quote, sh
from tests.conftest import examples
from tests.fakes import World
from tests.hostile import CANARY, WORDS, names, texts
from tests.resources import resource
from tests.worlds import Mount, experiment, plan_for, service

SHELLS = [shell for shell in ("dash", "busybox sh") if shutil.which(shell.split()[0])]
NONCE = "0123456789abcdef" * 2
SYSCTL = re.compile("/proc/sys/net/ipv4/conf/srpb[0-9a-f]{8,9}/")
"""Where the kernel is told to announce the addresses of an instance's bridge; this machine has none of that name."""
STUBS = ["rm", "rmdir", "cat", "tar", "chmod"]
PRELUDE = "\n".join(
    [
        '_said() { printf \'%s\\0\' "$@" >>"$TOLD"; printf \'\\036\\0\' >>"$TOLD"; }',
        *(f'{name}() {{ _said {name} "$@"; }}' for name in STUBS),
        'mkdir() { _said mkdir "$@"; /bin/mkdir "$@"; }',
        # what the shell wrote is moved, so that the next one finds nothing half written; what stubs did not make is not
        'mv() { _said mv "$@"; [ ! -e "$2" ] || /bin/mv "$@"; }',
        'base64() { _said base64 "$@"; while IFS= read -r _l; do :; done; }',
        'batch() { while IFS= read -r _l; do _said line "$1" "$_l"; done; }',
        *(
            f'{name}() {{ case $* in "-batch -") batch {name};; *) _said {name} "$@";; esac; }}'
            for name in ("ip", "bridge")
        ),
        # it lists what it was given, as a link is made only where its own rules are
        "_copy() { while IFS= read -r _l; do printf '%s\\n' \"$_l\"; done; }",
        'nft() { _said nft "$@"; r=${TOLD%/*}/bin/rules; case $1 in list) _copy <"$r" ;; *) _copy >"$r" ;; esac; }',
        "grep() { while IFS= read -r _l; do :; done; }",
        'stat() { _said stat "$@"; echo tmpfs; }',
        "sh() { _said sh; }; touch() { _said CANARY; }; reboot() { _said CANARY; }; id() { _said CANARY; }",
    ]
)
LIMITS = settings(
    max_examples=examples(30), deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large]
)
TREE = str(Path(__file__).parents[1] / "cases" / "shipped")

pytestmark = pytest.mark.skipif(not SHELLS, reason="neither dash nor busybox")


def told(shell: str, scripts: Sequence[str]) -> list[list[str]]:
    """Run scripts in one batch, each in its frame; give the arguments of every program that was called."""
    with tempfile.TemporaryDirectory(prefix="injection-") as folder:
        base = Path(folder)
        (base / "bin").mkdir()
        for name in ("touch", "reboot", "id"):
            (base / "bin" / name).write_text(f"#!/bin/sh\n/usr/bin/touch {base}/{CANARY}\n")
            (base / "bin" / name).chmod(0o755)
        (base / "sysctl").mkdir()
        here = [s.replace(STATE_ROOT, f"{folder}/state").replace(MEMORY_ROOT, f"{folder}/memory") for s in scripts]
        here = [SYSCTL.sub(f"{folder}/sysctl/", s) for s in here]
        program = shutil.which(shell.split(maxsplit=1)[0])
        done = subprocess.run(
            [str(program), *shell.split()[1:]], cwd=folder, capture_output=True, timeout=60,
            input=PRELUDE.encode() + b"\n" + batch(NONCE, here),
            env={"PATH": str(base / "bin"), "TOLD": str(base / "told"), "HOME": folder},
        )  # fmt: skip
        frames = Frames(NONCE, len(scripts))
        frames.feed(done.stdout)
        assert frames.done, done
        assert b"not found" not in done.stderr, done.stderr
        # a redirection may make a file of the name that was meant, anywhere below; a canary's name by itself is none
        strays = {path.name for path in base.iterdir()} - {"bin", "told", "state", "memory", "sysctl"}
        assert not strays, (strays, scripts)
        raw = (base / "told").read_bytes().decode() if (base / "told").exists() else ""
        calls = [call.split("\0")[:-1] for call in raw.split("\036\0")[:-1]]
        back = [
            [w.replace(f"{folder}/state", STATE_ROOT).replace(f"{folder}/memory", MEMORY_ROOT) for w in c]
            for c in calls
        ]
        assert not [call for call in back if call[0] in ("CANARY", "sh")], back
        return [_parsed(call) if call[0] == "line" else call for call in back]


def _parsed(call: list[str]) -> list[str]:
    """Read a line of a batch as iproute2 does; what would need its quotes has no place there."""
    _, program, line = call
    assert not set(line) & set("'\"\\#"), line
    return [program, *line.split()]


def without_mkdir(calls: Sequence[list[str]]) -> tuple[list[list[str]], set[str]]:
    """Return the calls but those that make folders, and these folders: what is there already is not made again."""
    return [c for c in calls if c[0] != "mkdir"], {c[-1] for c in calls if c[0] == "mkdir"}


def same(calls: Sequence[list[str]], wanted: Sequence[list[str]]) -> None:
    """Compare calls, whoever made the folders that several need."""
    (these, made), (those, needed) = without_mkdir(calls), without_mkdir(wanted)
    assert these == those
    assert made <= needed and all(any((one + "/").startswith(f"{two}/") for one in made) for two in needed)


def _is_written_by_the_shell(put: Put) -> bool:
    plain = not put.secret and not put.in_place and put.mode == 0o644 and len(put.content) <= 8192
    return plain and b"\0" not in put.content and put.content.decode("utf-8", "ignore").encode() == put.content


def put_meant(put: Put) -> list[list[str]]:
    """Return the calls that writing a file means."""
    part, mode = put.path + ".part", f"{put.mode:04o}"
    folder = put.path.rpartition("/")[0]
    read = [["stat", "-f", "-c", "%T", folder]] if put.secret else []
    if _is_written_by_the_shell(put):
        return [["mkdir", "-p", folder], ["mv", "-f", part, put.path]]
    move = [["cat", part], ["rm", "-f", part]] if put.in_place else [["mv", "-f", part, put.path]]
    again = [["chmod", mode, put.path]] if put.in_place else []
    return [["mkdir", "-p", folder], *read, ["base64", "-d"], ["chmod", mode, part], *move, *again]


def meant(step: Step) -> Iterator[list[str]]:
    """Return the calls that a step means, from what it wants and not from its scripts."""
    assert step.want is not None
    params, name = step.want.params, step.want.name
    for command in step.commands:
        if isinstance(command, Put):
            yield from put_meant(command)
    if step.module == "tree":
        part, tar = name + ".part", name + ".tar"
        yield from (["rm", "-rf", part], ["mkdir", "-p", part], ["tar", "-xf", tar, "-C", part], ["rm", "-f", tar])
        yield from (["chmod", "0755", part], ["mv", part, name])
    if step.module == "vxlan_filter":
        yield ["nft", "-f", "-"]
    if step.module == "vxlan":
        yield ["nft", "list", "table", "bridge", name]
        new = f"type vxlan id {params.vni} local {params.local} dstport {params.port} srcport 768 1023 nolearning"
        yield ["ip", "link", "add", name, *new.split()]
        yield ["ip", "link", "set", "dev", name, "alias", f"srprov:{params.instance}"]
        yield ["ip", "link", "set", "dev", name, "mtu", str(params.mtu), "master", params.bridge, "up"]
        yield ["ip", "link", "set", "dev", name, "type", "bridge_slave", "learning", "off", "fdb_flush"]
        yield ["ip", "link", "set", "dev", params.bridge, "type", "bridge", "mcast_snooping", "0"]
        yield ["ip", "link", "set", "dev", params.bridge, "address", params.bridge_mac]
        flood = "00:00:00:00:00:00"
        for mac, vtep in sorted({*params.fdb, *((mac, "") for mac, _ in params.fdb if mac != flood)}):
            verb, place = (
                "append" if mac == flood else "replace",
                f"dst {vtep} self permanent" if vtep else "master static",
            )
            yield ["bridge", *f"fdb {verb} {mac} dev {name} {place}".split()]


def script_of(command: Put | Run) -> str:
    """Return what the transport sends for a command."""
    if isinstance(command, Run):
        return command.script
    return secret_script(command, b"it's $(reboot)") if command.secret else command.script()


def plan_of(what: Any) -> Plan | None:
    """Plan on two robots; None where it is refused in words."""
    try:
        return plan_for(World().add("r1", "r2"), what)
    except SrprovError as error:
        assert error.message
        return None


@pytest.mark.parametrize("shell", SHELLS)
@LIMITS
@given(instance=names, volume=names, value=texts, data=st.data())
def test_steps_do_what_they_mean(shell: str, instance: str, volume: str, value: str, data: st.DataObject) -> None:
    """An experiment as no validator would let it pass: whatever is in its names and values, the calls are as meant."""
    first, second = data.draw(names), data.draw(names)
    mounts = (Mount(kind="tree", source=TREE, target=value or "/t"), Mount(kind="volume", source=volume, target="/v"))
    what = experiment(
        service(first, robot="r1", mounts=mounts, command=(value, "x"), environment=MappingProxyType({"WORD": value})),
        service(second + "2", robot="r2", working_dir=f"/{value}", user=value),
        name=instance,
    )
    plan = plan_of(what)
    if plan is None:
        return
    shelled = [s for s in plan.steps if any(isinstance(c, Put | Run) for c in s.commands)]
    assert {s.module for s in shelled} == {"file", "tree", "vxlan", "vxlan_filter"}
    scripts = [script_of(c) for s in shelled for c in s.commands if isinstance(c, Put | Run)]
    same(told(shell, scripts), [call for s in shelled for call in meant(s)])


@LIMITS
@given(value=texts, key=texts, data=st.data())
def test_the_engine_gets_every_value_as_it_is(value: str, key: str, data: st.DataObject) -> None:
    """Through Jinja, YAML and JSON: no template is rendered, no type guessed, no character lost."""
    word = data.draw(texts)
    what = experiment(
        service(
            "a", command=(value, word), entrypoint=(word,), working_dir=f"/{value}", user=word, group_add=(value,),
            environment=MappingProxyType({"WORD": value, "OTHER": word}), security_opt=(word,),
            sysctls=MappingProxyType({"k" + key: value}),
        )
    )  # fmt: skip
    plan = plan_of(what)
    assert plan is not None
    (body,) = [
        json.loads(c.body)
        for s in plan.steps
        for c in s.commands
        if isinstance(c, EngineCall) and c.path == "/containers/create"
    ]
    assert body["Cmd"] == [value, word] and body["Entrypoint"] == [word]
    assert {f"WORD={value}", f"OTHER={word}"} <= set(body["Env"])
    assert (body.get("WorkingDir", ""), body.get("User", "")) == (f"/{value}", word)
    assert body["HostConfig"]["Sysctls"] == {"k" + key: value}
    assert body["HostConfig"]["GroupAdd"] == [value] and body["HostConfig"]["SecurityOpt"] == [word]


@pytest.mark.parametrize("shell", SHELLS)
@LIMITS
@given(instance=names, name=names)
def test_secrets_and_removals_do_what_they_mean(shell: str, instance: str, name: str) -> None:
    """A secret's file, and everything that a robot says is there: links, files, trees and secrets of any name."""
    path = secret_path(instance, name, "0400")
    params = resource("secret", path, {"name": name, "mode": "0400"}).params
    changes = [MODULES["secret"].check(path, params, found) for found in (None, {"digest": None, "mode": ""})]
    puts = [c for change in changes if change for c in change.commands if isinstance(c, Put)]
    assert [put.in_place for put in puts] == [False, True]
    same(told(shell, [script_of(put) for put in puts]), [call for put in puts for call in put_meant(put)])

    there = {
        "file": f"{STATE_ROOT}/{instance}/{name}", "tree": f"{STATE_ROOT}/{instance}/trees/{name}",
        "secret": secret_path(instance, name, "0400"), "vxlan": name,
    }  # fmt: skip
    scripts, calls = [], []
    for module, path in there.items():
        found = Observed(module=module, name=path, instance=instance, state={})
        scripts += [c.script for c in MODULES[module].removal(found) if isinstance(c, Run)]
        if module == "vxlan":
            calls += [["ip", "link", "show", "dev", path], ["ip", "link", "del", "dev", path]]
            continue
        root = MEMORY_ROOT if module == "secret" else STATE_ROOT
        above = path.removeprefix(root + "/").split("/")[:-1]
        calls += [["rm", "-rf", path]]
        calls += [["rmdir", "/".join([root, *above[:count]])] for count in range(len(above), 0, -1)]
        calls += [["rmdir", MEMORY_ROOT]] if module == "secret" else []
    assert told(shell, scripts) == calls


@pytest.mark.parametrize("shell", SHELLS)
@LIMITS
@given(words=st.lists(texts, max_size=6))
def test_frames_and_quotes_keep_every_word(shell: str, words: list[str]) -> None:
    """Also where a command is quoted twice: in its frame, and in the frame of a frame."""
    script = sh("rm", *words)
    assert told(shell, [script, f"eval {quote(script)}"]) == [["rm", *words]] * 2
    assert "\n" not in excerpt(script)


@pytest.mark.parametrize("shell", SHELLS)
@pytest.mark.parametrize("script", ["rm $(touch x)", "rm x; touch x", "rm `id`", "rm x\nreboot", "rm x >stray"])
def test_what_is_not_quoted_is_seen(shell: str, script: str) -> None:
    """The stubs would tell: a test that cannot fail is worse than none."""
    with pytest.raises(AssertionError):
        told(shell, [script])


def test_a_nul_never_reaches_a_shell() -> None:
    with pytest.raises(ValueError, match="NUL"):
        sh("rm", "a\0b")
    with pytest.raises(ValueError, match="NUL"):
        batch(NONCE, ["rm a\0b"])


@pytest.mark.parametrize("word", WORDS)
def test_a_robot_that_lies_about_its_address_reaches_no_other_robot(word: str) -> None:
    """Behind the % of an IPv6 scope any text is an address to Python; it must not end up in other robots' tables."""
    evil = f"2001:db8::1%{word or 'x'}"
    world = World().add("r1", "r2")
    what = experiment(service("a", robot="r1"), service("b", robot="r2"))
    plan = plan_for(world, what)
    record = next(
        c.content for s in plan.steps for c in s.commands if isinstance(c, Put) and s.name.endswith("placement.json")
    )
    told_by_robot = json.loads(record)
    told_by_robot["serial"] = 99
    told_by_robot["robots"]["r2"]["vtep"] = evil
    known = read_record(told_by_robot)
    assert known is not None and "r2" not in known.vteps and known.vteps["r1"] == "10.0.0.1"

    answer = [
        {
            "ifname": "eth0",
            "flags": ["UP"],
            "addr_info": [{"local": evil, "prefixlen": 64}, {"local": "10.0.0.2", "prefixlen": 24}],
        }
    ]
    (link,) = parse_links(json.dumps(answer))
    assert link.addresses == ("10.0.0.2/24",)


def test_one_odd_link_hides_no_other() -> None:
    """`ip -j` writes most control characters of names and aliases as they are, which is no JSON to the strict."""
    odd = '{"ifname":"d\x1b[31m","ifalias":"x"},{"ifname":"liar","ifalias":"srprov:\x1b[1m\x07"},'
    links = parse_links("[" + odd + '{"ifname":"eth0","addr_info":[{"local":"10.0.0.2","prefixlen":24}]}]')
    assert [link.name for link in links] == ["eth0", "liar"]
    assert all(link.alias.isprintable() for link in links)
