"""Git repositories that run a program, or tell a file of others, when somebody reads them without care.

`TRAPS` are scripts of a shell that make one each, in a folder with a commit of its own; `MARK` is what a program of
theirs would make. `bait` proves that a trap is one: what git itself does in it makes the mark.
"""

from __future__ import annotations

from collections.abc import Mapping

START = """\
set -e
git init -q -b main . && git config user.name a && git config user.email a@b.c
printf '1\\n' >a && printf '1\\n' >b && git add a b && git commit -qm 1
git remote add origin https://h.example/code.git && git update-ref refs/remotes/origin/main HEAD
printf '2\\n' >a
"""
_HOOK = "printf '#!/bin/sh\\ntouch \"$MARK\"\\n' >.git/hooks/{0} && chmod 755 .git/hooks/{0}\n"
_PROGRAM = 'printf \'#!/bin/sh\\ntouch "%s"\\ncat "$@"\\n\' "$MARK" >.git/program && chmod 755 .git/program\n'
TRAPS: Mapping[str, str] = {
    "fsmonitor": 'git config core.fsmonitor "touch $MARK; false"',
    "external": f'{_PROGRAM}git config diff.external "$PWD/.git/program"',
    "driver": f"{_PROGRAM}git config diff.d.command \"$PWD/.git/program\" && echo '* diff=d' >.gitattributes",
    "textconv": f"{_PROGRAM}git config diff.d.textconv \"$PWD/.git/program\" && echo '* diff=d' >.gitattributes",
    "clean": "git config filter.f.clean \"touch $MARK; cat\" && echo '* filter=f' >.git/info/attributes",
    "required": 'git config filter.f.clean "touch $MARK; cat" && git config filter.f.required true'
    " && echo '* filter=f' >.git/info/attributes",
    "process": "git config filter.f.process \"touch $MARK\" && echo '* filter=f' >.git/info/attributes",
    "lfs": 'git config filter.lfs.clean "touch $MARK; cat" && git config filter.lfs.required true'
    " && echo '* filter=lfs' >.git/info/attributes",
    "pager": 'git config core.pager "touch $MARK; cat" && git config pager.diff-index "touch $MARK"',
    "alias": 'git config alias.diff-index "!touch $MARK" && git config alias.ls-files "!touch $MARK"',
    "hooks": "".join(_HOOK.format(one) for one in ("post-index-change", "reference-transaction", "fsmonitor-watchman")),
    "include": "printf '[core]\\n fsmonitor = touch %s; false\\n' \"$MARK\" >.git/more && git config include.path more",
    "worktree-config": "git config extensions.worktreeConfig true"
    " && printf '[core]\\n fsmonitor = touch %s; false\\n' \"$MARK\" >.git/config.worktree",
    "promisor": "git config remote.origin.promisor true && git config extensions.partialClone origin"
    ' && git config remote.origin.url "ext::touch $MARK" && git config protocol.ext.allow always'
    " && rm .git/objects/$(git rev-parse HEAD:a | sed 's,^..,&/,')",
    "index-v4": 'git update-index --index-version 4 && git config core.fsmonitor "touch $MARK; false"',
    "split-index": 'git update-index --split-index && git config core.fsmonitor "touch $MARK; false"',
    "submodule": 'git init -q s && git -C s config core.fsmonitor "touch $MARK; false"'
    " && git -C s -c user.name=a -c user.email=a@b.c commit -q --allow-empty -m 1 && git add s 2>/dev/null"
    " && printf '[submodule \"s\"]\\n path = s\\n url = ./s\\n' >.gitmodules",
    "gpg": 'git config gpg.program "touch $MARK" && git config log.showSignature true',
    "credential": 'git config credential.helper "!touch $MARK" && git config core.askPass "touch $MARK"'
    ' && git config core.sshCommand "touch $MARK" && git config core.editor "touch $MARK"',
    "attributes-file": f"{_PROGRAM}git config diff.d.command \"$PWD/.git/program\" && echo '* diff=d' >.git/attr"
    ' && git config core.attributesFile "$PWD/.git/attr"',
}
"""Name -> the rest of a script that begins with `START`; `MARK` is in its environment."""
BAIT: Mapping[str, str] = {
    "fsmonitor": "git status", "external": "git diff", "driver": "git diff", "textconv": "git diff",
    "clean": "git diff", "required": "git diff", "process": "git diff", "lfs": "git diff",
    "include": "git status", "worktree-config": "git status", "index-v4": "git status", "split-index": "git status",
    "attributes-file": "git diff",
}  # fmt: skip
"""Trap -> what makes its mark where nobody takes care; the others are for versions of git to come."""
