"""A stack for Docker Swarm: each field in its words, and what it would ignore refused at its line."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest

from srprov.errors import DefinitionError, UsageError
from srprov.image_reference import parse_reference
from tests.unit.exporting.clusters import documents, on_cluster, pod
from tests.unit.exporting.exports import classes, contents, experiment, notes

FULL = """\
services:
  all:
    image: busybox:1.36
    command: [sh, -c, 'echo "$HOME"']
    working_dir: /work
    user: "1000:1000"
    stop_signal: SIGINT
    stop_grace_period: 1m30s
    healthcheck: {test: 'test -e /ok', interval: 1500ms, timeout: 2s, retries: 5, start_period: 1s}
    ports: ["8080:80", "9000:9000/udp"]
    ulimits: {nofile: {soft: 1024, hard: 2048}}
    cap_add: [SYS_NICE]
    sysctls: {net.core.somaxconn: 1024}
    read_only: true
    tmpfs: ["/tmp:size=64m"]
    extra_hosts: {cloud: 192.0.2.7}
    mem_limit: 256m
    mem_reservation: 128m
    cpus: 1.5
    pids_limit: 100
    shm_size: 64m
    restart: on-failure:3
    environment: {A: "010", B: "$x"}
    volumes: ["data:/data", "/etc/machine-id:/etc/machine-id:ro"]
    privileged: false
    devices: []
