"""Manifests for Kubernetes: each field in its words, and what a pod has nothing for refused at its line."""

from __future__ import annotations

import json
import os
import re
import subprocess
from collections.abc import Mapping
from pathlib import Path

import pytest

from srprov.errors import DefinitionError
from tests.unit.exporting.clusters import documents, on_cluster, pod, workload
from tests.unit.exporting.exports import classes, contents, experiment

FULL = """\
services:
  all:
    image: busybox:1.36
    entrypoint: [env]
    command: [sh, -c, 'echo $(date) $HOME']
    working_dir: /work
    user: "1000:1001"
    stop_grace_period: 1500ms
    healthcheck: {test: 'test -e /ok', interval: 1500ms, timeout: 2s, retries: 5, start_period: 5s}
    ports: ["127.0.0.1:8080:80", "9000:9000/udp"]
    cap_add: [SYS_NICE]
    cap_drop: [ALL]
    privileged: true
    sysctls: {net.core.somaxconn: 1024}
    group_add: ["44"]
    security_opt: ["no-new-privileges:true"]
    tty: true
    init: true
    read_only: true
    tmpfs: ["/tmp:size=64m"]
    extra_hosts: {cloud: 192.0.2.7}
    mem_limit: 256m
    cpus: 1.5
    shm_size: 64m
    pid: host
    gpus: 1
    environment: {A: "$(B)"}
    volumes: ["data:/data", "/etc/machine-id:/etc/machine-id:ro", "./www:/www", "./one.txt:/etc/one.txt"]
"""


def test_every_field_that_a_pod_has_is_said_in_its_words(tmp_path: Path) -> None:
    made = on_cluster("kubernetes", experiment(tmp_path, FULL, www__a="1", one_dot_txt="2"))
    spec = pod(made, "all")
    one = spec["containers"][0]
    assert (one["command"], one["args"]) == (["env"], ["sh", "-c", "echo $$(date) $HOME"])
    assert {"name": "A", "value": "$$(B)"} in one["env"]
    assert spec["nodeSelector"] == {"kubernetes.io/hostname": "r1"}
    assert spec["automountServiceAccountToken"] is False
    assert (spec["terminationGracePeriodSeconds"], spec["hostPID"]) == (2, True)
    assert spec["securityContext"] == {
        "runAsUser": 1000, "runAsGroup": 1001, "supplementalGroups": [44],
        "sysctls": [{"name": "net.core.somaxconn", "value": "1024"}],
    }  # fmt: skip
    assert one["securityContext"] == {
        "privileged": True, "readOnlyRootFilesystem": True, "allowPrivilegeEscalation": False,
        "capabilities": {"add": ["SYS_NICE"], "drop": ["ALL"]},
    }  # fmt: skip
    assert one["startupProbe"] == {
        "exec": {"command": ["/bin/sh", "-c", "test -e /ok"]},
        "periodSeconds": 2, "timeoutSeconds": 2, "failureThreshold": 8,
    }  # fmt: skip
    assert one["readinessProbe"]["failureThreshold"] == 5
    assert one["resources"]["limits"] == {"cpu": "1.5", "memory": str(256 << 20), "nvidia.com/gpu": "1"}
    assert one["resources"]["requests"] == {"cpu": "0", "memory": "0"}
    assert one["ports"][0] == {"containerPort": 80, "hostPort": 8080, "hostIP": "127.0.0.1", "protocol": "TCP"}
    at = {mount["mountPath"]: mount for mount in one["volumeMounts"]}
    by_name = {volume["name"]: volume for volume in spec["volumes"]}
    assert by_name[at["/data"]["name"]]["hostPath"]["path"] == "/var/lib/srprov-kubernetes/demo/data"
    assert by_name[at["/tmp"]["name"]]["emptyDir"] == {"medium": "Memory", "sizeLimit": "64Mi"}
    assert at["/etc/one.txt"]["subPath"] == "one.txt"
    assert by_name[at["/www"]["name"]]["configMap"]["items"] == [{"key": "file-0", "path": "a", "mode": 0o644}]
    maps = [one for one in documents(made, "00-namespace.yaml") if one["kind"] == "ConfigMap"]
    assert sorted(one["data"]["file-0"] for one in maps if len(one["data"]) == 1) == ["1", "2"]


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("devices", "[/dev/ttyUSB0]"),
        ("ulimits", "{nofile: 5}"),
        ("oom_score_adj", "-5"),
        ("cpuset", '"0"'),
        ("pids_limit", "7"),
        ("user", "ros"),
        pytest.param("user", f"'{'9' * 5000}'", id="user-digits"),
        pytest.param("user", f"'1:{'9' * 5000}'", id="group-digits"),
        pytest.param("group_add", f"['{'9' * 5000}']", id="group_add-digits"),
        ("group_add", "[video]"),
        ("security_opt", '["apparmor=x"]'),
        ("gpus", "all"),
        ("network", "both"),
        ("entrypoint", "[]"),
        ("healthcheck", "{}"),
        ("extra_hosts", "{base: host-gateway}"),
        ("volumes", '["~pi/x:/x"]'),
    ],
)
def test_what_a_pod_has_nothing_for_is_refused_at_its_line_or_left_out(tmp_path: Path, field: str, value: str) -> None:
    edf = experiment(tmp_path, f"services:\n  a:\n    image: x\n    {field}: {value}\n")
    with pytest.raises(DefinitionError) as refused:
        on_cluster("kubernetes", edf)
    assert [(one.location.line, one.path) for one in refused.value.problems] == [(6, f"services.a.{field}")]
    assert classes(on_cluster("kubernetes", edf, lossy=True))[f"services.a.{field}"] == "dropped"


