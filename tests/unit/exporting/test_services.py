"""Services in Compose's words: every field, and what its report says."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator

from srprov import data
from srprov.errors import RefusedError, UsageError
from srprov.exporting.report import report_json
from srprov.image_reference import parse_reference
from tests.unit.exporting.clusters import documents, on_cluster
from tests.unit.exporting.exports import classes, contents, document, experiment, notes, twin

EVERYTHING = """\
services:
  all:
    image: busybox:1.36
    command: [sh, -c, 'echo "$HOME" $$']
    entrypoint: []
    working_dir: /work
    user: "1000:1000"
    stop_signal: SIGINT
    stop_grace_period: 1m30s
    healthcheck: {test: 'test -e /ok', interval: 1500ms, timeout: 2s, retries: 5, start_period: 1s}
    devices: ["/dev/ttyUSB0:/dev/lidar:rw"]
    ports: ["127.0.0.1:8080:80", "9000-9001:9000-9001/udp"]
    expose: ["5000"]
    ulimits: {nofile: {soft: 1024, hard: 2048}, rtprio: 98}
    cap_add: [SYS_NICE]
    cap_drop: [MKNOD]
    privileged: true
    sysctls: {net.core.somaxconn: 1024}
    group_add: [video]
    security_opt: ["no-new-privileges:true"]
    device_cgroup_rules: ["c 188:* rwm"]
    tty: true
    stdin_open: true
    init: false
    read_only: true
    tmpfs: ["/tmp:size=64m"]
    hostname: rover
    extra_hosts: {cloud: 192.0.2.7, base: host-gateway}
    labels: {who: "a$b"}
    logging: {driver: json-file, options: {max-size: 1m}}
    mem_limit: 256m
    mem_reservation: 128m
    oom_score_adj: -100
    cpus: 1.5
    cpuset: 0-1
    pids_limit: 100
    shm_size: 64m
    ipc: shareable
    pid: host
    gpus: all
    runtime: nvidia
    restart: on-failure:3
    pull_policy: always
    environment: {A: "010", B: "yes", C: "$x"}
    volumes: ["data:/data", "/etc/machine-id:/etc/machine-id:ro", {type: tmpfs, target: /t, tmpfs: {size: 1m}}]