"""


def stack(edf: Path, **placed: str) -> dict[str, Any]:
    return documents(on_cluster("swarm", edf, placed or None), "01-stack.yml")[0]


def test_every_field_that_swarm_can_do_has_its_form(tmp_path: Path) -> None:
    made = stack(experiment(tmp_path, FULL))
    one = made["services"]["all"]
    assert one["command"] == ["sh", "-c", 'echo "$$HOME"']
    assert (one["working_dir"], one["user"], one["stop_signal"]) == ("/work", "1000:1000", "SIGINT")
    assert one["stop_grace_period"] == "90s"
    assert one["healthcheck"]["test"] == ["CMD-SHELL", "test -e /ok"]
    assert one["ports"] == [
        {"target": 80, "published": 8080, "protocol": "tcp", "mode": "host"},
        {"target": 9000, "published": 9000, "protocol": "udp", "mode": "host"},
    ]
    assert one["extra_hosts"] == ["cloud:192.0.2.7"]
    assert one["deploy"] == {
        "endpoint_mode": "dnsrr",
        "labels": {"srprov.instance": "demo"},
        "placement": {"constraints": ["node.hostname==r1"]},
        "restart_policy": {"condition": "on-failure", "max_attempts": 3},
        "resources": {
            "limits": {"cpus": "1.5", "memory": str(256 << 20), "pids": 100},
            "reservations": {"memory": str(128 << 20)},
        },
    }
    assert {"type": "tmpfs", "target": "/dev/shm", "tmpfs": {"size": 64 << 20}} in one["volumes"]
    assert {"type": "volume", "source": "data", "target": "/data", "volume": {"nocopy": True}} in one["volumes"]
    assert made["volumes"] == {"data": {"name": "srprov_demo_data"}}
    assert one["environment"]["B"] == "$$x"
    assert not {"mem_limit", "cpus", "shm_size", "restart", "privileged", "devices", "pull_policy"} & one.keys()


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("devices", "[/dev/ttyUSB0]"),
        ("privileged", "true"),
        ("security_opt", '["no-new-privileges:true"]'),
        ("ipc", "host"),
        ("pid", "host"),
        ("oom_score_adj", "-5"),
        ("cpuset", '"0"'),
        ("group_add", "[video]"),
        ("runtime", "nvidia"),
        ("gpus", "all"),
        ("network", "none"),
        ("network", "both"),
        ("command", "[]"),
        ("extra_hosts", "{base: host-gateway}"),
        ("ports", '["127.0.0.1:80:80"]'),
        ("volumes", '["~pi/x:/x"]'),
    ],
)
def test_what_swarm_would_ignore_is_refused_at_its_line_or_left_out(tmp_path: Path, field: str, value: str) -> None:
    edf = experiment(tmp_path, f"services:\n  a:\n    image: x\n    {field}: {value}\n")
    with pytest.raises(DefinitionError) as refused:
        on_cluster("swarm", edf)
    assert [(one.location.line, one.path) for one in refused.value.problems] == [(6, f"services.a.{field}")]
    made = on_cluster("swarm", edf, lossy=True)
    assert classes(made)[f"services.a.{field}"] == "dropped"
    assert field not in documents(made, "01-stack.yml")[0]["services"]["a"] or field in (
        "ports",
        "extra_hosts",
        "volumes",
    )


def test_what_swarm_would_fill_in_as_a_template_stays_as_it_is(tmp_path: Path) -> None:
    """As Docker Swarm 20.10 filled it in: a variable had the text of the EDF again, and a mount its path."""
    mounts = "volumes: ['/srv/{{a:/b{{', 'd:/c'], tmpfs: ['/t{{']"
    text = f"services: {{a: {{image: x, environment: {{A: '{{{{.Node.Hostname}}}}'}}, {mounts}}}}}"
    one = stack(experiment(tmp_path, text))["services"]["a"]
    assert one["environment"]["A"] == '{{"{{"}}.Node.Hostname}}'
    paths = [(mount.get("source"), mount["target"]) for mount in one["volumes"]]
    assert paths == [('/srv/{{"{{"}}a', '/b{{"{{"}}'), ("d", "/c"), (None, '/t{{"{{"}}')]


def test_a_cdf_s_field_is_refused_too(tmp_path: Path) -> None:
    edf = experiment(tmp_path, "services: {a: {cdf: a.cdf}}", a_dot_cdf="cdf: 1\nimage: x\nprivileged: true\n")
    with pytest.raises(DefinitionError) as refused:
        on_cluster("swarm", edf)
    assert any(one.location.file.endswith("a.cdf") and one.location.line == 3 for one in refused.value.problems)


def test_files_of_the_experiment_become_configs_and_large_ones_are_refused(tmp_path: Path) -> None:
    text = "services: {a: {image: x, volumes: [./www:/www]}}"
    made = on_cluster("swarm", experiment(tmp_path, text, www__a="1", www__deep__b="2"))
    document = documents(made, "01-stack.yml")[0]
    shipped = {
        one["target"]: document["configs"][one["source"]]["file"] for one in document["services"]["a"]["configs"]
    }
    files = contents(made)
    assert files[shipped["/www/a"].removeprefix("./")] == b"1"
    assert files[shipped["/www/deep/b"].removeprefix("./")] == b"2"
    with pytest.raises(DefinitionError, match="1 problem") as refused:
        on_cluster("swarm", experiment(tmp_path, text, www__large="x" * 500_001))
    assert "larger than the 500 kB" in refused.value.problems[0].message


def test_levels_are_files_and_the_script_waits_between(tmp_path: Path) -> None:
    text = (
        "services:\n  job: {image: x, job: true}\n  a: {image: x, depends_on: {job: {condition: completed}}}\n"
        "  b: {image: x, depends_on: {a: {condition: started}}}\n"
    )
    made = on_cluster("swarm", experiment(tmp_path, text))
    names = [sorted(documents(made, f"0{number}-stack.yml")[0]["services"]) for number in (1, 2, 3)]
    assert names == [["job"], ["a"], ["b"]]
    script = contents(made)["deploy.sh"].decode()
    steps = [line for line in script.splitlines() if line.startswith(("await ", "docker stack"))]
    assert [line.split(" -c ")[-1].replace(' "$stack"', "") for line in steps] == [
        "01-stack.yml", "await job complete", "02-stack.yml", "await a running", "03-stack.yml",
    ]  # fmt: skip
    path = tmp_path / "deploy.sh"
    path.write_text(script)
    assert subprocess.run(["sh", "-n", str(path)], check=False).returncode == 0


DOCKER = """\
#!/bin/sh
case "$*" in
    "stack services -q demo") [ "$THERE" != fails ] && printf %s "$THERE" ;;
    "service inspect "*) echo "$WHOSE" ;;
    *) echo "$*" >>"$LOG" ;;
