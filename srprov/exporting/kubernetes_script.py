"""The scripts beside manifests: one that builds images, one that applies level by level and waits. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from srprov.definitions.model import Experiment
from srprov.exporting.kubernetes_pod import namespace_of
from srprov.exporting.swarm_script import BUILD, build_script

APPLY = "apply.sh"
_WHOSE = r"""
# an experiment of a stranger's may have any name: what it brings closes its namespace to others.
# Nothing is said of a namespace that is not there; who cannot ask, does not know that.
if ! found=$(kubectl get namespace "$namespace" --ignore-not-found -o \
    'jsonpath={.metadata.name} {.metadata.labels.srprov\.instance}'); then
    echo "kubectl does not say whether the namespace $namespace is there, and whose: nothing was applied" >&2
    exit 1
fi
if [ -n "$found" ] && [ "$found" != "$namespace $instance" ]; then
    echo "the namespace $namespace is there, and no experiment of that name made it: give the experiment" >&2
    echo "another name, or if it is meant: kubectl label namespace $namespace srprov.instance=$instance" >&2
    exit 1
fi
"""

_AWAIT = r"""
# await SERVICE started|healthy|completed: until its pod says so
await() {
    waited=0
    echo "waiting for $1: $2"
    while :; do
        said=$(kubectl get pods -n "$namespace" -l "srprov.service=$1" -o \
            'jsonpath={range .items[*]}{.status.phase} {.status.conditions[?(@.type=="Ready")].status}{"\n"}{end}')
        case $2 in
            started) wanted='^(Running|Succeeded) ' ;;
            healthy) wanted='^Running True' ;;
            completed) wanted='^Succeeded ' ;;
        esac
        if printf '%s\n' "$said" | grep -Eq "$wanted"; then return 0; fi
        if [ "$waited" -ge "$limit" ]; then
            echo "$1: not $2 after $limit s:" >&2
            kubectl get pods -n "$namespace" -l "srprov.service=$1" >&2
            exit 1
        fi
        sleep 1
        waited=$((waited + 1))
    done
}
"""


def apply_script(experiment: Experiment, levels: Sequence[Sequence[str]]) -> str:
    """Return a script that applies each level's file when what it needs is there."""
    lines = ["#!/bin/sh", f"# Starts {experiment.name} on a Kubernetes cluster, by kubectl as it is configured."]
    lines += ['set -eu; cd "$(dirname "$0")"', f"instance={experiment.name}", f"namespace={namespace_of(experiment)}"]
    lines.append('limit="${LIMIT:-300}"')
    if len(levels) > 1:
        lines.append(_AWAIT.rstrip("\n") + "\n")
    lines += [_WHOSE.strip("\n"), "kubectl apply -f 00-namespace.yaml"]
    for number, names in enumerate(levels):
        lines += [f"await {name} {condition}" for name, condition in _needed(experiment, names)]
        lines.append(f"kubectl apply -f {(number + 1) * 10}-level.yaml")
    return "\n".join(lines) + "\n"


def _needed(experiment: Experiment, names: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield whom services wait for, and for what; what is healthy or has completed was started."""
    every = {pair for name in names for pair in experiment.services[name].depends_on.items()}
    for name, condition in sorted(every):
        if condition != "started" or not {(name, "healthy"), (name, "completed")} & every:
            yield name, condition


__all__ = ["APPLY", "BUILD", "apply_script", "build_script"]
