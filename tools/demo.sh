#!/bin/sh
# `make demo`: an embedded lab of three robots, a ROS 1 experiment on it, and messages that cross it. Can be repeated.
set -eu
cd "$(dirname "$0")/.."
PATH="$PWD/.venv/bin:$PATH"

EDF=examples/chatter-ros/experiment.edf
INVENTORY=inventory/lab${SRPROV_LAB:+-$SRPROV_LAB}.yml
DEADLINE_S=${DEMO_DEADLINE_S:-90}

# Say the command, then run it.
run() {
    echo
    echo "\$ $*"
    "$@"
}
heard() { srprov logs "$EDF" -i "$INVENTORY" listener; }

echo "demo 1/4: three robots on this machine, each with its own sshd, Docker and network (the first time makes their images)"
if [ "$(srprov lab status 2>/dev/null | grep -c '^robot')" -gt 3 ]; then
    echo "a lab with more robots is up: it keeps them all"
    run srprov lab up
else
    run srprov lab up -n 3
fi

echo
echo "demo 2/4: the experiment: a ROS master, a talker and a listener, one on each robot"
run srprov apply "$EDF" -i "$INVENTORY" --yes

echo
echo "demo 3/4: what runs where"
run srprov status "$EDF" -i "$INVENTORY"

echo
echo "demo 4/4: waiting up to $DEADLINE_S s until the listener has heard the talker across the overlay"
log=$(mktemp)
trap 'rm -f "$log"' EXIT
end=$(($(date +%s) + DEADLINE_S))
until heard >"$log" 2>&1 && [ "$(grep -c 'heard: ' "$log")" -ge 3 ]; do
    if [ "$(date +%s)" -ge "$end" ]; then
        echo "demo: failed: fewer than 3 messages after $DEADLINE_S s. The listener's log says:" >&2
        tail -n 20 "$log" >&2
        exit 1
    fi
    sleep 1
done
echo "\$ srprov logs $EDF -i $INVENTORY listener"
grep 'heard: ' "$log" | tail -n 5

cat <<END

It works. Try next:
  . .venv/bin/activate
  srprov plan $EDF -i $INVENTORY       # nothing to do; then edit the EDF and plan again
  srprov destroy $EDF -i $INVENTORY    # take the experiment off the robots
  srprov lab down    # take the robots away
END