@pytest.mark.parametrize(
    ("fields", "kind", "restart", "backoff"),
    [
        ("", "Pod", "Never", None),
        (", restart: on-failure", "Pod", "OnFailure", None),
        (", restart: always", "Deployment", "Always", None),
        (", restart: unless-stopped", "Deployment", "Always", None),
        (", job: true", "Job", "Never", 0),
        (", job: true, restart: 'on-failure:3'", "Job", "OnFailure", 3),
    ],
)
def test_the_restart_policy_decides_the_kind(
    tmp_path: Path, fields: str, kind: str, restart: str, backoff: int | None
) -> None:
    made = on_cluster("kubernetes", experiment(tmp_path, f"services: {{a: {{image: x{fields}}}}}"))
    one = workload(made, "a")
    assert (one["kind"], pod(made, "a")["restartPolicy"]) == (kind, restart)
    assert one["spec"].get("backoffLimit") == backoff
    assert one["metadata"]["namespace"] == "srprov-demo"


def test_encryption_and_names_that_are_no_labels_are_refused(tmp_path: Path) -> None:
    for text, path in (
        ("network: {encryption: wireguard}\nservices: {a: {image: x}}", "network.encryption"),
        ("services: {a_b: {image: x}}", "services.a_b"),
    ):
        with pytest.raises(DefinitionError) as refused:
            on_cluster("kubernetes", experiment(tmp_path, text))
        assert [one.path for one in refused.value.problems] == [path]
    on_cluster("kubernetes", experiment(tmp_path, "network: {encryption: none}\nservices: {a: {image: x}}"))


def test_policies_keep_others_out_and_published_ports_open(tmp_path: Path) -> None:
    text = "services: {a: {image: x, ports: ['8080:80']}, b: {image: x, network: none}}"
    made = documents(on_cluster("kubernetes", experiment(tmp_path, text)), "00-namespace.yaml")
    rules = {one["metadata"]["name"]: one["spec"] for one in made if one["kind"] == "NetworkPolicy"}
    assert rules["inside-only"]["ingress"] == [{"from": [{"podSelector": {}}]}]
    assert rules["inside-only"]["podSelector"]["matchExpressions"][0]["operator"] == "NotIn"
    assert rules["ports-a"]["ingress"] == [{"ports": [{"protocol": "TCP", "port": 80}]}]
    assert rules["no-network"]["policyTypes"] == ["Ingress", "Egress"]
    assert [one["metadata"]["name"] for one in made if one["kind"] == "Service"] == ["a"]


def test_policies_of_services_with_long_names_have_names_of_their_own(tmp_path: Path) -> None:
    for names in (("a" * 57 + "1", "a" * 57 + "2"), ("a" * 56 + "-1", "a" * 56 + "-2"), ("a" * 57, "a" * 63)):
        text = "services:\n" + "".join(f"  {name}: {{image: x, ports: ['80:80']}}\n" for name in names)
        made = documents(on_cluster("kubernetes", experiment(tmp_path, text)), "00-namespace.yaml")
        ports = [one for one in made if one["kind"] == "NetworkPolicy" and "ports" in one["spec"]["ingress"][0]]
        chosen = {one["metadata"]["name"]: one["spec"]["podSelector"]["matchLabels"]["srprov.service"] for one in ports}
        assert sorted(chosen.values()) == sorted(names)
        assert all(re.fullmatch("[a-z0-9][a-z0-9-]{0,61}[a-z0-9]", name) for name in chosen)


