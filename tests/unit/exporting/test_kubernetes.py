"""Manifests for Kubernetes: each field in its words, and what a pod has nothing for refused at its line."""

from __future__ import annotations

import os
import subprocess
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
    assert one["metadata"]["namespace"] == "demo"


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
esac
"""


def test_the_script_applies_level_by_level_and_says_what_it_misses(tmp_path: Path) -> None:
    text = (
        "services:\n  job: {image: x, job: true}\n  a: {image: x, depends_on: {job: {condition: completed}},"
        " healthcheck: {test: 'true'}}\n  b: {image: x, depends_on: {a: {condition: healthy}}}\n"
    )
    made = contents(on_cluster("kubernetes", experiment(tmp_path, text)))
    (tmp_path / "kubectl").write_text(KUBECTL)
    (tmp_path / "apply.sh").write_bytes(made["apply.sh"])
    (tmp_path / "kubectl").chmod(0o755)
    env = {"PATH": f"{tmp_path}:{os.environ['PATH']}", "LOG": str(tmp_path / "log"), "LIMIT": "0"}
    run = subprocess.run(["sh", str(tmp_path / "apply.sh")], env=env, capture_output=True, text=True, check=False)
    applied = [line for line in (tmp_path / "log").read_text().splitlines() if line.startswith("apply")]
    assert applied == ["apply -f 00-namespace.yaml", "apply -f 10-level.yaml", "apply -f 20-level.yaml"]
    assert (run.returncode, "a: not healthy after 0 s" in run.stderr) == (1, True)
