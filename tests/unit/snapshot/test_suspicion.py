"""What looks like a secret, and what does not; no case of either is missed by the other's rule."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest

from srprov.redaction import MASK
from srprov.snapshot.hider import Hider
from srprov.snapshot.notes import MOST, Notes
from srprov.snapshot.suspicion import masked, masked_words, secret_variable
from tests.bounded import within

SECRET = [
    ("DB_PASSWORD", "x"),
    ("MYSQL_ROOT_PASSWORD", "robot"),
    ("wifiPsk", "12345678"),
    ("API-KEY", "abc"),
    ("Auth.Token", "t"),
    ("AWS_SECRET_ACCESS_KEY", "wJalrXUtnFEMI/K7MDENG/bPxRfiCYEXAMPLEKEY"),
    ("URL", "postgres://robot:hunter2@db/lab"),
    ("URL", "postgres://robot:it's-mine@db/lab"),
    ("URL", 'amqp://robot:<1"2>@mq'),
    ("REMOTE", "https://ghp_abcdefghijklmnopqrstuvwxyz0123456789@github.com/a/b"),
    ("CONFIG", '{"password": "hunter2"}'),
    ("ARGS", "--user a --token=abcdef"),
    ("PEM", "-----BEGIN OPENSSH PRIVATE KEY-----\nb3Bl\n-----END"),
    ("HEADER", "Authorization: Bearer abcdef.ghi"),
    ("X", "AKIAIOSFODNN7EXAMPLE"),
    ("Y", "kJ8sT2vQ9xLmZ4pW7bNc3Rf6"),
    ("HASH", "$6$rounds$abcdefghijklmnop"),
    ("HEXED", "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"),
]
PLAIN = [
    ("PWD", "/home/robot"),
    ("ALLOW_EMPTY_PASSWORD", "yes"),
    ("DB_PASSWORD", ""),
    ("POSTGRES_PASSWORD_FILE", "/run/secrets/db"),
    ("SSH_AUTH_SOCK", "/run/agent.sock"),
    ("ROS_MASTER_URI", "http://robot1:11311"),
    ("ROS_DISTRO", "humble"),
    ("PATH", "/opt/ros/humble/bin:/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"),
    ("CYCLONEDDS_URI", "file:///config/cyclonedds_discovery_of_all_robots.xml"),
    ("KEYBOARD", "de"),
    ("TITLE", "Two robots talk over ROS, 2024-01-01 10:20:30"),
    ("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp"),
    ("GIT", "ssh://git@github.com/lab/driver.git"),
    ("LONG", "thisIsOneVeryLongWordInCamelCaseWithNumber2Inside"),
]


@pytest.mark.parametrize(("name", "value"), SECRET)
def test_a_secret_is_seen_by_its_name_or_by_its_value(name: str, value: str) -> None:
    assert secret_variable(name, value)


@pytest.mark.parametrize(("name", "value"), PLAIN)
def test_what_robots_usually_have_is_none(name: str, value: str) -> None:
    assert not secret_variable(name, value)
    assert masked(f"{name}={value}") == f"{name}={value}"


def test_a_text_keeps_what_is_no_secret() -> None:
    assert masked("run --password=hunter2 --speed=3") == f"run --password={MASK} --speed=3"
    assert masked("mqtt://robot:hunter2@broker:1883/a") == f"mqtt://robot:{MASK}@broker:1883/a"
    assert masked("redis://:hun@ter'2@broker/a@b") == f"redis://:{MASK}@broker/a@b"
    assert masked("token: 'abc def'  # of the lab") == f"token: '{MASK}'  # of the lab"
    assert masked_words(["app", "--password", "hunter2", "-v", "x"]) == ["app", "--password", MASK, "-v", "x"]


@pytest.mark.parametrize("value", ["pa$$w0rd!", "$ecret!23", "Tr0ub4$or&3", "(a)bc", "a;b;c", "abc", "[a,b]"])
def test_a_word_of_a_command_is_a_secret_up_to_its_end(value: str) -> None:
    """No shell reads it: the rest of it stood there, or all of it."""
    assert masked_words(["app", f"--password={value}", "x"]) == ["app", f"--password={MASK}", "x"]


def test_what_follows_an_option_in_a_script_is_one_too() -> None:
    said = masked_words(["sh", "-c", "a --password hunter2; b --auth-token 'x y' --token $TOKEN --key-file /a"])
    assert said[2] == f"a --password {MASK}; b --auth-token {MASK} --token $TOKEN --key-file /a"
    for kept in ("--password=$PASS", "--password=${PASS:-x}", "--password-file=/run/x", "--speed=3", "--key=left"):
        assert masked_words([kept]) == [kept]


@pytest.mark.parametrize(("words", "said"), [
    (["mysql", "-uroot", "-phunter2", "db"], ["mysql", "-uroot", f"-p{MASK}", "db"]),
    (["mysql", "-p", "db"], ["mysql", "-p", "db"]),
    (["/usr/bin/mosquitto_sub", "-p", "1883", "-P", "hunter2", "-t", "a"],
     ["/usr/bin/mosquitto_sub", "-p", "1883", "-P", MASK, "-t", "a"]),
    (["sh", "-c", "mysqldump -p'x y' db|gzip; redis-cli -a hunter2 ping && run -p 80"],
     ["sh", "-c", f"mysqldump -p{MASK} db|gzip; redis-cli -a {MASK} ping && run -p 80"]),
    (["sh", "-c", 'curl -u me:hunter2 http://a; mysql -p"$PASS"; mysql -p$PASS'],
     ["sh", "-c", f'curl -u {MASK} http://a; mysql -p"$PASS"; mysql -p$PASS']),
    (["redis-server", "--requirepass", "hunter2"], ["redis-server", "--requirepass", MASK]),
    (["docker", "run", "-p", "80:80"], ["docker", "run", "-p", "80:80"]),
])  # fmt: skip
def test_a_password_of_a_short_option_is_one_where_the_program_is_known(words: list[str], said: list[str]) -> None:
    assert masked_words(words) == said


_COMMANDS = ("--password " * 40_000, "--password 'x" * 40_000, f"--p={'$' * 400_000}", "-a " * 130_000)
_SHORT = ("mysql -p " * 40_000, "curl '" * 80_000, "curl \"'" * 60_000)
_TEXTS = ("a" * 400_000, "password=" * 40_000, "://a" * 90_000, "a='" * 100_000, "-----BEGIN " * 30_000)


def is_linear(use: Callable[[str], object], text: str) -> bool:
    """Return whether a text takes about eight times as long as an eighth of it, however fast the machine is by now."""

    def took(part: str) -> float:
        begin = time.process_time()
        use(part)
        return time.process_time() - begin

    return any(took(text) < 0.1 + 24 * took(text[: len(text) // 8]) for _ in range(3))


@pytest.mark.parametrize("command", [*_COMMANDS, *_SHORT], ids=range(7))
def test_the_time_is_linear_in_a_command(command: str) -> None:
    assert is_linear(lambda text: masked_words([text]), command)


@pytest.mark.parametrize("text", _TEXTS, ids=range(5))
def test_the_time_is_linear_in_the_text(text: str) -> None:
    assert is_linear(masked, text)


_WORDS = ("eyJ-", "eyJaaaaa-", "sk-", "github_pat_a-", "A.a", "a.", f"a{'1' * 82}=", "ab\t\t\t")


@pytest.mark.parametrize("piece", _WORDS)
def test_each_word_of_a_text_is_read_once(piece: str) -> None:
    """And not from each letter of it on, or from each `eyJ`, up to where the longest name or token ends."""
    with within(1.2):
        masked(piece * (1_000_000 // len(piece)))


def test_a_token_is_one_wherever_it_begins_in_a_word() -> None:
    jwt = "eyJhbGciOiJI.eyJzdWIiOiIx.abcdefgh"
    assert masked(jwt) == masked(f"jwt-{jwt}").removeprefix("jwt-") == f"{MASK}.abcdefgh"
    assert masked(f"eyJhbGciOiJI-{jwt}") == f"{MASK}.abcdefgh"
    assert masked("eyJhbGciOiJI-ghp_abcdefghijklmnop") == f"eyJhbGciOiJI-{MASK}"
    assert masked("PRIVATE KEY eyJhbGciOiJI") == "PRIVATE KEY eyJhbGciOiJI"
    assert masked(f"PRIVATE KEY {jwt}") == MASK
    assert masked(f"https://{jwt}@h") == f"https://{MASK}@h"
    assert masked(f"{'x' * 90}password=hunter2") == f"{'x' * 90}password={MASK}"
    assert masked(f"a{'1' * 90}=password=hunter2") == f"a{'1' * 90}=password={MASK}"
    assert masked("..1_password=hunter2 11=password=hunter2") == f"..1_password={MASK} 11=password={MASK}"


def test_of_a_text_that_is_too_long_nothing_is_shown() -> None:
    assert masked("a" * ((1 << 20) + 1)) == MASK


def test_a_value_is_hidden_in_every_form_and_a_usual_word_only_by_itself() -> None:
    hider = Hider(["hunter2-and-more", "robot"])
    assert hider.without("x aHVudGVyMi1hbmQtbW9yZQ== y") == "x ***== y"
    assert hider.without("--pass robot /home/robot robots robot1") == "--pass *** /home/robot robots robot1"
    assert hider.without_strong("robot hunter2-and-more") == "robot ***"


def test_notes_hold_no_secret_and_have_an_end() -> None:
    notes = Notes()
    notes.lost("repository https://a:hunter2@h/x", "token=abcdef\x1b[31m")
    assert "hunter2" not in str(notes.all()) and "abcdef" not in str(notes.all()) and "\x1b" not in str(notes.all())
    for number in range(2 * MOST):
        notes.lost(f"x{number}", "y")
    assert len(notes.all()) == MOST + 1 and notes.all()[-1].words == f"{MOST + 1} more things are not listed"
