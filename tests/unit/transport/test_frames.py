from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from srprov.transport.shell.frames import Frames, batch, ready_line, start_command
from srprov.wire import quote
from tests.conftest import examples

NONCE = "0123456789abcdef" * 2
SHELLS = [["dash"], ["busybox", "sh"], ["bash", "--posix"]]
SHELLS = [shell for shell in SHELLS if shutil.which(shell[0])]


def stream(*answers: tuple[bytes, int], noise: bytes = b"") -> bytes:
    text = noise + f"\n{NONCE} begin 0\n".encode()
    for index, (output, status) in enumerate(answers):
        text += output + f"\n{NONCE} {index} {status}\n".encode()
    return text


@given(
    st.lists(st.tuples(st.binary(max_size=60), st.integers(0, 255)), max_size=5),
    st.binary(max_size=20),
    st.lists(st.integers(1, 40), min_size=1, max_size=30),
)
def test_answers_survive_any_cut(answers: list[tuple[bytes, int]], noise: bytes, sizes: list[int]) -> None:
    frames, text, turn = Frames(NONCE, len(answers)), stream(*answers, noise=noise), 0
    while text:
        size = sizes[turn % len(sizes)]
        frames.feed(text[:size])
        text, turn = text[size:], turn + 1
    assert frames.done
    assert frames.answers == answers


def test_output_that_looks_like_a_boundary_is_output() -> None:
    almost = f"\n{NONCE[:-1]}0 0 0\n{NONCE}\n\n{NONCE}".encode()
    frames = Frames(NONCE, 1)
    frames.feed(stream((almost, 3)))
    assert frames.answers == [(almost, 3)]


def test_a_boundary_out_of_order_is_an_error() -> None:
    frames = Frames(NONCE, 2)
    with pytest.raises(ValueError, match="'1' where '0'"):
        frames.feed(f"\n{NONCE} begin 0\n\n{NONCE} 1 0\n".encode())


@given(st.lists(st.sampled_from(["a", "bb", "", "ä"]), max_size=6), st.integers(1, 7))
def test_lines_come_once_and_whole(lines: list[str], size: int) -> None:
    frames, text, seen = Frames(NONCE, 1), stream(("\n".join(lines).encode(), 0), noise=b"noise\n"), []
    while text:
        frames.feed(text[:size])
        seen += list(frames.new_lines())
        text = text[size:]
        if frames.done:
            break
    assert seen == [line for line in lines if line]


def test_ten_mib_are_cut_in_linear_time() -> None:
    frames, piece = Frames(NONCE, 1), b"\n" * 65536
    frames.feed(f"\n{NONCE} begin 0\n".encode())
    for _ in range(160):
        frames.feed(piece)
    frames.feed(f"\n{NONCE} 0 0\n".encode())
    assert len(frames.answers[0][0]) == 160 * 65536


@pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])
@settings(max_examples=examples(40), deadline=None)
@given(st.lists(st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=30), max_size=8))
def test_quote_and_batch_give_back_any_words(shell: list[str], words: list[str]) -> None:
    """Every word passes `quote` twice: once in its command, and the whole command once more on its way into `eval`."""
    commands = [f"printf %s {quote(word)}; printf %s {quote(word)} >&2; (exit {i + 1})" for i, word in enumerate(words)]
    done = subprocess.run(shell, input=batch(NONCE, commands), capture_output=True, check=False, timeout=20)
    for text in (done.stdout, done.stderr):
        frames = Frames(NONCE, len(words))
        frames.feed(text)
        assert frames.answers == [(word.encode(), i + 1) for i, word in enumerate(words)]


