#!/bin/sh
# A robot from first process to last. `boot.sh enter` joins the robot's cgroups and makes its namespaces;
# `boot.sh inside` is then PID 1 of the robot: it builds the robot's view of the machine, starts its services and
# reaps orphans for ever. Killing PID 1 ends the robot, and its namespaces take mounts and links with them.
# Settings come as LAB_* variables (srprov/lab/robot.py writes them); nothing outside $LAB_DISK is changed.
set -eu

enter() {
    for group in $LAB_CGROUPS; do
        echo $$ >"$group/cgroup.procs"
    done
    exec unshare --mount --pid --uts --ipc --net --cgroup --fork --kill-child /bin/sh "$0" inside
}

# The controller says "go" once it has noted our process id and put eth0 into our network. Should it die before
# that, the pipe closes and no robot is left that nobody knows of.
wait_for_go() {
    read -r word || exit 1
    [ "$word" = go ] || exit 1
    exec </dev/null
}

# A copy-on-write view of the machine's own root: reads come from it, every write goes to the robot's disk.
mount_root() {
    mount --make-rprivate /
    mount -t overlay overlay -o "lowerdir=/,upperdir=$LAB_DISK/upper,workdir=$LAB_DISK/work" "$root"
    mount -t proc -o nosuid,nodev,noexec proc "$root/proc"
    mount -t sysfs -o nosuid,nodev,noexec sysfs "$root/sys"
    mount -t tmpfs -o mode=755,nosuid,nodev tmpfs "$root/run"
    mkdir "$root/run/lab"
    mount -t tmpfs -o mode=1777,nosuid,nodev tmpfs "$root/tmp"
    # Docker's overlay2 cannot live on an overlay, so its data lies directly on the disk.
    if [ -e "$LAB_DISK/docker.img" ]; then
        mount -t ext4 -o loop "$LAB_DISK/docker.img" "$root/var/lib/docker"
    else
        mount --bind "$LAB_DISK/docker" "$root/var/lib/docker"
    fi
}

mount_cgroups() {
    if [ "$LAB_CGROUP_VERSION" = 2 ]; then
        mount -t cgroup2 cgroup2 "$root/sys/fs/cgroup"
        # A v2 group with processes of its own may not hand controllers to its children: move aside first.
        mkdir -p "$root/sys/fs/cgroup/init"
        echo 1 >"$root/sys/fs/cgroup/init/cgroup.procs"
        for controller in $(cat "$root/sys/fs/cgroup/cgroup.controllers"); do
            echo "+$controller" >"$root/sys/fs/cgroup/cgroup.subtree_control" || :
        done
        return
    fi
    mount -t tmpfs -o mode=755 tmpfs "$root/sys/fs/cgroup"
    for hierarchy in $LAB_CGROUP_HIERARCHIES; do # name:mount options
        mkdir "$root/sys/fs/cgroup/${hierarchy%%:*}"
        mount -t cgroup -o "${hierarchy#*:}" cgroup "$root/sys/fs/cgroup/${hierarchy%%:*}"
    done
}

node() { # path, major, minor
    mkdir -p "$root${1%/*}"
    mknod -m 666 "$root$1" c "$2" "$3"
}

make_devices() {
    mount -t tmpfs -o mode=755,nosuid tmpfs "$root/dev"
    node /dev/null 1 3
    node /dev/zero 1 5
    node /dev/full 1 7
    node /dev/random 1 8
    node /dev/urandom 1 9
    node /dev/kmsg 1 11
    node /dev/tty 5 0
    node /dev/net/tun 10 200
    node /dev/fuse 10 229
    mkdir "$root/dev/pts" "$root/dev/shm" "$root/dev/mqueue"
    mount -t devpts -o newinstance,ptmxmode=0666,mode=620,gid=5 devpts "$root/dev/pts"
    mount -t tmpfs -o mode=1777,nosuid,nodev tmpfs "$root/dev/shm"
    mount -t mqueue mqueue "$root/dev/mqueue"
    ln -s pts/ptmx "$root/dev/ptmx"
    ln -s /proc/self/fd "$root/dev/fd"
    ln -s /proc/self/fd/0 "$root/dev/stdin"
    ln -s /proc/self/fd/1 "$root/dev/stdout"
    ln -s /proc/self/fd/2 "$root/dev/stderr"
    # A simulated device can be opened, reads as empty and swallows what is written: it is another /dev/null.
    for device in $LAB_DEVICES; do
        node "$device" 1 3
    done
}

