#!/bin/sh
# `make evidence`: the trials of examples/race on robots of the embedded lab, as a signed bundle that is verified and then
# run again on other robots. Brings up a lab of its own, and takes it down. Can be repeated.
#   KEY=FILE    sign with this SSH key (default: one that is made for this time and thrown away)
#   PUBLISH=1   put the bundle and the signers into docs/evidence, where a test looks at them; no file of the
#               project may differ from its commit
set -eu
cd "$(dirname "$0")/.."
PATH="$PWD/.venv/bin:$PATH"

ROOT=$PWD
EDF=$ROOT/examples/race/experiment.edf
WHO=srprov-evidence
OUT=$ROOT/build/evidence
SRPROV_LAB=${SRPROV_LAB:-evidence}
export SRPROV_LAB

if [ "${PUBLISH:-}" = 1 ] && [ -n "$(git status --porcelain)" ]; then
    echo "evidence: files differ from the commit, which the bundle names: commit them first" >&2
    exit 1
fi

work=$(mktemp -d)
clean_up() {
    srprov lab down || echo "evidence: the lab is still up: srprov lab --name $SRPROV_LAB down" >&2
    rm -rf "$work"
}
trap clean_up EXIT
trap 'exit 130' INT
trap 'exit 143' TERM HUP
cd "$work" # the lab writes its inventory here
# runs, settings and the key for tokens of serial numbers are of this time alone
export XDG_STATE_HOME="$work/state" XDG_CONFIG_HOME="$work/config"

# Say the command, then run it.
run() {
    echo
    echo "\$ $*"
    "$@"
}
# Print an inventory of some robots of the lab: NAME=ROBOT for each.
robots() {
    python - "inventory/lab-$SRPROV_LAB.yml" "$@" <<'END'
import sys
import yaml
every = yaml.safe_load(open(sys.argv[1]))["all"]
hosts = {name: every["hosts"][robot] for name, robot in (pair.split("=") for pair in sys.argv[2:])}
print(yaml.safe_dump({"all": {"hosts": hosts, "vars": every.get("vars", {})}}), end="")
END
}

echo "evidence 1/6: six robots on this machine; three run the trials, the others run them again"
run srprov lab up -n 6
robots robot1=robot1 robot2=robot2 robot3=robot3 >ours.yml
robots kuka=robot4 abb=robot5 ur=robot6 >theirs.yml

echo
echo "evidence 2/6: the trials"
run srprov run "$EDF" -i ours.yml -o race --yes --quiet

echo
echo "evidence 3/6: the bundle"
if [ -z "${KEY:-}" ]; then
    KEY=$work/key
    ssh-keygen -q -t ed25519 -N '' -C "$WHO" -f "$KEY"
fi
printf '%s namespaces="srprov-bundle" %s\n' "$WHO" "$(ssh-keygen -y -f "$KEY" | cut -d ' ' -f 1,2)" >signers
run srprov bundle race -o race.zip --sign "$KEY"

echo
echo "evidence 4/6: whether it is what it says, without srprov and with it"
mkdir unpacked
python -m zipfile -e race.zip unpacked
(
    cd unpacked
    run sha256sum -c --quiet manifest-sha256.txt
    run ssh-keygen -Y verify -f ../signers -I "$WHO" -n srprov-bundle -s manifest-sha256.txt.sig <manifest-sha256.txt
)
run srprov verify race.zip --signers signers

echo
echo "evidence 5/6: the same trials on the other robots"
set -- replay race.zip -i theirs.yml -o again --map robot1=kuka --map robot2=abb --map robot3=ur --signers signers
run srprov "$@" --margin success=0.25 --yes --quiet

echo
echo "evidence 6/6: the files"
[ "${PUBLISH:-}" != 1 ] || OUT=$ROOT/docs/evidence
mkdir -p "$OUT"
run install -m 644 race.zip signers "$OUT"