esac
"""


@pytest.mark.parametrize(
    ("there", "whose", "said"),
    [
        ("", "", ""),
        ("x", "demo", ""),
        ("x", "", "the stack demo is there"),
        ("x y", "other", "the stack demo is there"),
        ("fails", "", "docker does not say"),
    ],
)
def test_a_stack_of_somebody_else_is_left_alone(tmp_path: Path, there: str, whose: str, said: str) -> None:
    """A stranger's experiment may have the name of one that is there: its services would be replaced."""
    script = contents(on_cluster("swarm", experiment(tmp_path, "services: {a: {image: x}}")))["deploy.sh"]
    for name, content in (("docker", DOCKER.encode()), ("deploy.sh", script), ("log", b"")):
        (tmp_path / name).write_bytes(content)
        (tmp_path / name).chmod(0o755)
    env = {"PATH": f"{tmp_path}:{os.environ['PATH']}", "LOG": str(tmp_path / "log"), "THERE": there, "WHOSE": whose}
    run = subprocess.run(["sh", str(tmp_path / "deploy.sh")], env=env, capture_output=True, text=True, check=False)
    assert run.returncode == bool(said) and run.stderr.startswith(said) and bool(run.stderr) == bool(said)
    assert ("stack deploy" in (tmp_path / "log").read_text()) is not bool(said)


@pytest.mark.parametrize("kind", ["static-peers", "ros1", "discovery-server", "zenoh", "multicast"])
def test_discovery_is_told_by_names(tmp_path: Path, kind: str) -> None:
    servers = ", discovery_servers: a" if kind in ("ros1", "discovery-server", "zenoh") else ""
    text = f"network: {{discovery: {kind}{servers}}}\nservices: {{a: {{image: x}}, b: {{image: x}}}}"
    made = on_cluster("swarm", experiment(tmp_path, text))
    one = documents(made, "01-stack.yml")[0]["services"]["b"]
    expected = {
        "ros1": {"ROS_MASTER_URI": "http://a:11311", "ROS_HOSTNAME": "b"},
        "discovery-server": {"ROS_DISCOVERY_SERVER": "a:11811"},
        "zenoh": {"ZENOH_CONFIG": "/etc/srprov/zenoh.json5"},
    }.get(kind, {"ROS_STATIC_PEERS": "a;b"})
    assert expected.items() <= one["environment"].items()
    assert ("as static-peers" in notes(made)["network.discovery"]) == (kind == "multicast")


def test_a_service_of_the_robot_s_own_network_is_known_by_the_robot_s_address(tmp_path: Path) -> None:
    edf = experiment(tmp_path, "services: {a: {image: x}, b: {image: x, network: host}}")
    made = documents(on_cluster("swarm", edf, {"a": "r1", "b": "r2"}), "01-stack.yml")[0]
    assert made["services"]["a"]["extra_hosts"] == ["b:192.0.2.2"]
    assert made["services"]["b"]["networks"] == {"host": {}}
    assert made["networks"]["host"] == {"external": True, "name": "host"}


def test_values_of_secrets_and_of_the_environment_are_in_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TOKEN", "canary-1")
    text = "secrets: {key: {file: key}}\nservices: {a: {image: x, secrets: [key], environment: [TOKEN]}}"
    for tool in ("swarm", "kubernetes"):
        made = on_cluster(tool, experiment(tmp_path, text, key="canary-2"), None, "env")
        assert not [path for path, content in contents(made).items() if b"canary" in content]
        assert {(one.kind, one.name) for one in made.needs} >= {("variable", "TOKEN")}
        assert [one.kind for one in made.needs].count("secret") == 1
        if tool == "swarm":
            uses = documents(made, "01-stack.yml")[0]["services"]["a"]["secrets"]
        else:
            uses = [one["secret"]["items"][0] for one in pod(made, "a")["volumes"] if "secret" in one]
        assert [use["mode"] for use in uses] == [0o400]