def test_replicas_are_pods_with_a_service_for_all_of_them(tmp_path: Path) -> None:
    edf = experiment(tmp_path, "services: {a: {image: x, replicas: 2}}")
    made = documents(on_cluster("kubernetes", edf, {"a-1": "r1", "a-2": "r2"}), "00-namespace.yaml")
    found = {one["metadata"]["name"]: one["spec"]["selector"] for one in made if one["kind"] == "Service"}
    assert found == {
        "a": {"srprov.of": "a"}, "a-1": {"srprov.service": "a-1"}, "a-2": {"srprov.service": "a-2"},
    }  # fmt: skip


def test_binary_files_keep_their_bytes_and_large_ones_are_refused(tmp_path: Path) -> None:
    edf = experiment(tmp_path, "services: {a: {image: x, volumes: [./f:/f]}}")
    (tmp_path / "f").write_bytes(b"\xff\x00")
    made = documents(on_cluster("kubernetes", edf), "00-namespace.yaml")
    assert [one["binaryData"] for one in made if "binaryData" in one] == [{"file-0": "/wA="}]
    (tmp_path / "f").write_bytes(b"x" * 1_000_001)
    with pytest.raises(DefinitionError) as refused:
        on_cluster("kubernetes", edf)
    assert "larger than the 1000 kB" in refused.value.problems[0].message


KUBECTL = """\
#!/bin/sh
echo "$*" >>"$LOG"
case "$*" in
    "get pods"*srprov.service=job*) echo "Failed False"; echo "Succeeded False" ;;
    "get pods"*) echo "Running False" ;;
    "get namespace"*)
        case $ASKED in
            fails) echo "Error from server (Forbidden): namespaces" >&2; exit 1 ;;
            absent) case $* in *" --ignore-not-found "*) ;; *) exit 1 ;; esac ;;
            *) printf 'srprov-demo %s' "$WHOSE" ;;
        esac ;;
esac
"""


def apply(
    folder: Path, script: bytes, whose: str = "", asked: str = "absent"
) -> tuple[subprocess.CompletedProcess[str], list[str]]:
    """Run a script; return it and what it applied.

    The namespace is `absent`, or `there` and that of `whose`; or asking for it `fails`.
    """
    (folder / "kubectl").write_text(KUBECTL)
    (folder / "apply.sh").write_bytes(script)
    (folder / "kubectl").chmod(0o755)
    (folder / "log").write_text("")
    env = {"PATH": f"{folder}:{os.environ['PATH']}", "LOG": str(folder / "log"), "LIMIT": "0"}
    env |= {"WHOSE": whose, "ASKED": asked}
    run = subprocess.run(["sh", str(folder / "apply.sh")], env=env, capture_output=True, text=True, check=False)
    return run, [line for line in (folder / "log").read_text().splitlines() if line.startswith("apply")]


def test_a_namespace_of_somebody_else_is_left_alone(tmp_path: Path) -> None:
    """An experiment that is called as it would close it to others, and its end would be `kubectl delete namespace`."""
    script = contents(on_cluster("kubernetes", experiment(tmp_path, "services: {a: {image: x}}")))["apply.sh"]
    for whose in ("", "another"):
        run, applied = apply(tmp_path, script, whose, "there")
        assert (run.returncode, applied) == (1, []) and "the namespace srprov-demo is there" in run.stderr
    for asked in ("absent", "there"):
        run, applied = apply(tmp_path, script, "demo", asked)
        assert (run.returncode, applied) == (0, ["apply -f 00-namespace.yaml", "apply -f 10-level.yaml"])


def test_who_cannot_ask_for_the_namespace_applies_nothing(tmp_path: Path) -> None:
    """No rights, or no way to the cluster: the namespace may be somebody else's."""
    script = contents(on_cluster("kubernetes", experiment(tmp_path, "services: {a: {image: x}}")))["apply.sh"]
    run, applied = apply(tmp_path, script, "demo", "fails")
    assert (run.returncode, applied) == (1, [])
    assert "Forbidden" in run.stderr and "does not say whether the namespace srprov-demo is there" in run.stderr


