"""`secrets`: where they come from, which container gets them, and how their values are read."""

from __future__ import annotations

import contextlib
import os
import re
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from srprov import private
from srprov.definitions import check_files, load_experiment
from srprov.definitions.secretmodel import SecretSource, SecretUse, is_gone_by
from srprov.definitions.secretvalues import resolve, used
from srprov.errors import DefinitionError, Location
from srprov.planning.policy import permissions
from srprov.secret import forget, redact


@pytest.fixture(autouse=True)
def _none_left() -> Iterator[None]:
    """Secrets are known to the whole process: no test sees those of another."""
    forget()
    yield
    forget()


def write(folder: Path, service: str, secrets: str = "token: {env: TOKEN}") -> Path:
    """Write an EDF with one service; line 4 is the service, line 5 what it adds, line 7 the first secret."""
    path = folder / "e.edf"
    path.write_text(f"edf: 1\nname: e\nservices:\n  a: {{image: x, {service}}}\n\nsecrets:\n  {secrets}\n")
    return path


@pytest.mark.parametrize(
    ("given", "uses"),
    [
        ("secrets: [token]", [SecretUse(source="token", target="/run/secrets/token", mode="0400")]),
        ("secrets: [{source: token}]", [SecretUse(source="token", target="/run/secrets/token", mode="0400")]),
        (
            "secrets: [{source: token, target: t/x, mode: 0444}, token]",
            [
                SecretUse(source="token", target="/run/secrets/t/x", mode="0444"),
                SecretUse(source="token", target="/run/secrets/token", mode="0400"),
            ],
        ),
        (
            "secrets: [{source: token, target: /etc/app/key, mode: '440'}]",
            [SecretUse(source="token", target="/etc/app/key", mode="0440")],
        ),
        ("secrets: []", []),
    ],
)
def test_both_forms(tmp_path: Path, given: str, uses: list[SecretUse]) -> None:
    """A name alone, or a map with target and mode, as in Compose; mode is octal however it is written."""
    experiment = load_experiment(write(tmp_path, given), {}).experiment
    assert list(experiment.services["a"].secrets) == uses
    assert [source.name for source in used(experiment)] == (["token"] if uses else [])


def test_sources(tmp_path: Path) -> None:
    """Paths are relative to the EDF or to the home; a command is words, or text that is split like a shell's."""
    text = "a: {env: A_B}\n  b: {file: keys/b}\n  c: {file: ~/b}\n  d: {command: [pass, show, a b]}\n"
    sources = load_experiment(write(tmp_path, "", text + "  e: {command: pass show 'a b'}"), {}).experiment.secrets
    assert list(sources) == ["a", "b", "c", "d", "e"]
    assert (sources["a"].env, sources["b"].file) == ("A_B", f"{tmp_path}/keys/b")
    assert sources["c"].file == os.path.expanduser("~/b")
    assert sources["d"].command == sources["e"].command == ("pass", "show", "a b")
    assert sources["a"].location == Location(str(tmp_path / "e.edf"), 7, 12)


def test_a_file_is_what_a_link_leads_to(tmp_path: Path) -> None:
    """A stranger's `./token.txt` may lead to any key of the user's: what the permission says is what is read."""
    (tmp_path / "key").write_text("decoy")
    (tmp_path / "e").mkdir()
    (tmp_path / "e/token.txt").symlink_to("../key")
    path = write(tmp_path / "e", "secrets: [token]", "token: {file: ./token.txt}")
    found = load_experiment(path, {}).experiment
    assert found.secrets["token"].origin == f"the file {tmp_path}/key"
    assert [one.what for one in permissions(found)] == [f"token, from the file {tmp_path}/key"]
    assert resolve(found.secrets.values(), {}).content("token") == b"decoy"


def test_a_link_that_is_put_in_a_files_place_afterwards_is_not_read(tmp_path: Path) -> None:
    """Nor one that a plan file names: what it shows would not be what is read."""
    (tmp_path / "key").write_text("decoy")
    (tmp_path / "token.txt").symlink_to("key")
    with pytest.raises(DefinitionError) as caught:
        read(source(file=f"{tmp_path}/token.txt"))
    assert "it changed while it was read" in caught.value.problems[0].message