def test_nothing_that_others_keep_under_a_stacks_name_is_given_to_it(tmp_path: Path) -> None:
    """A Compose project `demo` of the robot's has `demo_data`, and anybody may have made a secret `demo_key`."""
    text = "secrets: {key: {env: K}}\nservices: {a: {image: x, secrets: [key], volumes: ['data:/data']}}"
    made = on_cluster("swarm", experiment(tmp_path, text))
    (one,) = documents(made, "01-stack.yml")
    assert one["volumes"] == {"data": {"name": "srprov_demo_data"}}
    assert one["secrets"] == {"key": {"external": True, "name": "srprov_demo_key"}}
    (need,) = [one for one in made.needs if one.kind == "secret"]
    assert need.name == "srprov_demo_key" and "docker secret create srprov_demo_key FILE" in need.what


@pytest.mark.parametrize(("letters", "exported"), [(52, True), (53, False)])
def test_a_secret_of_a_name_that_swarm_would_not_take_is_refused(tmp_path: Path, letters: int, exported: bool) -> None:
    text = f"secrets: {{{'k' * letters}: {{env: K}}}}\nservices: {{a: {{image: x, secrets: [{'k' * letters}]}}}}"
    edf = experiment(tmp_path, text)
    if exported:
        (need,) = [one for one in on_cluster("swarm", edf).needs if one.kind == "secret"]
        assert len(need.name) == 64
    else:
        with pytest.raises(DefinitionError) as refused:
            on_cluster("swarm", edf)
        assert "has more letters than the 64" in refused.value.problems[0].message


def test_images_are_built_under_a_name_that_changes_with_them(tmp_path: Path) -> None:
    text = "services: {a: {cdf: a.cdf}}"
    names = []
    for base in ("debian", "alpine"):
        made = on_cluster("swarm", experiment(tmp_path, text, a_dot_cdf=f"cdf: 1\nbase: {base}\n"))
        name = documents(made, "01-stack.yml")[0]["services"]["a"]["image"]
        assert f"docker build -t {name} build/a" in contents(made)["build.sh"].decode()
        names.append(name)
    assert names[0] != names[1]


@pytest.mark.parametrize("tool", ["swarm", "kubernetes"])
def test_what_is_built_has_a_name_that_no_registry_answers_for(tmp_path: Path, tool: str) -> None:
    """A node without the image takes none of who has the experiment's name on Docker Hub."""
    made = on_cluster(tool, experiment(tmp_path, "services: {a: {cdf: a.cdf}}", a_dot_cdf="cdf: 1\nbase: debian\n"))
    text = b"\n".join(contents(made).values()).decode()
    names = {*re.findall(r"image: (\S+)", text), *re.findall(r"docker build -t (\S+)", text)}
    (name,) = names
    assert parse_reference(name).domain == "srprov.invalid"


def test_an_address_that_is_needed_and_not_known_is_said(tmp_path: Path) -> None:
    from msgspec.structs import replace

    from srprov.controller import compose

    edf = experiment(tmp_path, "services: {a: {image: x}, b: {image: x, network: host}}")
    source = replace(compose.read(str(edf), frozenset(), (), placed=True), tool="swarm")
    with pytest.raises(UsageError, match="the address of r2 is not known"):
        compose.on_robots(source, source.definitions.experiment, {"a": "r1", "b": "r2"}, {})


@pytest.mark.parametrize("tool", ["swarm", "kubernetes"])
def test_a_size_of_thousands_of_digits_is_none(tmp_path: Path, tool: str) -> None:
    """Python makes no number of them."""
    edf = experiment(tmp_path, f"services: {{a: {{image: x, tmpfs: ['/t:size={'9' * 5000}']}}}}\n")
    assert not any(b"99999" in one for one in contents(on_cluster(tool, edf)).values())
