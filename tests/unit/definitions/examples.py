"""Documents that use every field, for tests that read, mutate or render them."""

from __future__ import annotations

from pathlib import Path

EDF = """\
edf: 1
name: full-house
description: Everything at once
authors: [Ada Lovelace, Grace Hopper]
license: Apache-2.0
doi: 10.1000/182
notes: Hall B, blinds closed
x-defaults: &quiet
  restart: on-failure:3
  ulimits: {nofile: 1024, memlock: {soft: -1, hard: -1}}
services:
  roscore:
    image: ros:noetic-ros-core
    command: roscore
    healthcheck: {test: [CMD, rostopic, list], interval: 1m30s, timeout: 500ms, retries: 5, start_period: 0.5s}
    ports: ["11311:11311", "127.0.0.1:9000-9001:9100-9101/udp", 80]
  talker:
    <<: *quiet
    cdf: talker.cdf
    cost: 35.5
    command: talker --name "big robot"
    environment: {ROS_DOMAIN_ID: 0644, VERBOSE: on, RATE: 1.10}
    env_file: [talker.env]
    depends_on: {roscore: {condition: service_healthy}, prepare: {condition: service_completed_successfully}}
    requires: {tags: [camera], arch: [arm64, amd64], memory: 1g, cpus: 2, kernel: 5.10, gpu: yes, disk: 8gb}
    volumes:
    - ./config:/config
    - /dev/shm:/dev/shm:ro
    - logs:/logs
    - {type: tmpfs, target: /tmp}
    - {type: volume, source: data, target: /data, read_only: true}
    devices: [/dev/video0, "/dev/ttyUSB0:/dev/lidar:rw", "/dev/null:rm"]
    cap_add: [NET_ADMIN]
    privileged: no
    sysctls: [net.ipv4.ip_forward=1]
    group_add: [video, 44]
    security_opt: [seccomp=unconfined]
    device_cgroup_rules: ["c 81:* rmw"]
    tty: true
    shm_size: 512m
    ipc: host
    pid: host
    gpus: all
    stop_signal: SIGINT
    stop_grace_period: 1m
    working_dir: /ws
    user: 1000:1000
    entrypoint: []
    pull_policy: missing
    robot: robot1
  prepare: {image: "busybox:1.36", command: [sh, -c, "true"], network: none}
  recorder: {image: "recorder:1", network: host, depends_on: [talker], cost: 0}
relations: {same_robot: [[talker, recorder]]}
weights: {cpu: 0.4, vram: 0.3, swap: 0.1, bandwidth: 0.2}
placement: {slots_per_robot: 3, fairness: 0, sticky: false, bandwidth_reference_mbit: 54}
network: {subnet: 10.77.0.0/24, mtu: 1400, vni: 4711, port: 4790, encryption: none, discovery: multicast}
"""

CDF = """\
cdf: 1
name: talker
description: Says hello
extends: base.cdf
platforms: [linux/arm64]
packages: {apt: [vim], pip: ["numpy==1.26.4"]}
files: [{src: talker.py, dest: /usr/bin/talker, mode: 0755}]
run: ["useradd -m robot"]
environment: [ROS_DOMAIN_ID=1, FROM_CDF=yes]
volumes: ["old-logs:/logs", "cache:/cache"]
requires: {tags: [arm], memory: 2g, kernel: ">=4.9"}
healthcheck: {interval: 3s}
"""

BASE = """\
cdf: 1
base: debian:bookworm
platforms: [linux/amd64]
packages: {apt: [curl, vim]}
run: apt-get clean
environment: {ROS_DOMAIN_ID: 0, FROM_BASE: "1"}
command: [sleep, infinity]
healthcheck: {test: "true", timeout: 2s}
cap_add: [SYS_NICE]
"""

INVENTORY = """\
all:
  vars: {ansible_user: robot, site: "{{ lookup('env', 'SITE') }}"}
  children:
    turtlebots:
      vars: {srprov_tags: [camera], ansible_port: 2222}
      hosts:
        robot[1:2]: {srprov_slots: 2}
"""


def write_full(folder: Path) -> Path:
    """Write the experiment with everything that it names; give the EDF's path."""
    (folder / "config").mkdir()
    (folder / "config" / "a.yaml").write_text("a: 1\n")
    (folder / "talker.py").write_text("print('hello')\n")
    (folder / "talker.env").write_text("FROM_FILE=1\nVERBOSE=off\n")
    (folder / "talker.cdf").write_text(CDF)
    (folder / "base.cdf").write_text(BASE)
    path = folder / "experiment.edf"
    path.write_text(EDF)
    return path
