from __future__ import annotations

import base64
import hashlib
import hmac
import shlex
import subprocess
from pathlib import Path

import pytest

from srprov.errors import HostKeyError
from srprov.transport.openssh import host_keys, revoked
from srprov.transport.openssh.host_keys import check, fingerprint, known_keys, matches, names_of
from srprov.transport.openssh.settings import SshSettings

NAMED = (("userknownhostsfile", "by the inventory"),)
BLOB, OTHER = b"\0\0\0\x0bssh-ed25519one", b"\0\0\0\x0bssh-ed25519two"


def b64(blob: bytes) -> str:
    return base64.b64encode(blob).decode()


def settings(file: Path, **more: object) -> SshSettings:
    values = {
        "name": "r1",
        "address": "bot",
        "hostname": "Bot.lan",
        "port": 22,
        "user": "root",
        "known_hosts": (str(file),),
    }
    return SshSettings(**{**values, **more})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("patterns", "name", "expected"),
    [
        ("bot.lan", "bot.lan", True),
        ("BOT.lan", "bot.lan", True),
        ("other,bot.lan", "bot.lan", True),
        ("*.lan", "bot.lan", True),
        ("bot?lan", "bot.lan", True),
        ("*.lan,!bot.lan", "bot.lan", False),
        ("!bot.lan,*.lan", "bot.lan", False),
        ("bot.lan", "[bot.lan]:2222", False),
        ("[bot.lan]:2222", "[bot.lan]:2222", True),
        ("[bot.lan]:*", "[bot.lan]:2222", True),
        ("[bot.lan]:2222", "b", False),
        ("|1|broken", "bot.lan", False),
        ("|1|@@|@@", "bot.lan", False),
    ],
)
def test_matches(patterns: str, name: str, expected: bool) -> None:
    assert matches(patterns, name) is expected


def test_hashed_names() -> None:
    salt = b"0123456789abcdefghij"
    digest = hmac.new(salt, b"[bot.lan]:2222", hashlib.sha1).digest()
    field = f"|1|{b64(salt)}|{b64(digest)}"
    assert matches(field, "[bot.lan]:2222")
    assert not matches(field, "bot.lan")


def test_names_follow_port_and_alias(tmp_path: Path) -> None:
    assert names_of(settings(tmp_path)) == ("bot.lan", None)
    assert names_of(settings(tmp_path, port=2222)) == ("[bot.lan]:2222", "bot.lan")
    assert names_of(settings(tmp_path, port=2222, host_key_alias="The-Bot")) == ("the-bot", None)


def test_broken_lines_are_skipped_and_lines_are_counted(tmp_path: Path) -> None:
    file = tmp_path / "known"
    file.write_bytes(
        b"# comment\n\nbot.lan\nbot.lan ssh-rsa !!!notbase64\n\xff\xfe x y\n@revoked bot.lan ssh-rsa "
        + b64(OTHER).encode() + b"\nbot.lan ssh-ed25519 " + b64(BLOB).encode() + b" a comment\n"
    )  # fmt: skip
    found = known_keys([str(tmp_path / "missing"), str(file)], "bot.lan", None)
    assert [(k.line, k.marker, k.blob) for k in found] == [(6, "@revoked", OTHER), (7, "", BLOB)]


@pytest.mark.parametrize("line", ["", f"[bot.lan]:2222 ssh-ed25519 {b64(OTHER)}\n"])
def test_the_key_of_a_bare_name_is_that_of_whoever_has_port_22(tmp_path: Path, line: str) -> None:
    """A gateway forwards a port to each robot, and would else pass for all of them."""
    file = tmp_path / "known"
    file.write_text(f"bot.lan ssh-ed25519 {b64(BLOB)}\n{line}")
    where = settings(file, port=2222)
    with pytest.raises(HostKeyError, match="changed" if line else "unknown"):
        check(where, known_keys([str(file)], *names_of(where)), "ssh-ed25519", BLOB)


def test_a_key_that_is_revoked_by_a_bare_name_is_so_at_every_port(tmp_path: Path) -> None:
    file = tmp_path / "known"
    file.write_text(f"@revoked bot.lan ssh-ed25519 {b64(BLOB)}\n[bot.lan]:2222 ssh-ed25519 {b64(BLOB)}\n")
    where = settings(file, port=2222)
    with pytest.raises(HostKeyError, match="@revoked"):
        check(where, known_keys([str(file)], *names_of(where)), "ssh-ed25519", BLOB)


def test_one_of_several_keys_is_enough(tmp_path: Path) -> None:
    file = tmp_path / "known"
    file.write_text(f"bot.lan ssh-ed25519 {b64(OTHER)}\nbot.lan ssh-ed25519 {b64(BLOB)}\n")
    check(settings(file), known_keys([str(file)], "bot.lan", None), "ssh-ed25519", BLOB)