"""


def test_every_run_time_field_has_compose_s_form(tmp_path: Path) -> None:
    made = document(twin(experiment(tmp_path, EVERYTHING)))
    one = made["services"]["all"]
    assert one["command"] == ["sh", "-c", 'echo "$$HOME" $$$$']
    assert one["entrypoint"] == []
    assert (one["working_dir"], one["user"], one["stop_signal"]) == ("/work", "1000:1000", "SIGINT")
    assert one["stop_grace_period"] == "90s"
    assert one["healthcheck"] == {
        "test": ["CMD-SHELL", "test -e /ok"], "interval": "1500ms", "timeout": "2s", "retries": 5, "start_period": "1s"
    }  # fmt: skip
    assert one["devices"] == ["/dev/ttyUSB0:/dev/lidar:rw"]
    assert one["ports"][0] == {"target": 80, "published": "8080", "host_ip": "127.0.0.1", "protocol": "tcp"}
    assert [port["published"] for port in one["ports"][1:]] == ["9000", "9001"]
    assert one["expose"] == ["5000/tcp"]
    assert one["ulimits"] == {"nofile": {"soft": 1024, "hard": 2048}, "rtprio": {"soft": 98, "hard": 98}}
    assert (one["cap_add"], one["cap_drop"], one["privileged"]) == (["SYS_NICE"], ["MKNOD"], True)
    assert one["sysctls"] == {"net.core.somaxconn": "1024"}
    assert (one["tty"], one["stdin_open"], one["init"], one["read_only"]) == (True, True, False, True)
    assert one["tmpfs"] == ["/t:size=1048576", "/tmp:size=64m"]
    assert one["hostname"] == "rover"
    assert one["networks"] == {"default": {"aliases": ["rover"]}}
    assert one["extra_hosts"] == ["base=host-gateway", "cloud=192.0.2.7"]
    assert one["labels"] == {"who": "a$$b"}
    assert one["logging"] == {"driver": "json-file", "options": {"max-size": "1m"}}
    assert (one["mem_limit"], one["memswap_limit"], one["mem_reservation"]) == (2**28, 2**28, 2**27)
    assert (one["oom_score_adj"], one["cpus"], one["cpuset"], one["pids_limit"]) == (-100, 1.5, "0-1", 100)
    assert (one["shm_size"], one["ipc"], one["pid"], one["runtime"]) == (2**26, "shareable", "host", "nvidia")
    devices = one["deploy"]["resources"]["reservations"]["devices"]
    assert devices == [{"count": "all", "capabilities": ["gpu"]}]
    assert (one["restart"], one["pull_policy"]) == ("on-failure:3", "always")
    assert one["environment"] == {"A": "010", "B": "yes", "C": "$$x"}
    assert {"type": "volume", "source": "data", "target": "/data", "volume": {"nocopy": True}} in one["volumes"]
    assert made["volumes"] == {"data": {}}


def test_nothing_that_compose_knows_by_another_projects_name_is_given_to_it(tmp_path: Path) -> None:
    """A project `demo` has the image `demo-a` and the volume `demo_data`, which Compose takes as they are."""
    made = twin(
        experiment(tmp_path, "services: {a: {cdf: a.cdf, volumes: ['data:/v']}}", a_dot_cdf="cdf: 1\nbase: x\n")
    )
    written = document(made)
    assert (written["name"], written["volumes"]) == ("srprov-demo", {"data": {}})
    assert written["services"]["a"]["build"] == {"context": "./build/a"}


def test_no_project_has_the_image_of_another_experiment_s_service(tmp_path: Path) -> None:
    """Compose's own name of both was `srprov-nav-planner-db`: it built none for the second, and ran the first one's."""
    images = []
    for name, service in (("nav", "planner-db"), ("nav-planner", "db")):
        (tmp_path / name).mkdir()
        text = f"services: {{{service}: {{cdf: db.cdf}}}}"
        edf = experiment(tmp_path / name, text, db_dot_cdf=f"cdf: 1\nbase: x\nrun: echo {name}\n")
        edf.write_text(edf.read_text().replace("name: demo", f"name: {name}"))
        images.append(document(twin(edf))["services"][service]["image"].rpartition(":"))
    assert [one[0] for one in images] == ["srprov.invalid/nav/planner-db", "srprov.invalid/nav-planner/db"]
    assert len({one[2] for one in images}) == 2  # another state of an experiment is built anew, too


def test_services_of_one_cdf_build_an_image_each(tmp_path: Path) -> None:
    """Compose builds both at once: with containerd's store one of them failed, as the other one's name was there."""
    text = "services: {talker: {cdf: a.cdf}, listener: {cdf: a.cdf}}"
    services = document(twin(experiment(tmp_path, text, a_dot_cdf="cdf: 1\nbase: x\n")))["services"].values()
    assert {one["build"]["context"] for one in services} == {"./build/a"}
    assert len({one["image"] for one in services}) == 2


def test_an_image_has_a_name_that_docker_takes_whatever_the_experiment_and_the_service_are_called(
    tmp_path: Path,
) -> None:
    names = set()
    for name in ("nav-", "nav", "nav--"):
        edf = experiment(tmp_path, "services: {a___b: {cdf: a.cdf}, a-b: {cdf: a.cdf}}", a_dot_cdf="cdf: 1\nbase: x\n")
        edf.write_text(edf.read_text().replace("name: demo", f"name: '{name}'"))
        names |= {one["image"] for one in document(twin(edf))["services"].values()}
    assert len(names) == 6
    assert {parse_reference(one).domain for one in names} == {"srprov.invalid"}


def test_only_what_is_not_the_default_is_written(tmp_path: Path) -> None:
    made = document(twin(experiment(tmp_path, "services: {a: {image: busybox}}")))
    assert made == {"name": "srprov-demo", "services": {"a": {"image": "busybox", "hostname": "a"}}}


def test_the_report_has_each_field_once_with_its_line(tmp_path: Path) -> None:
    edf = experiment(
        tmp_path, EVERYTHING + "    x-mine: 1\npools: [{services: [all], name: p}]\n".replace("pools", "x-pools")
    )
    made = report_json(twin(edf))
    assert list(Draft202012Validator(data.schema("export")).iter_errors(made)) == []
    names = [one["field"] for one in made["fields"]]
    assert len(names) == len(set(names))
    lines = edf.read_text().splitlines()
    for one in made["fields"]:
        key = one["field"].rpartition(".")[2]
        if key != "network":  # it has its default, and stands at the service
            assert lines[one["line"] - 1].lstrip("- {").startswith(key), one
    assert classes(twin(edf))["services.all.x-mine"] == "dropped"
    assert made["counts"]["refused"] == 0
    assert sum(made["counts"].values()) == len(names)


def test_variables_of_the_controller_are_named_and_never_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TOKEN", "hunter2-canary")
    text = "services:\n  a: {image: busybox, environment: [TOKEN, NOT_SET, B=1], env_file: a.env}\n  b: {cdf: b.cdf}\n"
    made = twin(
        experiment(
            tmp_path, text, a_dot_env="TOKEN\nOTHER\nC='x y'\nD=it's\n",
            b_dot_cdf="cdf: 1\nbase: debian\nenvironment: [TOKEN]\nrun: echo $TOKEN\n",
        )
    )  # fmt: skip
    assert b"canary" not in b"".join(contents(made).values())
    one = document(made)["services"]["a"]
    assert one["environment"] == {"TOKEN": None, "NOT_SET": None, "OTHER": None, "B": "1", "D": "it's"}
    assert one["env_file"] == ["./env/a.env"]
    assert contents(made)["env/a.env"] == b"C='x y'\n"
    assert document(made)["services"]["b"]["build"] == {"context": "./build/b", "args": ["TOKEN"]}
    lines = contents(made)["build/b/Dockerfile"].decode().splitlines()
    assert lines[:3] == ["FROM debian:latest", "ARG TOKEN", 'ENV TOKEN="${TOKEN}"']
    assert "TOKEN is taken from the environment" in notes(made)["services.a.environment"]


def test_no_reader_puts_a_variable_of_its_user_s_into_a_container(tmp_path: Path) -> None:
    """podman-compose does, for `${NAME}` in an env_file: a stranger's container had any of those that he could name."""
    text = "services:\n  a: {image: busybox, env_file: a.env}\n"
    files = "A='${AWS_SECRET_ACCESS_KEY}'\nB=${TOKEN:-x}\nC='$HOME'\nD=\"a $ b\"\nE='c d'\n"
    made = twin(experiment(tmp_path, text, a_dot_env=files))
    assert contents(made)["env/a.env"] == b"E='c d'\n"
    told = {"A": "${AWS_SECRET_ACCESS_KEY}", "B": "${TOKEN:-x}", "C": "$HOME", "D": "a $ b"}
    written = {name: value.replace("$", "$$") for name, value in told.items()}
    assert document(made)["services"]["a"]["environment"] == written


