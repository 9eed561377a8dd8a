"""Where the engines of a robot keep what they have, as functions of a shell. Pure."""

from __future__ import annotations

TOLD = r"""# where engines keep what they have, by the files that configure them
told_by_files() {
  j=$(cat /etc/docker/daemon.json)
  for k in '"data-root"' '"graph"' '"exec-root"'; do
    case $j in *"$k"*) d=${j#*"$k"} d=${d#*'"'}; printf '%s\n' "${d%%'"'*}" ;; esac
  done
  while case $j in *unix://*) ;; *) false ;; esac; do j=${j#*unix://}; printf '%s\n' "${j%%'"'*}"; done
  for c in /etc/containerd/config.toml /etc/containers/storage.conf; do
    [ ! -e $c ] || sed -nE "s/^[ \t]*(root|root_path|state|address|graphroot|runroot) *= *[\"']([^\"']*).*/\2/p" $c
  done
}
# the processes of engines
engines() {
  for p in /proc/[0-9]*; do
    c=
    read -r c <"$p/comm"
    case $c in dockerd | containerd | balena* | podman | crio | k3s*) ;; *) continue ;; esac
    # one in a container keeps other files, and one of another user's nothing that root would serve
    [ "$p/root/." -ef / ] && [ -O "$p" ] && printf '%s\n' "$p"
  done
}
# the same by the words that they were started with
told_by_words() {
  known=' --data-root --graph -g --exec-root --root --state --address -a --host -H '
  engines | while IFS= read -r p; do
    tr '\0' '\n' <"$p/cmdline" | {
      option=
      while IFS= read -r w; do
        [ -z "$option" ] || w=$option=$w
        option=
        case $known in
          *" $w "*) option=$w ;;
          *" ${w%%=*} "*) w=${w#*=}; printf '%s\n' "${w#unix://}" ;;
          *) case $w in unix://*) printf '%s\n' "${w#unix://}" ;; esac ;;
        esac
      done
    }
  done
}
# the same by the sockets that they listen on: systemd may have opened them, at a place that its units alone say
told_by_sockets() {
  engines | while IFS= read -r p; do
    open=$(ls -l "$p/fd")
    while read -r _ _ _ flags _ _ inode path; do
      case $flags/$path in 00010000//*) ;; *) continue ;; esac
      case $open in *"socket:[$inode]"*) printf '%s\n' "$path" ;; esac
    done <"$p/net/unix"
  done
}
# the same by the databases that they have open, whatever file says where: one of containerd's lies two folders below
# its root, or in a snapshotter's; those of dockerd lie in folders of its own
told_by_databases() {
  engines | while IFS= read -r p; do
    ls -l "$p/fd" | while IFS= read -r w; do
      case $w in *' -> /'*.db) w=/${w#*' -> /'} w=${w%/*} ;; *) continue ;; esac
      case $w in
        */io.containerd.*) w=${w%%/io.containerd.*} ;;
        */network/files) w=${w%/network/files} ;;
        */volumes | */buildkit) w=${w%/*} ;;
      esac
      printf '%s\n' "$w"
    done
  done
}
# a line for each folder that an overlay shows: its file system, and the folder; those of containers are an engine's
layers() {
  while read -r _ _ f _ point more; do
    case $point in */merged) continue ;; esac
    case $more in *' - overlay '*) ;; *) continue ;; esac
    o=${more##* },
    while [ -n "$o" ]; do
      one=${o%%,*} o=${o#*,}
      case $one in lowerdir=/* | lowerdir+=/* | upperdir=/*) one=${one#*=}: ;; *) continue ;; esac
      while [ -n "$one" ]; do
        case $one in /*) printf '%s\n' "$f ${one%%:*}" ;; esac
        one=${one#*:}
      done
    done
  done </proc/self/mountinfo
}
"""
"""`told_by_…` print paths; `layers` prints a file system and a folder. Source: the engines' manuals, proc(5)."""