def test_a_certificate_authority_is_not_taken_for_the_key(tmp_path: Path) -> None:
    file = tmp_path / "known"
    file.write_text(f"@cert-authority *.lan ssh-ed25519 {b64(BLOB)}\n")
    with pytest.raises(HostKeyError, match="@cert-authority"):
        check(settings(file), known_keys([str(file)], "bot.lan", None), "ssh-ed25519", BLOB)


def test_hints_fit_how_the_robot_is_reached(tmp_path: Path) -> None:
    def hint(**more: object) -> str:
        with pytest.raises(HostKeyError) as caught:
            check(settings(tmp_path / "k", **more), [], "ecdsa-sha2-nistp256", BLOB)
        return caught.value.hint

    assert f"ssh-keyscan -t ecdsa Bot.lan >> {tmp_path}/k" in hint()
    assert "ssh-keyscan -p 2222 -t ecdsa" in hint(port=2222)
    assert "ssh bot" in hint(proxy_jump=("gate",)) and "ssh-keyscan" not in hint(proxy_jump=("gate",))
    assert "ssh -o 'HostKeyAlias=[bot.lan]:2222' bot" in hint(proxy_jump=("gate",), port=2222)
    assert "name a file" in hint(known_hosts=("/dev/null",))
    assert "ssh_host_ecdsa_key.pub" in hint()
    # by an inventory's word no name stands in a file that somebody may run, by whomever it is written
    assert "ssh-keyscan -H -t ecdsa Bot.lan" in hint(inherited=NAMED)
    assert "ssh-keyscan -t ecdsa 10.0.0.7" in hint(inherited=NAMED, hostname="10.0.0.7")


def test_accept_new_hashes_names_when_asked(tmp_path: Path) -> None:
    file = tmp_path / "new folder" / "known"
    where = settings(file, accept_new=True, hash_known_hosts=True)
    check(where, [], "ssh-ed25519", BLOB)
    assert file.read_text().startswith("|1|") and file.stat().st_mode & 0o777 == 0o600
    check(where, known_keys([str(file)], "bot.lan", None), "ssh-ed25519", BLOB)
    assert len(file.read_text().splitlines()) == 1


@pytest.mark.parametrize("name", ["*", "x,robot1", "!robot1", "x robot1", "ä"])
def test_a_name_that_known_hosts_would_read_as_others_is_hashed(tmp_path: Path, name: str) -> None:
    """A project's inventory may have any name as an address: its line must speak of no other robot."""
    file = tmp_path / "known"
    check(settings(file, accept_new=True, hostname=name), [], "ssh-ed25519", BLOB)
    assert file.read_text().startswith("|1|") and not known_keys([str(file)], "robot1", None)
    assert known_keys([str(file)], name, None)


@pytest.mark.parametrize("name", ["authorized_keys", ".bashrc", "linked/known_hosts", "twice/known_hosts", "null"])
def test_an_inventory_has_a_key_written_to_no_file_but_one_of_host_keys(tmp_path: Path, name: str) -> None:
    """In `authorized_keys`, `pty ssh-ed25519 …` lets whoever has that key log in; and a link may lead there."""
    kept = tmp_path / "authorized_keys"
    kept.write_text("ssh-ed25519 AAAA me\n")
    for folder in ("linked", "twice"):
        (tmp_path / folder).mkdir()
    (tmp_path / "linked/known_hosts").symlink_to("../authorized_keys")
    (tmp_path / "twice/known_hosts").hardlink_to(kept)
    (tmp_path / "null").symlink_to("/dev/null")
    file = tmp_path / name
    with pytest.raises(HostKeyError) as caught:
        check(settings(file, accept_new=True, inherited=NAMED, hostname="pty"), [], "ssh-ed25519", BLOB)
    assert "it is not written to" in caught.value.message and f">> {file}" not in caught.value.hint
    assert kept.read_text() == "ssh-ed25519 AAAA me\n" and not (tmp_path / ".bashrc").exists()


@pytest.mark.parametrize("name", ["known_hosts", "lab-known_hosts", "new/known_hosts2", "KnownHosts.lab"])
def test_an_inventory_has_a_key_written_to_a_file_of_host_keys(tmp_path: Path, name: str) -> None:
    where = settings(tmp_path / name, accept_new=True, inherited=NAMED)
    check(where, [], "ssh-ed25519", BLOB)
    assert [one.blob for one in known_keys(where.known_hosts, *names_of(where))] == [BLOB]


def test_fingerprint_is_openssh_s() -> None:
    blob = base64.b64decode("AAAAC3NzaC1lZDI1NTE5AAAAIOMqqnkVzrm0SdG6UOoqKLsabgH5C9okWi0dh2l9GKJl")
    assert fingerprint(blob) == "SHA256:+DiY3wvvV6TuJJhbpZisF/zLDA0zPMSvHdkr4UvCOqU"