def test_what_the_edf_says_wins_over_its_env_files(tmp_path: Path) -> None:
    text = "services:\n  a: {image: busybox, env_file: [one.env, two.env], environment: {B: own, D: same}}\n"
    edf = experiment(tmp_path, text, one_dot_env="A=1\nB=2\nC=3\nD=same\n", two_dot_env="C=4\n")
    assert document(twin(edf))["services"]["a"]["environment"] == {"B": "own"}
    assert contents(twin(edf))["env/a.env"] == b"A='1'\nC='4'\nD='same'\n"


def test_secrets_are_places_and_never_values(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("API_KEY", "canary-one")
    text = (
        "secrets: {key: {env: API_KEY}, cert: {file: cert.pem}, made: {command: [sh, -c, echo canary-three]}}\n"
        "services:\n  a:\n    image: x\n    secrets: [key, {source: cert, target: /etc/cert, mode: '0444'}, made]\n"
    )
    made = twin(experiment(tmp_path, text, cert_dot_pem="canary-two"))
    everything = b"".join(contents(made).values())
    assert b"canary-one" not in everything
    assert b"canary-two" not in everything
    one = document(made)
    assert one["secrets"] == {
        "key": {"environment": "API_KEY"}, "cert": {"file": "./secrets/cert"}, "made": {"file": "./secrets/made"}
    }  # fmt: skip
    assert one["services"]["a"]["secrets"][1] == {"source": "cert", "target": "/etc/cert", "mode": "0444"}
    given = {(need.kind, need.name) for need in made.needs}
    assert given == {("variable", "API_KEY"), ("file", "secrets/cert"), ("file", "secrets/made")}
    assert all(name in contents(made)["README.md"].decode() for _, name in given)
    assert "secrets/cert" not in contents(made)


def test_an_image_fills_no_volume_of_an_export(tmp_path: Path) -> None:
    """An engine fills an empty one from the image, for who reads it alone, too; and while another container runs.

    That one leads the engine elsewhere by links in the place of folders still to come: one of another service, or the
    one of the same service that was there before, as Compose and Swarm make the next one while it runs.
    """
    edf = experiment(
        tmp_path,
        "services: {a: {image: x, volumes: ['ws:/ws:ro', 'own:/own', 'all:/a']}, b: {image: x, volumes: ['all:/b']}}",
    )
    made, cluster = twin(edf), on_cluster("swarm", edf)
    (stack,) = documents(cluster, "01-stack.yml")
    for one in (document(made), stack):
        mounts = [mount for service in one["services"].values() for mount in service["volumes"]]
        assert len(mounts) == 4 and all(mount["volume"] == {"nocopy": True} for mount in mounts)
    told = [field for field in made.fields if "it begins empty" in field.words]
    assert {field.name for field in told} == {"services.a.volumes", "services.b.volumes"}
    assert "docker compose down" in contents(made)["README.md"].decode()


def test_no_builder_asks_git_of_the_folder_around_an_export(tmp_path: Path) -> None:
    """It may be a stranger's repository, with settings that run programs; buildx asks unless it is told."""
    edf = experiment(tmp_path, "services: {a: {cdf: a.cdf}}", a_dot_cdf="cdf: 1\nbase: busybox\n")
    readme = contents(twin(edf))["README.md"].decode()
    assert readme.count("docker compose up") == readme.count("BUILDX_GIT_INFO=0 docker compose up") == 1
    script = contents(on_cluster("swarm", edf))["build.sh"].decode()
    assert "export BUILDX_GIT_INFO=0" in script.partition("docker build")[0]


def test_shipped_files_seeds_and_homes(tmp_path: Path) -> None:
    text = (
        "volumes: {maps: {seed: ./maps, user: '1000:1000'}}\n"
        "services:\n"
        "  a: {image: busybox, volumes: [./www:/www:ro, maps:/maps, '~robot/logs:/logs', ./www/a.txt:/a]}\n"
        "  b: {image: busybox, volumes: [./www:/other], data: [{path: big.bin, target: /big}]}\n"
    )
    files = {"www__a_dot_txt": "hello", "www__sub__b_dot_txt": "b", "maps__m_dot_pgm": "P5", "big_dot_bin": "0" * 100}
    edf = experiment(tmp_path, text, **files)
    (tmp_path / "www" / "empty").mkdir()
    (tmp_path / "www" / "run.sh").write_text("#!/bin/sh\n")
    (tmp_path / "www" / "run.sh").chmod(0o755)
    (tmp_path / "www" / "link").symlink_to("a.txt")
    made = twin(edf, "host-path")
    a = document(made)["services"]["a"]["volumes"]
    assert [(one["source"], one["target"], one.get("read_only", False)) for one in a] == [
        ("./files/www", "/www", True), ("./volumes/maps", "/maps", False),
        ("${HOME_OF_ROBOT:-/home/robot}/logs", "/logs", False), ("./files/www/a.txt", "/a", True),
    ]  # fmt: skip
    assert all(one["bind"] == {"create_host_path": False} for one in a)
    assert contents(made)["volumes/maps/m.pgm"] == b"P5"
    assert contents(made)["files/www/sub/b.txt"] == b"b"
    by_path = {file.path: file for file in made.files}
    assert by_path["files/www/empty"].is_folder
    assert by_path["files/www/run.sh"].mode == 0o755
    assert by_path["files/www/link"].link == "a.txt"
    assert document(made)["services"]["b"]["volumes"][1]["source"] == "./files/big.bin"
    assert ("file", "volumes/maps") in {(need.kind, need.name) for need in made.needs}
    assert classes(made)["services.a.volumes"] == "adapted"
    assert classes(made)["services.b.volumes"] == "exact"


def test_files_from_elsewhere_need_a_permission(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "Dockerfile").write_text("FROM busybox\nCOPY x /x\n")
    (tmp_path / "other" / "x").write_text("1")
    edf = experiment(tmp_path / "here", "services: {a: {cdf: ../other/Dockerfile}}")
    with pytest.raises(RefusedError, match="outside"):
        twin(edf)
    assert contents(twin(edf, "outside"))["build/other/x"] == b"1"


def test_what_apply_would_ask_for_is_told_since_compose_asks_nobody(tmp_path: Path) -> None:
    """Whoever starts a stranger's export on his own PC gives it all that, and no `--allow` is in the way."""
    text = "services: {a: {image: x, privileged: true, volumes: ['/:/host']}, b: {image: y, environment: [HOME]}}"
    made = twin(experiment(tmp_path, text))
    told = [note for note in made.notes if "Compose asks nobody" in note]
    assert len(told) == 2 and "a gets" in told[0] and "privileged" in told[0] and "docker-socket (/" in told[1], told
    readme = contents(made)["README.md"].decode()
    assert readme.count("Compose asks nobody") == 2


def test_a_data_set_to_download_is_named(tmp_path: Path) -> None:
    """What is in its address is one word of the command: `&` would end it, and run what stands behind."""
    sha, url = "ab" * 32, "https://x.example/d.bag?a&./run$IFS`x`"
    text = f"services: {{a: {{image: x, data: [{{url: '{url}', sha256: {sha}, target: /d}}]}}}}"
    made = twin(experiment(tmp_path, text))
    need = made.needs[0]
    assert document(made)["services"]["a"]["volumes"][0]["source"] == f"./{need.name}"
    assert need.what == f"Download it; its sha256 is {sha}." and shlex.split(need.command)[-2:] == [need.name, url]
    readme = contents(made)["README.md"].decode()
    assert f"\n\n      {need.command}\n\n" in readme and readme.count("x.example") == 1


def test_images_are_folders_to_build(tmp_path: Path) -> None:
    text = (
        "services: {a: {cdf: a.cdf}, b: {cdf: sub/Dockerfile}, c: {cdf: c.cdf}, d: {cdf: a.cdf, environment: {X: 1}}}"
    )
    files = {
        "a_dot_cdf": "cdf: 1\nname: tool\nbase: debian\npackages: {apt: [curl]}\nfiles: [{src: t.py, dest: /t.py}]\n",
        "t_dot_py": "print(1)",
        "sub__Dockerfile": "ARG V=1\nFROM busybox AS one\nCOPY x /x\nFROM one\n",
        "sub__x": "x",
        "c_dot_cdf": "cdf: 1\ndockerfile: {context: sub, args: {V: 2}, target: one}\nplatforms: [linux/amd64]\n",
    }
    made = twin(experiment(tmp_path, text, **files))
    services = document(made)["services"]
    assert services["a"]["build"] == services["d"]["build"] == {"context": "./build/tool"}
    assert services["a"]["init"] is True
    dockerfile = contents(made)["build/tool/Dockerfile"].decode()
    assert "curl" in dockerfile
    assert "srprov" not in dockerfile
    assert contents(made)["build/tool/files/0"] == b"print(1)"
    own = services["b"]["build"]["context"].removeprefix("./")
    assert contents(made)[f"{own}/Dockerfile"] == files["sub__Dockerfile"].encode()
    assert contents(made)[f"{own}/x"] == b"x"
    assert services["c"]["build"] == {"context": "./build/c"}
    assert contents(made)["build/c/Dockerfile"] == b'ARG V="2"\nFROM busybox AS one\nCOPY x /x\n'
    assert services["c"]["platform"] == "linux/amd64"


def test_profiles_replicas_and_jobs(tmp_path: Path) -> None:
    text = (
        "services:\n"
        "  a: {image: busybox, replicas: 2, volumes: [v:/v]}\n"
        "  b: {image: busybox, profiles: [debug], depends_on: {a: {condition: started}}}\n"
        "  c: {image: busybox, job: true}\n"
        "  d: {image: busybox, depends_on: {c: {condition: completed}}, per_robot: {tags: [arm]}}\n"
    )
    edf = experiment(tmp_path, text)
    made = document(twin(edf))["services"]
    assert sorted(made) == ["a-1", "a-2", "b", "c", "d"]
    assert made["a-1"]["networks"] == {"default": {"aliases": ["a"]}}
    assert made["b"]["profiles"] == ["debug"]
    assert made["b"]["depends_on"] == {
        "a-1": {"condition": "service_started"}, "a-2": {"condition": "service_started"}
    }  # fmt: skip
    assert made["d"]["depends_on"] == {"c": {"condition": "service_completed_successfully"}}
    chosen = document(twin(edf, profiles=("debug",)))["services"]
    assert "profiles" not in chosen["b"]
    with pytest.raises(UsageError, match="no service has the profile"):
        twin(edf, profiles=("nothing",))


def test_no_word_of_the_experiment_leaves_its_place(tmp_path: Path) -> None:
    """In the README it is no Markdown and no other line, in the Compose file no key; and no path of this machine."""
    evil = "x\n# Evil <script>|\n`rm`\u2028\u202e\r\nservices:"
    text = f"description: {json.dumps(evil)}\nnotes: {json.dumps(evil)}\nservices: {{a: {{image: x, job: true}}}}\n"
    made = twin(experiment(tmp_path, text))
    readme = contents(made)["README.md"].decode()
    assert [line for line in readme.splitlines() if line.startswith("#")] == [
        "# demo", "## Start", "## What is not as in the experiment"
    ]  # fmt: skip
    assert "<script" not in readme.replace("\\<", "")
    assert "\u202e" not in readme
    assert "`demo.edf:1`" in readme
    assert list(document(made)) == ["name", "services"]
    assert str(tmp_path) not in b"".join(contents(made).values()).decode()


def test_names_that_look_like_extensions_stay_names(tmp_path: Path) -> None:
    """Compose takes `x-…` in a map of variables or labels for an extension, and loses it."""
    text = (
        "services:\n"
        "  x-cam: {image: x, environment: {x-a: '1', B: $2}, labels: {x-l: ''}, cost: 1}\n"
        "  b: {image: x, environment: [x-open], depends_on: [x-cam], x-mine: 1}\n"
    )
    made = twin(experiment(tmp_path, text))
    services = document(made)["services"]
    assert services["x-cam"]["environment"] == ["B=$$2", "x-a=1"]
    assert services["x-cam"]["labels"] == ["x-l="]
    assert services["b"]["environment"] == ["x-open"]
    assert classes(made)["services.x-cam.cost"] == "dropped"
    assert notes(made)["services.b.x-mine"] == "an extension of the file's own"