@pytest.mark.parametrize(
    ("service", "secrets", "line", "message"),
    [
        ("secrets: [tokn]", "token: {env: T}", 4, "there is no secret 'tokn'"),
        ("secrets: [{target: x}]", "token: {env: T}", 4, "source"),
        ("secrets: [{source: token, uid: 1}]", "token: {env: T}", 4, "uid"),
        ("secrets: [{source: token, mode: 999}]", "token: {env: T}", 4, "octal"),
        ("secrets: [token, {source: token}]", "token: {env: T}", 4, "mounted twice"),
        ("secrets: [{source: token, target: ../..}]", "token: {env: T}", 4, "no place for a file"),
        ("secrets: [{source: token, target: /d}], volumes: ['v:/d']", "token: {env: T}", 4, "where a volume is"),
        ("secrets: [token], volumes: ['v:/run:ro']", "token: {env: T}", 4, "where a volume is mounted"),
        ("", "token: {env: A, file: b}", 7, "exclude"),
        ("", "token: {env: A, value: hunter2}", 7, "value"),
        ("", "token: {}", 7, ""),
        ("", "token: hunter2", 7, "a map"),
        ("", "'../token': {env: A}", 7, "letters, digits"),
        ("", "token: {command: []}", 7, "must not be empty"),
        ("", 'token: {command: "\'"}', 7, "split into words"),
        ("environment: {T: '${{ secrets.token }}'}", "token: {env: A}", 4, "'environment' is not supported"),
        ("environment: ['T={{secrets.token}}']", "token: {env: A}", 4, "'environment' is not supported"),
        ("command: 'run --key ${secret:token}'", "token: {env: A}", 4, "'command' is not supported"),
        ("entrypoint: [run, 'secret://token']", "token: {env: A}", 4, "'entrypoint' is not supported"),
    ],
)
def test_what_is_wrong_is_told_at_its_line(tmp_path: Path, service: str, secrets: str, line: int, message: str) -> None:
    """Unknown names, wrong places, and secrets where Docker would show them; validate says all of it."""
    problems = check_files([write(tmp_path, service, secrets)])
    assert [(one.location.line, message in one.message) for one in problems] == [(line, True)], problems


def test_a_secret_in_the_environment_names_the_way_out(tmp_path: Path) -> None:
    """The hint says where to list it and where to read it."""
    (problem,) = check_files([write(tmp_path, "environment: {T: '${{ secrets.token }}'}")])
    assert "/run/secrets/NAME" in problem.hint


def test_validate_and_definitions_need_no_value(tmp_path: Path) -> None:
    """Reading an experiment touches no variable, no file and no command of a secret."""
    ran = tmp_path / "ran"
    text = f"a: {{env: NOT_THERE}}\n  b: {{file: not-there}}\n  c: {{command: [touch, {ran}]}}"
    path = write(tmp_path, "secrets: [a, b, c]", text)
    assert check_files([path]) == []
    assert load_experiment(path, {}).unsupported == ()
    assert not ran.exists()


def source(**more: object) -> SecretSource:
    """Return the source of a secret `t` at line 7."""
    return SecretSource(name="t", location=Location("e.edf", 7, 3), excerpt="  t: …", **more)  # type: ignore[arg-type]


def read(one: SecretSource, environ: dict[str, str] | None = None, deadline_s: float = 20.0) -> bytes:
    """Resolve one source."""
    return resolve([one], {} if environ is None else environ, deadline_s).content("t")


def python(code: str) -> SecretSource:
    """Return a source that runs a program of Python."""
    return source(command=(sys.executable, "-c", code))


def test_a_variable_leaves_the_environment() -> None:
    """No program that is started later inherits the value, not even the command of another secret."""
    environ = {"TOKEN": "hunter2-env", "OTHER": "x", "PATH": os.environ["PATH"]}
    show = "import os; print(os.environ.get('TOKEN', 'gone'), os.environ['OTHER'])"
    two = SecretSource(name="two", command=(sys.executable, "-c", show))
    vault = resolve([source(env="TOKEN"), two], environ)
    assert (vault.content("t"), vault.content("two")) == (b"hunter2-env", b"gone x")
    assert "TOKEN" not in environ and "OTHER" in environ
    assert redact("hunter2-env") == "***"


def test_two_secrets_of_one_variable() -> None:
    """Both get it, though it is taken out of the environment."""
    vault = resolve([source(env="A"), SecretSource(name="u", env="A")], {"A": "value-a"})
    assert vault.content("t") == vault.content("u") == b"value-a"


@pytest.mark.parametrize("content", [b"four", b"line\n", b"\n line \n\n", bytes(range(256))])
def test_a_file_is_taken_byte_for_byte(tmp_path: Path, content: bytes) -> None:
    """With its newlines, and when it is no text at all."""
    (tmp_path / "f").write_bytes(content)
    assert read(source(file=str(tmp_path / "f"))) == content


@pytest.mark.parametrize(
    ("printed", "value"),
    [
        (b"abcd\n", b"abcd"),
        (b"abcd\r\n", b"abcd"),
        (b"abcd", b"abcd"),
        (b"ab\ncd\n\n", b"ab\ncd\n"),
        (b"\xff\xfeab", b"\xff\xfeab"),
    ],
)
def test_a_command_loses_one_newline(printed: bytes, value: bytes) -> None:
    """Programs end what they print with one; the rest is the value."""
    assert read(python(f"import sys; sys.stdout.buffer.write({printed!r})")) == value