def test_a_file_is_read_once_for_all_robots_and_again_when_it_has_changed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A thousand robots have a thousand lines: to go through all of them for each takes the square of time."""
    file, looks = tmp_path / "known", []
    file.write_text("".join(f"r{number},10.0.0.{number} ssh-ed25519 AAAA\n" for number in range(9)))
    asked = host_keys.matches
    monkeypatch.setattr(host_keys, "matches", lambda *words: looks.append(words) or asked(*words))
    for number in range(9):
        assert [one.line for one in host_keys.known_keys([str(file)], f"r{number}", None)] == [number + 1]
    assert len(looks) == 9
    file.write_text("!r1,r* ssh-ed25519 AAAA\nR3 ssh-rsa AAAA\n")
    assert [one.line for one in host_keys.known_keys([str(file)], "r3", None)] == [1, 2]
    assert host_keys.known_keys([str(file)], "r1", None) == []


@pytest.mark.parametrize(
    "more", [{"host_key_alias": "source"}, {"hostname": "make"}, {"hostname": "a.b", "port": 2202}]
)
@pytest.mark.parametrize("name", [".bashrc.d/known_hosts", "fish/conf.d/known_hosts.fish"])
def test_no_word_of_an_inventory_stands_in_a_file_that_it_names(
    tmp_path: Path, name: str, more: dict[str, object]
) -> None:
    file = tmp_path / name
    where = settings(file, accept_new=True, hash_known_hosts=False, inherited=NAMED, **more)
    check(where, [], "ssh-ed25519", BLOB)
    assert file.read_text().startswith("|1|")  # a shell that runs all files of a folder would run the name
    known = known_keys([str(file)], *names_of(where))
    assert [one.blob for one in known] == [BLOB]
    check(where, known, "ssh-ed25519", BLOB)


@pytest.mark.parametrize(
    ("hostname", "port", "written"),
    [("10.0.0.7", 22, "10.0.0.7"), ("10.0.0.7", 2202, "[10.0.0.7]:2202"), ("fd00::7", 22, "fd00::7"),
     ("fe80::1%source", 22, "|1|")],
)  # fmt: skip
def test_an_address_is_written_as_it_is(tmp_path: Path, hostname: str, port: int, written: str) -> None:
    file = tmp_path / "known_hosts"
    check(settings(file, accept_new=True, inherited=NAMED, hostname=hostname, port=port), [], "ssh-ed25519", BLOB)
    assert file.read_text().startswith(written)


def test_a_name_stands_in_the_user_s_own_file(tmp_path: Path) -> None:
    file = tmp_path / "known_hosts"
    check(settings(file, accept_new=True), [], "ssh-ed25519", BLOB)
    assert file.read_text().startswith("bot.lan ssh-ed25519 ")


@pytest.mark.parametrize(
    "more", [{"proxy_jump": ("gate",)}, {"host_key_alias": "the-bot"}, {"port": 2222, "proxy_command": "x"}]
)
def test_the_command_that_asks_names_the_address_and_no_robot(tmp_path: Path, more: dict[str, object]) -> None:
    """A robot of a stranger's experiment may be called `user@host`: that is where the command would lead."""
    of_robot = settings(tmp_path / "known", name="trap@203.0.113.9", **more)
    with pytest.raises(HostKeyError) as unknown:
        check(of_robot, [], "ssh-ed25519", BLOB)
    command = shlex.split(unknown.value.hint.rpartition("which asks: ")[2])
    alias = ["-o", f"HostKeyAlias={names_of(of_robot)[0]}"] if "proxy_jump" not in more else []
    assert command == ["ssh", *alias, "bot"]


def _keys(folder: Path) -> tuple[bytes, bytes]:
    for name in ("one", "two"):
        run = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(folder / name)]
        subprocess.run(run, check=True)
    one, two = (base64.b64decode((folder / f"{name}.pub").read_text().split()[1]) for name in ("one", "two"))
    return one, two


@pytest.mark.parametrize("kind", ["list", "krl"])
def test_a_key_in_revoked_host_keys_is_refused(tmp_path: Path, kind: str) -> None:
    gone, good = _keys(tmp_path)
    file = tmp_path / "revoked"
    if kind == "krl":
        subprocess.run(["ssh-keygen", "-q", "-k", "-f", str(file), str(tmp_path / "one.pub")], check=True)
    else:
        file.write_text(f"# gone\n{(tmp_path / 'one.pub').read_text()}")
    revoked.check("r1", str(file), "ssh-ed25519", good)
    with pytest.raises(HostKeyError, match="its host key is revoked by"):
        revoked.check("r1", str(file), "ssh-ed25519", gone)


@pytest.mark.parametrize("content", [None, b"SSHKRL\n\0rubbish"])
def test_where_revoked_host_keys_cannot_be_read_no_key_is_believed(tmp_path: Path, content: bytes | None) -> None:
    file = tmp_path / "revoked"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(HostKeyError, match="nobody knows whether its host key is revoked"):
        revoked.check("r1", str(file), "ssh-ed25519", BLOB)
