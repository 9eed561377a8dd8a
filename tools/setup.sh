#!/bin/sh
# Sets up everything that `make demo` and `make test` need on a Debian machine, and says what it does. Safe to repeat:
# what is there is left alone, so a second run takes a second. As root it installs missing Debian packages; any other user
# gets the command to type. It starts no service and leaves none enabled that it brought.
set -eu
cd "$(dirname "$0")/.."
PATH="$PATH:/usr/local/sbin:/usr/sbin:/sbin"

# program:Debian package. The lab's own list is in srprov/lab/machine.py; tests/unit/test_tools.py compares the two.
PROGRAMS="
git:git
dockerd:docker.io
docker:docker.io
sshd:openssh-server
ssh:openssh-client
ssh-keygen:openssh-client
ip:iproute2
tc:iproute2
iptables:iptables
nft:nftables
wg:wireguard-tools
wireguard-go:wireguard-go
ping:iputils-ping
debootstrap:debootstrap
busybox:busybox
qemu-aarch64-static:qemu-user-static
docker-registry:docker-registry
sudo:sudo
unshare:util-linux
nsenter:util-linux
modprobe:kmod
systemd-analyze:systemd
"
# Packages that bring no program of their own.
PACKAGES="ca-certificates"

# Services of these packages. Where they were not there before, they are disabled again: the lab starts its own.
UNITS="docker.service docker.socket containerd.service ssh.service docker-registry.service"

POLICY=/usr/sbin/policy-rc.d
POLICY_MARK="made by srprov's tools/setup.sh"
POLICY_ASIDE=$POLICY.before-srprov
STAMP=.venv/.srprov-setup

say() { echo "setup: $*"; }
fail() {
    echo "setup: $*" >&2
    exit 1
}

installed() { [ "$(dpkg-query -W -f='${db:Status-Status}' "$1" 2>/dev/null)" = installed ]; }

# The first Python that is new enough and can make a virtual environment. Set PYTHON to choose another.
find_python() {
    for candidate in ${PYTHON:-python3 /usr/bin/python3 python3.13 python3.12 python3.11 python3.10}; do
        if "$candidate" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 10))' 2>/dev/null; then
            echo "$candidate"
            return 0
        fi
    done
    return 1
}

missing_packages() {
    {
        for pair in $PROGRAMS; do
            command -v "${pair%%:*}" >/dev/null 2>&1 || echo "${pair#*:}"
        done
        for package in $PACKAGES; do
            installed "$package" || echo "$package"
        done
        # With AppArmor in the kernel, Docker needs its parser to start a container.
        if [ "$(cat /sys/module/apparmor/parameters/enabled 2>/dev/null)" = Y ] && ! command -v apparmor_parser >/dev/null; then
            echo apparmor
        fi
        [ -x .venv/bin/python ] || find_python >/dev/null || printf '%s\n' python3 python3-venv
    } | sort -u | tr '\n' ' '
}

# Debian starts a service as soon as its package is installed, unless this file says no (exit 101).
forbid_service_starts() {
    trap allow_service_starts EXIT
    trap 'exit 130' INT
    trap 'exit 143' TERM HUP
    if [ -e "$POLICY" ]; then
        status=0
        "$POLICY" docker start >/dev/null 2>&1 || status=$?
        [ "$status" -ne 101 ] || return 0 # it says no already: leave it
        mv "$POLICY" "$POLICY_ASIDE"
    fi
    printf '#!/bin/sh\n# %s while it installs packages\nexit 101\n' "$POLICY_MARK" >"$POLICY"
    chmod 755 "$POLICY"
}

# Also mends what a killed run left behind.
allow_service_starts() {
    if [ -e "$POLICY" ] && grep -qF "$POLICY_MARK" "$POLICY"; then rm -f "$POLICY"; fi
    if [ -e "$POLICY_ASIDE" ]; then mv "$POLICY_ASIDE" "$POLICY"; fi
}

unit_files() {
    command -v systemctl >/dev/null 2>&1 || return 0
    for unit in $UNITS; do
        for folder in /etc/systemd/system /usr/lib/systemd/system /lib/systemd/system; do
            if [ -e "$folder/$unit" ]; then
                echo "$unit"
                break
            fi
        done
    done
}

install_packages() {
    missing=$(missing_packages)
    if [ -z "$missing" ]; then
        say "Debian packages: all there"
        return 0
    fi
    command -v apt-get >/dev/null 2>&1 || fail "this machine has no apt-get; install the equivalent of: $missing"
    [ "$(id -u)" = 0 ] || fail "as root, run: apt-get install --no-install-recommends $missing"
    say "installing Debian packages: $missing"
    units_before=$(unit_files)
    allow_service_starts
    forbid_service_starts
    export DEBIAN_FRONTEND=noninteractive
    apt="apt-get -q -o Dpkg::Use-Pty=0 -o DPkg::Lock::Timeout=300 -o Acquire::Retries=3"
    $apt update || fail "apt-get update failed; see the lines above"
    # shellcheck disable=SC2086 # a list of words
    $apt install -y --no-install-recommends --no-remove $missing || fail "apt-get install failed; see the lines above"
    for unit in $(unit_files); do
        case " $(echo "$units_before" | tr '\n' ' ') " in
            *" $unit "*) ;;
            *)
                say "leaving $unit disabled (the lab starts what it needs; systemctl enable brings it back)"
                systemctl disable --quiet "$unit" 2>/dev/null || say "could not disable $unit; it may start with the machine"
                ;;
        esac
    done
    allow_service_starts
    trap - EXIT INT TERM HUP
}

make_environment() {
    if ! .venv/bin/python -c 'import sys; sys.exit(sys.version_info < (3, 10))' 2>/dev/null; then
        python=$(find_python) || fail "no Python >= 3.10 with venv and ensurepip found; set PYTHON to one"
        say "making .venv with $("$python" -V)"
        "$python" -m venv --clear .venv
    fi
    wanted=$({ pwd; .venv/bin/python -V; cat pyproject.toml; } | sha256sum)
    if [ -x .venv/bin/srprov ] && [ "$(cat "$STAMP" 2>/dev/null)" = "$wanted" ]; then
        say "Python environment: up to date"
        return 0
    fi
    say "installing srprov and its Python packages into .venv (a minute or two the first time)"
    rm -f "$STAMP"
    .venv/bin/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
    echo "$wanted" >"$STAMP"
}

install_packages
make_environment
say "ready"
