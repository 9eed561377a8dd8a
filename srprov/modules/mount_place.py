"""Where a robot's paths lead, as an engine follows links. Text only."""

from __future__ import annotations

LEADS_TO = r"""# where a path leads; of one that is not there what is there of it counts, as the rest may be made
leads_to() {
  p=$1 r=
  while [ -n "$p" ] && [ ! -e "$p" ] && [ ! -L "$p" ]; do p=${p%/*}; done
  if [ -n "$p" ]; then r=$(readlink -f "$p") && [ -n "$r" ] || return 1; fi
  r=${r%/}${1#"$p"}
  printf '%s\n' "${r:-/}"
}
"""
