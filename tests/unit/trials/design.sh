#!/bin/sh
# The trials of a product design in random order, from docs/trials.md alone: design.sh SEED REPETITIONS <PARAMETERS
# A line of PARAMETERS is "NAME VALUE VALUE..."; values are words without quotes. Prints "TRIAL SEED", in order.
set -eu
export LC_ALL=C
points=$(sort | awk '
    { names[NR] = $1; count[NR] = NF - 1; for (i = 2; i <= NF; i++) values[NR, i - 1] = $i }
    function combine(at, text,    i) {
        if (at > NR) { print "{" text "}"; return }
        for (i = 1; i <= count[at]; i++)
            combine(at + 1, text (at > 1 ? "," : "") "\"" names[at] "\":\"" values[at, i] "\"")
    }
    END { combine(1, "") }')
hash() { printf "$1" "$2" | sha256sum | cut -c "1-$3"; }
repetition=1
while [ "$repetition" -le "$2" ]; do
    printf '%s\n' "$points" | while read -r parameters; do
        point=$(hash 'srprov-point/1\n%s' "$parameters" 10)
        seed=$(hash 'srprov-seed/1|%s' "$1|$point|$repetition" 8)
        order=$(hash 'srprov-order/1|%s' "$1|$repetition|$point" 64)
        printf '%s %s-r%03d %d\n' "$order" "$point" "$repetition" "$((0x$seed & 0x7fffffff))"
    done | sort | cut -d ' ' -f 2-
    repetition=$((repetition + 1))
done
