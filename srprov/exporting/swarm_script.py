"""The scripts beside a stack: one that builds its images, one that deploys it level by level and waits. Pure."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence

from srprov.definitions.model import Experiment

BUILD, DEPLOY = "build.sh", "deploy.sh"

_WHOSE = r"""
# an experiment of a stranger's may have any name: its services would take the place of another stack's
if ! services=$(docker stack services -q "$stack"); then
    echo "docker does not say whether the stack $stack is there, and whose: nothing was deployed" >&2
    exit 1
fi
for service in $services; do
    if [ "$(docker service inspect -f '{{index .Spec.Labels "srprov.instance"}}' "$service")" != "$stack" ]; then
        echo "the stack $stack is there, and no experiment of that name made it: give the experiment another name," >&2
        echo "or if it may go: docker stack rm $stack" >&2
        exit 1
    fi
done
"""
_AWAIT = r"""
# await SERVICE STATE: until its newest task says so
await() {
    waited=0
    echo "waiting for $1 to be $2"
    while :; do
        state=$(docker service ps --no-trunc --format '{{.CurrentState}}' "${stack}_$1" | head -n 1)
        case "$2 $state" in
            "running Running "* | "running Complete "* | "complete Complete "*) return 0 ;;
        esac
        if [ "$waited" -ge "$limit" ]; then
            echo "$1 is not $2 after $limit s:" >&2
            docker service ps --no-trunc "${stack}_$1" >&2
            exit 1
        fi
        sleep 1
        waited=$((waited + 1))
    done
}
"""


def build_script(images: Mapping[str, str]) -> str:
    """Return a script that builds each image: name -> its folder in build/."""
    # buildx would ask git of the folder around, which may be a stranger's, with settings that run programs
    lines = ["export BUILDX_GIT_INFO=0", "export BUILDX_GIT_LABELS=0"]
    lines += [f"docker build -t {shlex.quote(tag)} build/{shlex.quote(name)}" for tag, name in sorted(images.items())]
    return "\n".join(["#!/bin/sh", 'set -eu; cd "$(dirname "$0")"', *lines]) + "\n"


def deploy_script(experiment: Experiment, levels: Sequence[Sequence[str]]) -> str:
    """Return a script that deploys each level's file when what it needs is there."""
    lines = ["#!/bin/sh", f"# Starts {experiment.name} on a Docker Swarm; to be called on a manager."]
    lines += ['set -eu; cd "$(dirname "$0")"', f"stack={shlex.quote(experiment.name)}", 'limit="${LIMIT:-300}"']
    lines.append(_WHOSE.strip("\n"))
    if len(levels) > 1:
        lines.append(_AWAIT.rstrip("\n") + "\n")
    for number, names in enumerate(levels):
        lines += [f"await {name} {state}" for name, state in _needed(experiment, names)]
        lines.append(f'docker stack deploy --resolve-image never -c {number + 1:02}-stack.yml "$stack"')
    return "\n".join(lines) + "\n"


def _needed(experiment: Experiment, names: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield whom services wait for, with the state; a task of Swarm runs when its health check has said so."""
    found: dict[str, str] = {}
    for name in names:
        for other, condition in experiment.services[name].depends_on.items():
            if condition == "completed" or found.get(other) != "complete":
                found[other] = "complete" if condition == "completed" else "running"
    yield from sorted(found.items())
