"""The build context: what goes in, and the same bytes everywhere."""

import contextlib
import io
import re
import tarfile
import warnings

import pytest
from controller_disk import Disk
from hypothesis import example, given
from hypothesis import strategies as st

from srprov.images import context
from srprov.images.context import context_tar, entries_of, folder_entries, ignore_rule
from srprov.images.plan import ContextFile, ListedFile
from tests.bounded import bounded


def members(blob: bytes) -> dict[str, tarfile.TarInfo]:
    with tarfile.open(fileobj=io.BytesIO(blob)) as tar:
        return {member.name: member for member in tar.getmembers()}


def test_the_tar_is_the_same_whatever_the_order() -> None:
    entries = [
        ContextFile(path="b/c/x", content=b"1", mode=0o755),
        ContextFile(path="a", content=b"2"),
        ContextFile(path="l", link="a"),
    ]
    blob = context_tar("FROM x\n", entries)
    assert blob == context_tar("FROM x\n", list(reversed(entries)))
    found = members(blob)
    assert list(found) == ["Dockerfile", "a", "b", "b/c", "b/c/x", "l"]
    assert {(m.mtime, m.uid, m.gid, m.uname, m.gname) for m in found.values()} == {(0, 0, 0, "", "")}
    assert [oct(found[name].mode) for name in ("a", "b", "b/c/x")] == ["0o644", "0o755", "0o755"]
    assert (found["l"].issym(), found["l"].linkname) == (True, "a")


def test_our_dockerfile_takes_the_place_of_another() -> None:
    with tarfile.open(
        fileobj=io.BytesIO(context_tar("ours", [ContextFile(path="Dockerfile", content=b"theirs")]))
    ) as tar:
        file = tar.extractfile("Dockerfile")
        assert file is not None
        assert file.read() == b"ours"


def test_long_and_foreign_names() -> None:
    names = ["x" * 150 + "/" + "y" * 150, "grüße"]
    assert set(names) <= members(context_tar("", [ContextFile(path=name) for name in names])).keys()


def test_a_file_and_its_mode() -> None:
    lab = Disk({"/lab/a": b"1", "/lab/b": b"2"}, x=("/lab/b",))
    assert entries_of("files/0", "/lab/a", "", lab.listing, lab.read) == [ContextFile(path="files/0", content=b"1")]
    assert entries_of("files/0", "/lab/b", "", lab.listing, lab.read)[0].mode == 0o755
    assert entries_of("files/0", "/lab/b", "0640", lab.listing, lab.read)[0].mode == 0o640
    for mode in ("rwx", "99", "0o755", "7 5 5", "77777"):
        with pytest.raises(ValueError, match="octal"):
            entries_of("files/0", "/lab/b", mode, lab.listing, lab.read)


def test_a_folder() -> None:
    lab = Disk({"/lab/t/a": b"1", "/lab/t/s/b": b"2"}, links={"/lab/t/l": "a"})
    found = {entry.path: entry for entry in entries_of("files/3", "/lab/t", "0600", lab.listing, lab.read)}
    assert set(found) == {"files/3/a", "files/3/s/b", "files/3/l"}
    assert found["files/3/s/b"].mode == 0o600
    assert found["files/3/l"].link == "a"


@pytest.mark.parametrize("name", ["../x", "a/../b", "a\nb"])
def test_names_that_cannot_be(name: str) -> None:
    lab = Disk({f"/lab/t/{name}": b""})
    with pytest.raises(ValueError, match="name"):
        entries_of("f", "/lab/t", "", lab.listing, lab.read)


@pytest.mark.parametrize(
    ("patterns", "out", "kept"),
    [
        ("*.log", ["a.log"], ["d/a.log", "a.txt"]),
        ("**/*.log", ["a.log", "d/e/a.log"], ["a.txt"]),
        ("build", ["build", "build/x/y"], ["src/build/x"]),
        ("/build/", ["build/x"], ["src/build"]),
        ("a/*/c", ["a/b/c"], ["a/c", "a/b/d/c"]),
        ("a/**", ["a/b", "a/b/c"], ["b"]),
        ("a/**/z", ["a/z", "a/b/c/z"], ["z"]),
        ("?.py", ["a.py"], ["ab.py", ".py/x"]),
        ("[a-c].py", ["b.py"], ["d.py"]),
        ("[^a-c].py", ["d.py"], ["b.py"]),
        (r"[a\-c].py", ["a.py", "-.py", "c.py"], ["b.py"]),
        (r"[\]-\^].py", ["].py", "^.py"], ["[.py", "-.py"]),
        ("[+--].py", ["+.py", ",.py", "-.py"], ["..py"]),
        ("[[&&~~||a-].py", ["[.py", "&.py", "~.py", "|.py", "a.py", "-.py"], ["b.py"]),
        (r"\*.py", ["*.py"], ["a.py"]),
        ("*\n!keep.txt", ["a"], ["keep.txt"]),
        ("*\n!src\nsrc/*.o", ["a", "src/a.o"], ["src/a.c"]),
        ("# a comment\n\n  x  ", ["x"], ["# a comment"]),
        ("./x", ["x"], ["y"]),
        ("a.b+(c)", ["a.b+(c)"], ["axb+(c)"]),
    ],
)
def test_dockerignore(patterns: str, out: list[str], kept: list[str]) -> None:
    rule = ignore_rule(patterns.splitlines())
    assert [path for path in [*out, *kept] if rule(path)] == out