simulate_figures() {
    for figure in loadavg meminfo; do
        if [ -e "$LAB_DISK/figures/$figure" ]; then
            mount --bind "$LAB_DISK/figures/$figure" "$root/proc/$figure"
        fi
    done
    if [ -e "$LAB_DISK/figures/machine" ] && [ -e "$root/proc/sys/kernel/arch" ]; then
        mount --bind "$LAB_DISK/figures/machine" "$root/proc/sys/kernel/arch"
    fi
    for figure in date uname arch systemctl; do # they call the real ones, which are then in /run/lab
        if [ -e "$LAB_DISK/figures/$figure" ]; then
            program=$(command -v "$figure")
            : >"$root/run/lab/$figure"
            mount --bind "$program" "$root/run/lab/$figure"
            mount --bind "$LAB_DISK/figures/$figure" "$root$program"
        fi
    done
}

# The kernel starts an emulator for another architecture's programs, of all robots, as long as anybody has this
# filesystem mounted: the entry goes with the last robot that needs it.
register_emulator() {
    if [ -n "$LAB_BINFMT" ]; then
        name=${LAB_BINFMT#:}
        mkdir "$root/run/lab/binfmt"
        mount -t binfmt_misc binfmt_misc "$root/run/lab/binfmt"
        entry=$root/run/lab/binfmt/${name%%:*}
        # Another robot may be quicker.
        [ -e "$entry" ] || printf '%s' "$LAB_BINFMT" >"$root/run/lab/binfmt/register" || [ -e "$entry" ]
    fi
}

leave_old_root() {
    mkdir -p "$root/run/.old"
    cd "$root"
    pivot_root . run/.old
    cd /
    umount -l /run/.old
    rmdir /run/.old
}

start_network() {
    echo "$LAB_NAME" >/proc/sys/kernel/hostname
    ip link set lo up
    ip addr add "$LAB_ADDRESS" dev eth0
    if [ -n "$LAB_ADDRESS6" ]; then
        ip addr add "$LAB_ADDRESS6" dev eth0 nodad
    fi
    ip link set eth0 up
    ip route add default via "$LAB_GATEWAY"
}

start_services() {
    mkdir -p /run/sshd /run/lock
    clean="env -i PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/root"
    $clean /usr/sbin/sshd -D -e 2>>/var/log/sshd.log &
    if [ "$LAB_DOCKER" = yes ]; then
        run_docker &
    fi
    if [ "$LAB_SYSTEMD" = yes ]; then
        echo systemd >/proc/1/comm
        run_units &
    fi
}

# What systemd would do with srprov's units that are enabled: run the commands of each, in order, after Docker.
run_units() {
    for unit in /etc/systemd/system/multi-user.target.wants/srprov-*.service; do
        [ -e "$unit" ] || continue
        left=600
        until docker version >/dev/null 2>&1 || [ "$left" = 0 ]; do
            left=$((left - 1))
            sleep 0.1
        done
        sed -n 's/^ExecStart=//p' "$unit" | while IFS= read -r call; do
            case $call in
                '/bin/sh -c "'*) # in quotes a unit has $$ for $, %% for % and the escapes of printf
                    call=$(printf '%s' "${call#/bin/sh -c }" | sed 's/^"//; s/"$//; s/[$][$]/$/g')
                    # shellcheck disable=SC2059 # it is a format
                    printf "$call" | $clean sh -s || break
                    ;;
                -*) $clean sh -c "${call#-}" || : ;;
                *) $clean sh -c "$call" || break ;;
            esac
        done
    done >>/var/log/units.log 2>&1
}

# As service managers do: an engine that ends is started again after two seconds, unless it shall stay down.
run_docker() {
    ulimit -n 524288 2>/dev/null || :
    while :; do
        while [ -e /run/lab/docker-stopped ]; do
            sleep 0.2
        done
        rm -f /run/docker.pid
        # shellcheck disable=SC2086 # two words, or none
        $clean dockerd $LAB_DOCKERD >>/var/log/dockerd.log 2>&1 || :
        [ -e /run/lab/docker-stopped ] || sleep 2
    done
}

reap_for_ever() {
    exec >/dev/null 2>&1
    while :; do # `wait` reaps the adopted orphans too, and never returns while the sleeper lives
        sleep infinity &
        wait || :
    done
}

root=$LAB_DISK/root
if [ "$1" = enter ]; then
    enter
fi
wait_for_go
mount_root
mount_cgroups
make_devices
simulate_figures
register_emulator
leave_old_root
start_network
start_services
reap_for_ever