@pytest.mark.parametrize("name", ["com", "default", "kube-system"])
def test_no_namespace_has_a_name_that_others_look_for(tmp_path: Path, name: str) -> None:
    """`github.com` is looked for as the Service `github` of a namespace `com` first, by pods of the whole cluster."""
    text = "secrets: {s: {env: S}}\nservices: {github: {image: x, secrets: [s], environment: [V], ports: ['8080:80']}}"
    edf = experiment(tmp_path, text)
    edf.write_text(edf.read_text().replace("name: demo", f"name: {name}"))
    made = on_cluster("kubernetes", edf, None, "env")
    every = [one for file in ("00-namespace.yaml", "10-level.yaml") for one in documents(made, file)]
    assert {one["metadata"].get("namespace", one["metadata"]["name"]) for one in every} == {f"srprov-{name}"}
    assert {f"-n srprov-{name} " in one.what for one in made.needs} == {True}
    assert f"kubectl delete namespace srprov-{name}`" in contents(made)["README.md"].decode()


def test_nodes_that_keep_volumes_are_closed_to_their_users_first(tmp_path: Path) -> None:
    """A pod's root can leave a program there that is root's whoever starts it."""
    text = "services: {a: {image: x, volumes: ['data:/data']}, b: {image: x, volumes: ['/srv:/srv']}}"
    on = {"a": "r1", "b": "r2"}
    told = contents(on_cluster("kubernetes", experiment(tmp_path, text), on))["README.md"].decode()
    first, _, rest = told.partition("\n    install -d -m 0700 -o root -g root /var/lib/srprov-kubernetes\n")
    assert first.endswith("First, as root on r1:\n") and "    ./apply.sh" in rest
    plainly = experiment(tmp_path, text.replace("data:/data", "/data:/data"))
    assert "install -d" not in contents(on_cluster("kubernetes", plainly, on))["README.md"].decode()


def expanded(text: str, known: Mapping[str, str]) -> str:
    """Return what Kubernetes makes of a text, by its own rules.

    Source: k8s.io/kubernetes/third_party/forked/golang/expansion/expand.go.
    """

    def one(match: re.Match[str]) -> str:
        return "$" if match[0] == "$$" else known.get(match[1], match[0])

    return re.sub(r"\$\$|\$\(([^)]*)\)", one, text)


@pytest.mark.parametrize("text", ["$(A)", "$$(A)", "$$$(A)", "$$", "$", "a$$b", "$A $$(A)$$$", "$(A", "$)$($"])
def test_a_text_is_the_same_in_a_pod(tmp_path: Path, text: str) -> None:
    """In commands, in values, and in probes, in which the kubelet replaces variables too."""
    edf = experiment(tmp_path, "services: {a: {image: x, command: [COMMAND], environment: {V: COMMAND}}}")
    words = json.dumps(text)
    check = f"healthcheck: {{test: [CMD, {words}]}}"
    edf.write_text(edf.read_text().replace("COMMAND", words).replace("image: x", f"image: x, {check}"))
    one = pod(on_cluster("kubernetes", edf), "a")["containers"][0]
    value = next(each["value"] for each in one["env"] if each["name"] == "V")
    for shown in (*one["args"], value, *one["readinessProbe"]["exec"]["command"]):
        assert expanded(shown, {"A": "other"}) == text


def test_a_variable_s_name_is_one_word_of_the_command_that_is_told(tmp_path: Path) -> None:
    """A stranger chose it, and the command is there to be copied into a shell."""
    edf = experiment(tmp_path, "services: {a: {image: x, environment: ['A;touch${IFS}x;']}}")
    made = on_cluster("kubernetes", edf, None, "env")
    said = next(one.what for one in made.needs if one.kind == "variable")
    assert "--from-literal='A;touch${IFS}x;'=…" in said


def test_the_script_applies_level_by_level_and_says_what_it_misses(tmp_path: Path) -> None:
    text = (
        "services:\n  job: {image: x, job: true}\n  a: {image: x, depends_on: {job: {condition: completed}},"
        " healthcheck: {test: 'true'}}\n  b: {image: x, depends_on: {a: {condition: healthy}}}\n"
    )
    made = contents(on_cluster("kubernetes", experiment(tmp_path, text)))
    run, applied = apply(tmp_path, made["apply.sh"])
    assert applied == ["apply -f 00-namespace.yaml", "apply -f 10-level.yaml", "apply -f 20-level.yaml"]
    assert (run.returncode, "a: not healthy after 0 s" in run.stderr) == (1, True)
