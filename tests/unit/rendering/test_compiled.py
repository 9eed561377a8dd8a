"""Compiled playbooks are kept, and believed only where compiling would give the same and nobody else could write."""

from __future__ import annotations

import marshal
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from jinja2.sandbox import ImmutableSandboxedEnvironment

from srprov.errors import RenderError
from srprov.rendering import compiled

TEXT = "- file: {{ name }}\n{% for one in many %}\n- 1\n- {{ one }}\n{% endfor %}\n"
RENDERED = '- file: !json "\\"a\\""\n- 1\n- !json "\\"b\\""\n'


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "srprov" / "playbooks"


@pytest.fixture
def compilations(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What was compiled."""
    said: list[str] = []
    real = ImmutableSandboxedEnvironment.compile

    def counted(self: ImmutableSandboxedEnvironment, source: str) -> object:
        said.append(source)
        return real(self, source)

    monkeypatch.setattr(ImmutableSandboxedEnvironment, "compile", counted)
    return said


def rendered(text: str = TEXT) -> str:
    return compiled.template("40-x.yml", text).render(name="a", many=["b"])


def test_what_was_compiled_is_not_compiled_again(compilations: list[str], folder: Path) -> None:
    assert [rendered(), rendered()] == [RENDERED, RENDERED]
    assert compilations == [TEXT]
    (kept,) = folder.iterdir()
    assert [path.stat().st_mode & 0o777 for path in (folder, kept)] == [0o700, 0o600]


def test_another_text_of_a_name_takes_its_place(compilations: list[str], folder: Path) -> None:
    other = TEXT.replace("- 1", "- 2")
    assert [rendered(), rendered(other), rendered(other)] == [RENDERED, *[RENDERED.replace(" 1", " 2")] * 2]
    assert compilations == [TEXT, other] and len(list(folder.iterdir())) == 1


def others_may_write(path: Path, _content: bytes) -> None:
    path.chmod(0o622)


def somebody_elses(path: Path, _content: bytes) -> None:
    os.chown(path, 65534, 65534)


def cut_off(path: Path, content: bytes) -> None:
    path.write_bytes(content[:60])


def no_code(path: Path, content: bytes) -> None:
    path.write_bytes(content[:32] + marshal.dumps("x"))


def of_another_version(path: Path, content: bytes) -> None:
    path.write_bytes(bytes(32) + content[32:])


def a_folder(path: Path, _content: bytes) -> None:
    path.unlink()
    path.mkdir()


def a_pipe(path: Path, _content: bytes) -> None:
    path.unlink()
    os.mkfifo(path, 0o600)


def a_link_to_a_file_of_ones_own(path: Path, _content: bytes) -> None:
    path.symlink_to(path.rename(path.parents[3] / "cloned"))


def a_link_to_a_folder_of_ones_own(path: Path, _content: bytes) -> None:
    path.parent.symlink_to(path.parent.rename(path.parents[3] / "cloned"))


def a_folder_above_is_such_a_link(path: Path, _content: bytes) -> None:
    path.parents[1].symlink_to(path.parents[1].rename(path.parents[3] / "cloned"))


def in_a_folder_of_somebody_elses(path: Path, _content: bytes) -> None:
    os.chown(path.parents[2], 65534, 65534)


def by_a_link_of_somebody_elses(path: Path, _content: bytes) -> None:
    path.parents[2].symlink_to(path.parents[2].rename(path.parents[3] / "cloned"))
    os.lchown(path.parents[2], 65534, 65534)


def where_everybody_may_write(path: Path, _content: bytes) -> None:
    path.parents[2].chmod(0o777)


def where_a_group_may_write(path: Path, _content: bytes) -> None:
    """They rename what is there: a repository of the user's takes the folder's place."""
    os.chown(path.parents[2], -1, 65534)
    path.parents[2].chmod(0o775)


STRANGERS = [
    others_may_write, somebody_elses, cut_off, no_code, of_another_version, a_folder, a_pipe,
    a_link_to_a_file_of_ones_own, a_link_to_a_folder_of_ones_own, a_folder_above_is_such_a_link,
    in_a_folder_of_somebody_elses,
    by_a_link_of_somebody_elses, where_everybody_may_write, where_a_group_may_write,
]  # fmt: skip


@pytest.mark.parametrize("spoil", STRANGERS)
def test_a_file_that_is_not_to_be_trusted_is_not(
    spoil: Callable[[Path, bytes], None], compilations: list[str], folder: Path
) -> None:
    rendered()
    (kept,) = folder.iterdir()
    spoil(kept, kept.read_bytes())
    assert rendered() == RENDERED and len(compilations) == 2


def test_nothing_is_written_by_way_of_a_link(tmp_path: Path, folder: Path) -> None:
    rendered()
    for one in folder.iterdir():
        one.unlink()
    folder.symlink_to(folder.rename(tmp_path / "cloned"))
    assert rendered() == RENDERED and not list((tmp_path / "cloned").iterdir())


def test_folders_that_all_may_write_to_keep_their_names_by_the_sticky_bit_and_own_links_are_followed(
    compilations: list[str], folder: Path
) -> None:
    rendered()
    base = folder.parents[1]
    base.chmod(0o1777)
    base.symlink_to(base.rename(base.with_name("elsewhere")))
    assert rendered() == RENDERED and len(compilations) == 1


def test_the_user_s_own_group_is_nobody_else(compilations: list[str], folder: Path) -> None:
    """Many systems give each user one, and a umask of 002."""
    rendered()
    folder.parents[1].chmod(0o775)
    assert rendered() == RENDERED and len(compilations) == 1


def test_a_fault_is_told_every_time(folder: Path) -> None:
    for _ in range(2):
        with pytest.raises(RenderError, match="must be a whole YAML value"):
            rendered("- file: ros-{{ name }}\n")
    assert not folder.exists()


def test_without_a_folder_all_is_compiled(
    tmp_path: Path, compilations: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert [rendered(), rendered()] == [RENDERED, RENDERED] and len(compilations) == 2