@pytest.mark.parametrize("shell", SHELLS, ids=lambda shell: shell[0])
def test_a_bad_command_is_one_bad_answer(shell: list[str]) -> None:
    bad = ["exit 7", "echo 'x", "if", ")", "cat", "cat <<E", "exec false", "set -u; echo $nothing", "\\", "return 5"]
    commands = [c for one in bad for c in (one, "echo fine")]
    done = subprocess.run(shell, input=batch(NONCE, commands), capture_output=True, check=False, timeout=20)
    frames = Frames(NONCE, len(commands))
    frames.feed(done.stdout)
    assert frames.done
    assert [answer for answer in frames.answers[1::2]] == [(b"fine\n", 0)] * len(bad)
    assert frames.answers[0] == (b"", 7)


def test_a_nul_byte_is_refused() -> None:
    with pytest.raises(ValueError, match="NUL"):
        batch(NONCE, ["echo \0"])


@pytest.mark.parametrize("login", [["sh", "-c"], ["bash", "-c"], ["zsh", "-c"], ["fish", "-c"], ["csh", "-c"]])
@pytest.mark.parametrize("root", [True, False])
def test_start_command_in_each_login_shell(
    login: list[str], root: bool, tmp_path_factory: pytest.TempPathFactory
) -> None:
    if not shutil.which(login[0]):
        pytest.skip(f"no {login[0]} here")
    folder = tmp_path_factory.mktemp("bin")
    # A sudo and an id of our own: the line must work for a user who has to become root.
    (folder / "sudo").write_text('#!/bin/sh\n[ "$1" = -n ] || exit 9\nshift\nVIA=sudo; export VIA; exec "$@"\n')
    (folder / "id").write_text("#!/bin/sh\necho 1000\n")
    for file in folder.iterdir():
        file.chmod(0o755)
    done = subprocess.run(
        [*login, start_command(NONCE, "sh", root=root)],
        input=b'echo "$VIA:$LC_ALL:$PATH:$(umask):$(pwd)"\n',
        capture_output=True, check=False, env={"PATH": f"{folder}:/usr/bin:/bin", "HOME": "/nowhere"},
    )  # fmt: skip
    before, _, after = done.stdout.partition(ready_line(NONCE))
    assert (before, done.stderr) == (b"", b"")
    via, locale, *path, mask, cwd = after.decode().strip().split(":")
    assert (via, locale, mask, cwd) == ("" if root else "sudo", "C", "0022", "/")
    assert {"/usr/sbin", "/usr/local/bin", str(folder)} <= set(path) and "" not in path


@pytest.mark.parametrize("path", ["", ":", ".:/usr/bin", "/usr/bin:", "/a b:x:/usr/bin:*:~/bin::/bin", "/usr/bin:/*"])
@pytest.mark.parametrize("shell", SHELLS, ids=lambda one: one[0])
def test_no_folder_where_root_reads_gives_it_programs_or_libraries(shell: list[str], path: str, tmp_path: Path) -> None:
    """A container puts them in its volume, and waits until root enters that."""
    loader = {name: f"/usr/local/cuda/lib64:{tmp_path}:" for name in ("LD_LIBRARY_PATH", "LD_AUDIT")}
    bin_ = tmp_path / "bin"
    bin_.mkdir()
    (bin_ / "sh").symlink_to(shutil.which(shell[0]) or "")
    applet = shell[1:2]  # busybox goes by its name
    command = start_command(NONCE, "/usr/bin/env", root=True).removeprefix("exec ")
    done = subprocess.run(
        [shutil.which(shell[0]) or "", *applet, "-c", command.replace("sh -c", " ".join([f"{bin_}/sh", "-c"]), 1)],
        capture_output=True, check=True, env={"PATH": path, **loader, "LD_PRELOAD": ""}, cwd=tmp_path,
    )  # fmt: skip
    found = dict(line.partition("=")[::2] for line in done.stdout.partition(ready_line(NONCE))[2].decode().splitlines())
    parts = found["PATH"].split(":")
    assert all(one.startswith("/") for one in parts) and parts[-7:][0] == "/usr/local/sbin"
    assert parts[:-7] == [one for one in path.split(":") if one.startswith("/")]
    assert not {name for name in found if name.startswith("LD_")} and {"p", "d"}.isdisjoint(found)