def test_a_command_runs_without_a_shell_in_the_folder_of_the_edf(tmp_path: Path) -> None:
    """Its words are its words; nothing is expanded, and it reads nothing."""
    echo = SecretSource(name="t", command=("printf", "%s", "$HOME;`id`"), folder=str(tmp_path))
    assert resolve([echo], {"PATH": os.environ["PATH"]}).content("t") == b"$HOME;`id`"
    where = SecretSource(name="t", command=("sh", "-c", "pwd; cat"), folder=str(tmp_path))
    assert resolve([where], {"PATH": os.environ["PATH"]}).content("t") == str(tmp_path).encode()


def failure(one: SecretSource, **more: object) -> str:
    """Resolve a source that gives no value; give the message of its only problem."""
    with pytest.raises(DefinitionError) as caught:
        read(one, **more)  # type: ignore[arg-type]
    (problem,) = caught.value.problems
    assert (problem.location, problem.path) == (Location("e.edf", 7, 3), "secrets.t")
    assert caught.value.exit_code == 5
    return problem.message


def test_what_gives_no_value_is_told_at_the_line_of_the_edf(tmp_path: Path) -> None:
    """A missing variable, file or program, an unreadable file, a value that is too short or too large."""
    assert "has no 'NONE'" in failure(source(env="NONE"))
    assert "No such file" in failure(source(file=str(tmp_path / "none")))
    assert "Is a directory" in failure(source(file=str(tmp_path)))
    assert "No such file" in failure(source(command=("no-such-program-at-all",)))
    assert "at least 4 characters" in failure(source(env="A"), environ={"A": "abc"})
    (tmp_path / "large").write_bytes(b"x" * 600_000)
    assert "larger than" in failure(source(file=str(tmp_path / "large")))
    assert "larger than" in failure(python("print('x' * 3_000_000)"))
    assert "larger than" in failure(python("while True: print('x' * 1000)"))


def test_everything_that_is_missing_is_told_at_once() -> None:
    """One run is enough to learn what to set."""
    with pytest.raises(DefinitionError) as caught:
        resolve([source(env="A"), SecretSource(name="u", env="B")], {})
    assert len(caught.value.problems) == 2


def test_a_failed_command_shows_its_complaint_without_what_it_printed() -> None:
    """It may have printed the value before it failed, and may repeat it in its complaint."""
    message = failure(python("import sys; print('hunter2-out'); sys.exit('cannot: hunter2-out is locked')"))
    assert "ended with 1: cannot: *** is locked" in message
    assert "hunter2" not in message


def test_the_complaint_of_a_command_that_works_is_not_shown(capfd: pytest.CaptureFixture[str]) -> None:
    """Not even on the terminal."""
    assert read(python("import sys; print('value'); print('noise', file=sys.stderr)")) == b"value"
    assert capfd.readouterr() == ("", "")


def running(group: int) -> list[str]:
    """Return the processes of a group that are not dead; in a container nobody may collect those that are."""
    found = []
    for one in psutil.process_iter():
        with contextlib.suppress(psutil.Error, ProcessLookupError):
            if os.getpgid(one.pid) == group and one.status() != psutil.STATUS_ZOMBIE:
                found.append(str(one))
    return found


@pytest.mark.parametrize("how", ["sleep 60", "exec 1>&- 2>&-; sleep 60", "sleep 60 & echo value"])
def test_a_command_has_a_deadline(tmp_path: Path, how: str) -> None:
    """One that hangs, says nothing more, or leaves something behind that holds its output; nothing of it goes on."""
    mark = tmp_path / "pid"
    begun = time.monotonic()
    message = failure(source(command=("sh", "-c", f"echo $$ >{mark}; {how}")), deadline_s=0.5,
                      environ={"PATH": os.environ["PATH"]})  # fmt: skip
    assert "did not end within 0.5 s" in message
    assert time.monotonic() - begun < 10
    while left := running(int(mark.read_text())):  # the kernel takes a moment to end what was killed
        assert time.monotonic() - begun < 10, left
        time.sleep(0.05)


@pytest.mark.parametrize(
    "name", ["XDG_STATE_HOME", "XDG_CONFIG_HOME", "HOME", "SRPROV_RUNS", "SUDO_UID", "SSH_AUTH_SOCK"]
)
def test_no_variable_that_srprov_goes_by_is_a_secret(tmp_path: Path, name: str) -> None:
    """It would leave the environment: which files secrets were read from would be noted where nobody looks again."""
    with pytest.raises(DefinitionError) as told:
        load_experiment(write(tmp_path, "secrets: [token]", f"token: {{env: {name}}}"), {})
    assert [one.message.partition(", and")[0] for one in told.value.problems] == [
        f"'{name}' is a variable that srprov itself goes by"
    ]


def test_what_srprov_goes_by_is_known() -> None:
    """Each variable that it looks at by name."""
    sources = Path(private.__file__).parent.rglob("*.py")
    looked_at = {name for one in sources for name in re.findall(r'\benviron(?:\.get\(|\[)"(\w+)"', one.read_text())}
    assert {"HOME", "XDG_STATE_HOME", "DOCKER_HOST"} <= looked_at
    assert not [name for name in looked_at if not is_gone_by(name)]
