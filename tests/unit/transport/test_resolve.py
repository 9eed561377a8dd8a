from __future__ import annotations

import getpass
import shutil
from pathlib import Path

import pytest

from srprov.definitions.model import Host
from srprov.errors import ConnectError
from srprov.transport.openssh.connection import parse_hop
from srprov.transport.openssh.resolve import expand, resolve
from srprov.transport.openssh.settings import SshSettings
from srprov.transport.openssh.sockets import ProxyProcess


def resolved(tmp_path: Path, text: str = "", **host: object) -> SshSettings:
    file = tmp_path / "ssh_config"
    file.write_text(text)
    values = {"name": "r1", "address": "bot", **host}
    return resolve(Host(**values), ssh_config=file)  # type: ignore[arg-type]


def test_defaults(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("SSH_AUTH_SOCK", "/run/agent")
    found = resolved(tmp_path)
    assert (found.hostname, found.port, found.user) == ("bot", 22, getpass.getuser())
    assert found.known_hosts == (f"{tmp_path}/.ssh/known_hosts", f"{tmp_path}/.ssh/known_hosts2")
    assert found.global_known_hosts[0] == "/etc/ssh/ssh_known_hosts"
    assert [Path(key).name for key in found.identity_files] == ["id_ed25519", "id_ecdsa", "id_rsa"]
    assert not found.identities_configured and not found.accept_new
    assert found.identity_agent == "/run/agent"


CONFIG = """
Host bot other
    HostName %h.lan
    Port 2200
    User conf
    IdentityFile ~/.ssh/of_%r_on_%h
    IdentityFile "/with space/key"
    IdentitiesOnly yes
    UserKnownHostsFile ~/one "/two words/%k" ~/three
    StrictHostKeyChecking accept-new
    ProxyJump ann@gate:2222,inner
    HostKeyAlias the-bot
    HashKnownHosts yes
    RevokedHostKeys ~/revoked-%r
    ConnectTimeout 3
Host *
    User late
"""


def test_ssh_config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/me")
    found = resolved(tmp_path, CONFIG)
    assert (found.hostname, found.port, found.user) == ("bot.lan", 2200, "conf")
    assert found.identity_files[1] == "/with space/key" and found.identities_configured and found.identities_only
    assert found.known_hosts == ("/home/me/one", "/two words/the-bot", "/home/me/three")
    assert found.accept_new and found.hash_known_hosts and found.revoked_host_keys == "/home/me/revoked-conf"
    assert found.proxy_jump == ("ann@gate:2222", "inner")
    assert (found.host_key_alias, found.connect_timeout_s) == ("the-bot", 3.0)


def test_inventory_before_options_before_config(tmp_path: Path) -> None:
    options = (
        ("user", "option"), ("port", "1111"), ("identityfile", "/option"), ("proxyjump", "none"),
        ("userknownhostsfile", "/lab/known"), ("stricthostkeychecking", "no"), ("stricthostkeychecking", "accept-new"),
    )  # fmt: skip
    found = resolved(tmp_path, CONFIG, user="own", identity_file="/own", ssh_options=options)
    assert (found.user, found.port) == ("own", 1111)
    assert found.identity_files[:2] == ("/own", "/option") and "/with space/key" in found.identity_files
    assert found.known_hosts == ("/lab/known",)
    assert found.asked_for_no and not found.accept_new
    assert found.proxy_jump == ()
    assert ("userknownhostsfile", "/lab/known") in found.inherited


def test_an_address_of_the_inventory_is_looked_up(tmp_path: Path) -> None:
    found = resolved(tmp_path, "Host 10.0.0.*\n  Port 2022\n", address="10.0.0.7")
    assert (found.hostname, found.port) == ("10.0.0.7", 2022)


def test_an_include_of_nothing_needs_no_ssh(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    assert resolved(tmp_path, f"Include {tmp_path}/none/*\nHost bot\n  Port 77\n").port == 77


@pytest.mark.skipif(not shutil.which("ssh"), reason="needs openssh-client")
def test_match_goes_through_ssh(tmp_path: Path) -> None:
    text = "Match user robot\n  Port 99\n  UserKnownHostsFile /a /b\nHost bot\n  HostName bot.lan\n"
    found = resolved(tmp_path, text, user="robot")
    assert (found.port, found.known_hosts, found.hostname) == (99, ("/a", "/b"), "bot.lan")
    assert not found.identities_configured, "the defaults that ssh -G lists are not a configured key"
    assert resolved(tmp_path, text, user="else").port == 22
    assert resolved(tmp_path, text, user="robot", identity_file="/own").identity_files == ("/own",)
    odd = resolved(tmp_path, text + "Match all\n  RemoteCommand x\u2028proxycommand touch ran\n", user="robot")
    assert odd.proxy_command is None, "what ends no line of a file ends none of what ssh -G says"


@pytest.mark.skipif(not shutil.which("ssh"), reason="needs openssh-client")
@pytest.mark.parametrize("folder", ['x"\nproxycommand touch ran\n"', "two words", 'a"b', "plain"])
def test_the_name_of_a_key_s_folder_is_no_setting(tmp_path: Path, folder: str) -> None:
    """A folder of a stranger's project may have any name, and a link to it a harmless one."""
    key = f"/{folder}/id"
    text = "Match all\n  Port 99\n  IdentityFile /configured\n"
    found = resolved(tmp_path, text, identity_file=key)
    assert (found.port, found.proxy_command, found.identity_files) == (99, None, (key, "/configured"))


@pytest.mark.skipif(not shutil.which("ssh"), reason="needs openssh-client")
def test_a_setting_of_two_lines_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConnectError, match="a control character is in it"):
        resolved(tmp_path, "Match all\n  Port 99\n", ssh_options=(("setenv", '"A=1\nproxycommand x"'),))


@pytest.mark.skipif(not shutil.which("ssh"), reason="needs openssh-client")
def test_an_address_that_looks_like_an_option_is_none(tmp_path: Path) -> None:
    with pytest.raises(ConnectError, match="is no host or user name"):
        resolved(tmp_path, "Match all\n  Port 5\n", address="-oProxyCommand=touch${IFS}/tmp/x")


def test_broken_config_is_an_error_in_words(tmp_path: Path) -> None:
    with pytest.raises(ConnectError, match="ssh_config cannot be read"):
        resolved(tmp_path, "nonsense\n")
    with pytest.raises(ConnectError, match="port 'ssh'"):
        resolved(tmp_path, ssh_options=(("port", "ssh"),))
    for port in ("99999", "0"):
        with pytest.raises(ConnectError, match=f"port '{port}' is not within"):
            resolved(tmp_path, ssh_options=(("port", port),))


def test_agent_choices(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SSH_AUTH_SOCK", "/run/agent")
    monkeypatch.setenv("OTHER", "/run/other")

    def agent(value: str) -> str | None:
        return resolved(tmp_path, ssh_options=(("identityagent", value),)).identity_agent

    assert agent("none") is None
    assert (agent("SSH_AUTH_SOCK"), agent("$OTHER"), agent("/run/third")) == ("/run/agent", "/run/other", "/run/third")


@pytest.mark.parametrize("file", ["${NOWHERE}/known", "/x/${NOWHERE}", "~nobody-here/known", "~nobody-here"])
@pytest.mark.parametrize("key", ["UserKnownHostsFile", "GlobalKnownHostsFile", "RevokedHostKeys", "IdentityFile"])
def test_a_file_is_named_by_what_there_is(tmp_path: Path, key: str, file: str) -> None:
    """A folder of a stranger's may be called `${NOWHERE}` or `~nobody-here`, and say there which keys robots have."""
    with pytest.raises(ConnectError, match=r"NOWHERE is not set|there is no user nobody-here"):
        resolved(tmp_path, ssh_options=((key.lower(), file),))
    if key == "IdentityFile" and file.startswith("~"):
        return  # paramiko's reader takes a `~` for the user's own home
    with pytest.raises(ConnectError, match=r"NOWHERE is not set|there is no user nobody-here"):
        resolved(tmp_path, f"Host *\n  {key} {file}\n")


def test_expand(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/me")
    monkeypatch.setenv("PLACE", "there")
    tokens = {"%h": "host", "%%": "%"}
    assert expand("~/%h/%%h/${PLACE}/%x/${", tokens) == "/home/me/host/%h/there/%x/${"
    # a user that a stranger's inventory names is a word, and nothing of the environment
    assert expand("known/%r@%h", {"%r": "${PLACE}", "%h": "%r"}) == "known/${PLACE}@%r"
    assert expand("cat ~/%h", tokens, tilde=False) == "cat ~/host"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("gate", (None, "gate", None)),
        ("ann@gate:22", ("ann", "gate", 22)),
        ("a@b@gate", ("a@b", "gate", None)),
        ("ssh://ann@gate:22/", ("ann", "gate", 22)),
        ("[::1]:2222", (None, "::1", 2222)),
        ("ann@[fe80::1]", ("ann", "fe80::1", None)),
        ("fe80::1", (None, "fe80::1", None)),
    ],
)
def test_parse_hop(text: str, expected: tuple[str | None, str, int | None]) -> None:
    assert parse_hop(text) == expected


WORDS = [
    "$(touch x)",
    "`touch x`",
    "-oProxyCommand=touch x",
    "a;touch",
    "a b",
    "a\nb",
    "a|b",
    "a'b",
    'a"b',
    "a>b",
    "a\\b",
    "*.lan",  # names of files in the folder at hand, for a shell
    "b?t",
    "[b]ot",
    "{a,b}",
    "~root",
    "a#b",
]


@pytest.mark.parametrize("where", ["address", "user", "HostName"])
@pytest.mark.parametrize("word", WORDS)
def test_a_proxy_command_gets_no_shell_text_as_a_name(tmp_path: Path, where: str, word: str) -> None:
    """The command is run by a shell, and `%h` would be part of its text; OpenSSH refuses such names, too."""
    proxied = (("proxycommand", "ssh -W %h:%p %r@bastion"),)
    text = f'Host bot\n  HostName "{word}"\n' if where == "HostName" else ""
    if where == "HostName" and set(word) & set('\n"\\'):
        return  # ssh_config cannot hold it
    given = {} if where == "HostName" else {where: word}
    with pytest.raises(ConnectError, match="is no host or user name"):
        resolved(tmp_path, text, ssh_options=proxied, **given)
    assert word.startswith("-") or resolved(tmp_path, text, **given).proxy_command is None


@pytest.mark.parametrize("where", ["address", "user", "hostname", "hostkeyalias"])
@pytest.mark.parametrize("word", WORDS)
def test_match_exec_gets_no_shell_text_as_a_name(tmp_path: Path, where: str, word: str) -> None:
    """A project names its robots, and the user's own file may have a command with `%h` or `%r`; older ssh runs it."""
    text = f'Match exec "touch {tmp_path}/ran-%r-%h-%k"\n  Port 2222\n'
    given = {"ssh_options": ((where, word),)} if where.startswith("host") else {where: word}
    with pytest.raises(ConnectError, match="is no host or user name for a command"):
        resolved(tmp_path, text, **given)
    assert not [*tmp_path.glob("ran*")]


@pytest.mark.parametrize(
    "given", [{"user": "x/../../keys"}, {"address": "../bot"}, {"ssh_options": (("hostkeyalias", "a/b"),)}]
)
def test_no_name_leads_to_another_file(tmp_path: Path, given: dict[str, object]) -> None:
    """A project names its robots, and the user's own file may have known hosts of each in a file of its own."""
    with pytest.raises(ConnectError, match="it has a slash"):
        resolved(tmp_path, f"Host *\n  UserKnownHostsFile {tmp_path}/%k/%r\n", **given)
    if shutil.which("ssh"):
        ran = f'Match exec "touch {tmp_path}/ran"\n  Port 2222\n'
        with pytest.raises(ConnectError, match="it has a slash"):
            resolved(tmp_path, ran, **given)
        assert not [*tmp_path.glob("ran*")], "a command may have it in the name of a file, too"


def test_no_command_of_ssh_config_runs_in_the_folder_at_hand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It may be a stranger's, and hold what a pattern of file names in a command means there."""
    monkeypatch.chdir(tmp_path)
    assert resolved(tmp_path, 'Match exec "test $(pwd) = /"\n  Port 2222\n').port == 2222
    process = ProxyProcess("r1", "pwd")
    assert process.socket.recv(100) == b"/\n"
    process.close()


@pytest.mark.parametrize("where", ["address", "user"])
def test_no_name_is_an_option(tmp_path: Path, where: str) -> None:
    """A message has it in a command of ssh's."""
    with pytest.raises(ConnectError, match="it begins with '-'"):
        resolved(tmp_path, **{where: "-oProxyCommand=id"})


def test_no_user_is_the_folder_above(tmp_path: Path) -> None:
    with pytest.raises(ConnectError, match="it leads to another folder"):
        resolved(tmp_path, f"Host *\n  UserKnownHostsFile {tmp_path}/%r/%h\n", user="..")


@pytest.mark.parametrize("address", ["10.0.0.1", "2001:db8::1", "fe80::1%eth0", "bot.lan", "b_o-t"])
def test_a_proxy_command_gets_any_proper_name(tmp_path: Path, address: str) -> None:
    found = resolved(tmp_path, address=address, user="ada.l@site", ssh_options=(("proxycommand", "nc %h %p"),))
    assert found.proxy_command == f"nc {address} 22"


def test_a_proxy_command_of_a_record_is_not_run(tmp_path: Path) -> None:
    """For the shell that would run it, `***` is whatever lies in the folder at hand, such as `bash` and a script."""
    with pytest.raises(ConnectError, match=r"its ProxyCommand is \*\*\*, as the inventory of a record has it"):
        resolved(tmp_path, ssh_options=(("proxycommand", "***"),))
