"""Compiled playbooks, kept in the user's cache folder: to compile one takes a hundred times as long as to read it.

What is read is code that runs, as with Python's own `__pycache__`; so it counts only where nobody else can have put it:
the file and its folder are the user's and no links, and no folder above is another user's. The owner of the file alone
says too little: a link may lead to one that the user owns, and that a stranger wrote, such as one of a repository that
was cloned. It was checked when it was compiled. Takes a name and a text; reads and writes one file per name, which says
what it was made from. Nothing is lost with these files: without them everything is compiled.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import marshal
from pathlib import Path
from types import CodeType

from jinja2 import Template, compiler
from jinja2.bccache import bc_magic

from srprov import believed, private
from srprov.rendering import environment

_MOST_BYTES = 1 << 20
_DIGEST = 32


def template(name: str, text: str) -> Template:
    """Return the template of a playbook.

    Raises:
        RenderError: A substitution is only a part of a value.
        jinja2.TemplateError: It cannot be compiled.
    """
    env = environment.environment()
    path = private.cache_folder() / "playbooks" / hashlib.sha256(name.encode()).hexdigest()
    made_from = hashlib.sha256(_code() + text.encode()).digest()
    code = _kept(path, made_from)
    if code is None:
        environment.check_whole_values(env, text, name)
        code = env.compile(text)
        with contextlib.suppress(OSError):  # compiled again next time
            believed.make_folder(path.parent)
            private.replace_file(path, made_from + marshal.dumps(code))
    return env.template_class.from_code(env, code, env.make_globals(None))


@functools.cache
def _code() -> bytes:
    """Return a digest of what checks and compiles playbooks, and of Python's and Jinja2's formats."""
    files = (Path(environment.__file__), Path(compiler.__file__))
    return hashlib.sha256(bc_magic + b"".join(path.read_bytes() for path in files)).digest()


def _kept(path: Path, made_from: bytes) -> CodeType | None:
    """Return the code that a file holds; None when it was made from something else, or might be somebody else's."""
    try:
        content = believed.read(path, _MOST_BYTES)
    except OSError:
        return None
    if content[:_DIGEST] != made_from:
        return None
    try:
        code = marshal.loads(content[_DIGEST:])  # noqa: S302 - the user's own file, see above
    except (ValueError, EOFError, TypeError):
        return None
    return code if isinstance(code, CodeType) else None