def test_a_dockerfiles_folder() -> None:
    names = ["Dockerfile", ".dockerignore", "src/a.c", "src/a.o", ".git/HEAD", "talker.edf", "experiment.lock", "x.cdf"]
    lab = Disk({f"/lab/{name}": b"" for name in names} | {"/lab/.dockerignore": b"**/*.o\n!x.cdf\n"})
    found = {entry.path for entry in folder_entries("/lab", lab.listing, lab.read)}
    assert found == {"Dockerfile", ".dockerignore", "src/a.c", "x.cdf"}


def test_no_dockerignore_takes_back_what_version_control_keeps() -> None:
    lab = Disk({f"/lab/{name}": b"" for name in ("Dockerfile", ".git/config", "src/.hg/hgrc", "src/a.c")})
    lab.files["/lab/.dockerignore"] = b"!**/.git\n!.git\n!.git/config\n!src/.hg\n"
    found = {entry.path for entry in folder_entries("/lab", lab.listing, lab.read)}
    assert found == {"Dockerfile", ".dockerignore", "src/a.c"}


HOSTILE = {
    "stars": ("*a" * 60 + "b", "a" * 250),
    "folders": ("**/a/" * 40 + "b", "a/" * 500 + "c"),
    "both": ("**/*a*a*a*a*b/" * 12 + "c", "/".join(["a" * 60] * 30)),
    "classes": ("[a-z]*" * 30 + "!", "a" * 250),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_no_pattern_takes_long_on_any_path(case: str) -> None:
    """A star that is tried at every place, for every place of the one before it, would take years."""
    pattern, path = HOSTILE[case]
    ignored = bounded(lambda: [ignore_rule([pattern])(path) for _ in range(20)], cpu_s=1.0)
    assert ignored == [False] * 20


@pytest.mark.parametrize(
    ("pattern", "yes", "no"),
    [
        ("a*b*c", "abc axbxc abbcc a*b*c", "acb ab/c abcd"),
        ("**/*.pyc", "a.pyc b/a.pyc a/b/c.pyc a.pyc/x", "a.py"),
        ("a/**/b", "a/b a/x/b a/x/y/b a/b/c", "ab a/xb"),
        ("a/**/b/**/c", "a/b/c a/x/b/y/c a/b/b/c", "a/c a/b/x"),
        ("a/**", "a/b a/b/c", "a ab"),
        ("**/a/**", "a/b x/a/b", "a x/a"),
        ("**/**/x", "x a/x a/b/x", "ax"),
        ("x[^b]y", "xay", "xby x/y"),
    ],
)
def test_stars_match_as_docker_has_them(pattern: str, yes: str, no: str) -> None:
    ignored = ignore_rule([pattern])
    assert [path for path in yes.split() if not ignored(path)] == []
    assert [path for path in no.split() if ignored(path)] == []


@given(st.text("[]^-\\&~|*?!#.ab/", max_size=12))
@example("+--")
@example("--a")
@example("a&&b")
@example("a~~b||c")
@example("[a")
def test_no_class_makes_python_warn(characters: str) -> None:
    """Sets within sets, which Python may have one day, would be a warning to the user before that."""
    with warnings.catch_warnings(), contextlib.suppress(ValueError):
        warnings.simplefilter("error")
        ignore_rule([f"[{characters}]"])("a")


@pytest.mark.parametrize(
    ("lines", "says"),
    [
        (["[z-a]"], "line 1 of .dockerignore is no pattern"),
        (["x", "a" * 256], "line 2 of .dockerignore is too long"),
        (["*" + "a" * 200] * 10_000, "of .dockerignore comes after too many for so many files"),
    ],
)
def test_a_dockerignore_that_cannot_be_is_refused(lines: list[str], says: str) -> None:
    with pytest.raises(ValueError, match=re.escape(says)):
        bounded(lambda: ignore_rule(lines, 50_000))


@pytest.mark.parametrize("line", ["url = https://me:MINE@git.example/lab", "[branch MINE z-a]", "MINE" * 100])
def test_no_word_of_a_dockerignore_is_shown(line: str) -> None:
    """An archive may have given `.git/config`, or an inventory, that name; how long names there are is a stranger's."""
    ignore = "\n".join([*["x" * 250] * 78, line]).encode()
    lab = Disk({"/lab/.dockerignore": ignore, **{f"/lab/{number:0250}": b"" for number in range(100)}})
    with pytest.MonkeyPatch.context() as patched, pytest.raises(ValueError, match="dockerignore") as told:
        patched.setattr(context, "_MOST_WORK", (78 * 250 + 60) * 250 * 100)
        folder_entries("/lab", lab.listing, lab.read)
    assert re.fullmatch(r"line 79 of \.dockerignore [a-z ]+", str(told.value))


def test_a_context_has_a_size() -> None:
    big = [ListedFile(str(number)) for number in range(300)]
    with pytest.raises(ValueError, match="it holds more than 96 MiB"):
        entries_of("", "/x", "", lambda _: big, lambda _: bytes(1 << 20))
