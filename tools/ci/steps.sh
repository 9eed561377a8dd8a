#!/usr/bin/env bash
# What action.yml and templates/gitlab.yml do: steps.sh install|validate|plan. docs/ci.md says what each is for.
#
# All that a user sets comes in variables SRPROV_CI_…; nothing of it becomes a part of a command's text. What files of
# the repository make srprov say is printed where GitHub's runner takes no commands from it. The token goes to forge.py
# alone: neither srprov nor what an inventory runs has it.
set -euo pipefail
shopt -s inherit_errexit

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
token=${SRPROV_CI_TOKEN-}
unset SRPROV_CI_TOKEN
work=${SRPROV_CI_WORK:-${RUNNER_TEMP:?}/srprov}
program=${SRPROV_CI_PROGRAM:-$work/venv/bin/srprov}
mkdir -p "$work"

forge() { SRPROV_CI_TOKEN=$token python3 -I "$here/forge.py" "$@"; }

output() { printf '%s=%s\n' "$1" "$2" >>"${GITHUB_OUTPUT:-/dev/null}"; }

# Print a file that may hold anything.
quoted() {
    if [ -z "${GITHUB_ACTIONS-}" ]; then
        cat "$1"
        return
    fi
    local word
    word=$(python3 -I -c 'import secrets; print(secrets.token_hex(16))')
    printf '::stop-commands::%s\n' "$word"
    cat "$1"
    printf '\n::%s::\n' "$word"
}

# Run srprov, with its answer in one file and what else it says in another; set `code`.
srprov() {
    code=0
    "$program" "${@:3}" >"$1" 2>"$2" || code=$?
}

# Read the lines of a text into the array `lines`, without empty ones.
split() {
    lines=()
    local line
    while IFS= read -r line; do
        if [ -n "$line" ]; then lines+=("$line"); fi
    done <<<"$1"
}

install() {
    if [ -n "${SRPROV_CI_PROGRAM-}" ]; then return; fi
    python3 -I -m venv "$work/venv" # -I: no module of the repository that is checked takes the place of Python's
    "$work/venv/bin/pip" install --quiet --disable-pip-version-check "$here/../.."
}

validate() {
    local lines files code patterns=('*.edf' '*.cdf' '*.edf.yml' '*.edf.yaml' '*.cdf.yml' '*.cdf.yaml')
    split "${SRPROV_CI_FILES-}"
    if [ ${#lines[@]} -gt 0 ]; then patterns=("${lines[@]}"); fi
    git ls-files -z -- "${patterns[@]}" >"$work/files"
    mapfile -d '' -t files <"$work/files"
    if [ ${#files[@]} -eq 0 ]; then
        echo "no file to check: none that git knows is called ${patterns[*]}" >"$work/validate.txt"
        quoted "$work/validate.txt"
        if [ ${#lines[@]} -gt 0 ]; then return 5; fi
        output valid true
        return
    fi
    srprov "$work/validate.txt" "$work/validate.err" validate --format text -- "${files[@]}"
    quoted "$work/validate.txt"
    quoted "$work/validate.err"
    if [ "$code" -ne 0 ] && [ "$code" -ne 5 ]; then return "$code"; fi
    local verdict=$code form forms=(sarif codequality)
    if [ -n "${GITHUB_ACTIONS-}" ]; then forms=(json); fi
    if [ "${SRPROV_CI_SARIF-}" = true ]; then forms+=(sarif); fi
    for form in "${forms[@]}"; do
        srprov "$work/validate.$form" "$work/validate.err" validate --format "$form" -- "${files[@]}"
    done
    if [ -n "${GITHUB_ACTIONS-}" ]; then
        forge annotate "$work/validate.json"
        if [ "${SRPROV_CI_SARIF-}" = true ]; then forge sarif "$work/validate.sarif"; fi
    fi
    if [ "$verdict" -eq 0 ]; then output valid true; else output valid false; fi
    return "$verdict"
}

# Say what the plan's command line is: set `words`, and `what` to its verb. With a base, no robot is asked.
ask() {
    local lines inventory experiment=$1 base=${SRPROV_CI_BASE-}
    what=plan
    if [ -n "$base" ]; then what="diff"; fi
    words=("$what" --format markdown --detailed-exitcode)
    split "${SRPROV_CI_INVENTORY-}"
    for inventory in ${lines[@]+"${lines[@]}"}; do words+=(--inventory "$inventory"); done
    split "${SRPROV_CI_OPTIONS-}"
    words+=(${lines[@]+"${lines[@]}"})
    if [ -n "$base" ]; then words+=(--facts "${SRPROV_CI_FACTS-}" -- "$base/$experiment"); else words+=(--); fi
    words+=("$experiment")
}

plan() {
    local code words what experiment=${SRPROV_CI_EXPERIMENT-}
    if [ -z "$experiment" ]; then return; fi
    ask "$experiment"
    srprov "$work/plan.md" "$work/plan.err" "${words[@]}"
    quoted "$work/plan.err"
    if [ "$code" -ne 0 ] && [ "$code" -ne 2 ]; then
        printf '\n**srprov %s ended with exit code %s; the job says why.**\n' "$what" "$code" >>"$work/plan.md"
    fi
    cat "$work/plan.md" >>"${GITHUB_STEP_SUMMARY:-/dev/null}"
    output plan "$work/plan.md"
    if [ "$code" -eq 2 ]; then output changes true; else output changes false; fi
    if [ "${SRPROV_CI_COMMENT-}" = true ]; then forge comment "$what $experiment" "$work/plan.md"; fi
    if [ "$code" -ne 2 ]; then return "$code"; fi
}

case ${1-} in
    install | validate | plan) "$1" ;;
    *)
        echo "usage: steps.sh install|validate|plan" >&2
        exit 5
        ;;
esac
