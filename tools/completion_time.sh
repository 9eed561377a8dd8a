#!/bin/sh
# How long a Tab takes: the median of 15 answers each, in ms, for verbs, options, services of an EDF and robots of an inventory.
# Run it on a machine that does nothing else. It ends with 1 when one takes 250 ms or more.
set -eu
here=$(cd "$(dirname "$0")/.." && pwd)
cd "$here"
worst=0
measure() {
    took=$(for _ in 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15; do
        begun=$(date +%s%N)
        .venv/bin/srprov completion bash -- "$1" "" >/dev/null
        echo $((($(date +%s%N) - begun) / 1000000))
    done | sort -n | sed -n 8p)
    printf '%5d ms  %s\n' "$took" "$1"
    [ "$took" -le "$worst" ] || worst=$took
}
measure "srprov "
measure "srprov apply --"
measure "srprov plan examples/race/experiment.edf --allow "
measure "srprov restart examples/race/experiment.edf "
measure "srprov exec examples/race/experiment.edf -i inventory/example.yml talker@"
measure "srprov facts -i inventory/example.yml --limit "
[ "$worst" -lt 250 ]
