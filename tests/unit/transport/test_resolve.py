from __future__ import annotations

import getpass
import shutil
import subprocess
from pathlib import Path

import pytest

from srprov.definitions.model import Host
from srprov.errors import ConnectError
from srprov.transport.deadline import Deadline
from srprov.transport.openssh import ssh_config
from srprov.transport.openssh.connection import StrictConnection, jump_host, parse_hop
from srprov.transport.openssh.resolve import expand, resolve
from srprov.transport.openssh.settings import SshSettings
from srprov.transport.openssh.sockets import ProxyProcess
from srprov.transport.openssh.ssh_config import Settled


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
    monkeypatch.setenv("HOME", "/home/%h/${PLACE}")
    assert expand("~/%h", tokens) == "/home/%h/${PLACE}/host"
    monkeypatch.setenv("HOME", "/")
    assert (expand("~/%h", tokens), expand("~", tokens)) == ("/host", "/")
    assert expand(Settled("~/%h/${PLACE}"), tokens) == "~/%h/${PLACE}"


ALL = """
ProxyCommand exit 1; nc %h %p # %r %n %k %%h
IdentityFile /k/%h/%n/%p/%%r/${PLACE}/%r
UserKnownHostsFile /u/%h/%%h/${PLACE} /u/%n/%k
IdentityAgent /a/%h/%r/${PLACE}
"""
SAME_AS_SSH = {
    "port and user of the inventory": ("", "robot.lab", {}),
    "another name": ("HostName 10.0.0.9\n", "robot.lab", {}),
    "a name made of the name": ("HostName x%%h.%h\n", "robot.lab", {}),
    "an option's name": ("HostName no\n", "robot.lab", {"ssh_options": (("hostname", "x%%h.%h"),)}),
    "an alias": ("HostKeyAlias al%h\nHostName %h.lan\n", "robot.lab", {}),
    "tokens in the address": ("", "x.%u.%L.evil.example", {}),
    "tokens in the address and the user": ("", "a%%h", {"user": "b%d"}),
    "tokens in an address within a name": ("HostName %h.lan\n", "a.%h.%n", {"user": "%h"}),
    "the interface of an address": ("", "fe80::1%lo", {}),
    "port and user of ssh_config": ("Port 2200\nUser con%rf\n", "robot.lab", {"user": None, "port": None}),
}


@pytest.mark.skipif(not shutil.which("ssh"), reason="needs openssh-client")
@pytest.mark.parametrize("more", ["", "Match all\n"], ids=["read here", "read by ssh"])
@pytest.mark.parametrize("case", SAME_AS_SSH)
def test_what_is_expanded_is_what_ssh_expands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, case: str, more: str
) -> None:
    """Once, with the inventory's port and user: a name may look like a token, and would go to a stranger's DNS."""
    monkeypatch.setenv("PLACE", "there")
    text, address, given = SAME_AS_SSH[case]
    host = {"address": address, "user": "bob", "port": 2222, **given}
    found = resolved(tmp_path, f"Host *\n{text}{ALL}{more}", **host)
    file = str(tmp_path / "ssh_config")
    user, port = ([f"-o{key}={host[key]}"] if host[key] else [] for key in ("user", "port"))
    others = [f"-o{key}={value}" for key, value in given.get("ssh_options", ())]
    command = ["-F", file, *user, *port, *others, "--", address]
    said = subprocess.run(
        ["ssh", "-v", "-oBatchMode=yes", *command], capture_output=True, text=True, check=False
    ).stderr
    settings = subprocess.run(["ssh", "-G", *command], capture_output=True, text=True, check=True).stdout
    values = dict(line.split(" ", maxsplit=1) for line in settings.splitlines() if " " in line)
    assert f"Executing proxy command: exec {found.proxy_command}\n" in said
    assert f"identity file {found.identity_files[0]} type" in said
    assert found.hostname == values["hostname"] and found.user == values["user"] and str(found.port) == values["port"]
    assert " ".join(found.known_hosts) == values["userknownhostsfile"]
    assert found.identity_agent == values["identityagent"]


@pytest.mark.parametrize("more", ["", "Match all\n"], ids=["read here", "read by ssh"])
def test_what_a_variable_is_called_in_a_host_s_name_is_no_variable(tmp_path: Path, more: str) -> None:
    text = f"Host *\n  IdentityFile {tmp_path}/%h\n  UserKnownHostsFile {tmp_path}/%h\n{more}"
    if more:
        with pytest.raises(ConnectError, match="is no host or user name for a command"):
            resolved(tmp_path, text, address="h${HOME}")
        return
    found = resolved(tmp_path, text, address="h${HOME}")
    assert found.identity_files == found.known_hosts == (f"{tmp_path}/h${{HOME}}",)


@pytest.mark.parametrize("expands", [True, False])
def test_what_this_ssh_expands_is_asked_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, expands: bool
) -> None:
    """Newer versions show more values expanded."""
    shown, key = ("%", "/k/x.%u") if expands else ("%%", "/k/%h")
    fake = tmp_path / "bin" / "ssh"
    fake.parent.mkdir()
    fake.write_text(
        f'#!/bin/sh\ncase "$*" in *IgnoreUnknown*) echo "revokedhostkeys {shown}";;\n'
        f'*) echo "hostname x.%u"; echo "revokedhostkeys {key}";; esac\n'
    )
    fake.chmod(0o755)
    monkeypatch.setenv("PATH", f"{fake.parent}:/usr/bin:/bin")
    ssh_config._expanded.cache_clear()
    try:
        assert resolved(tmp_path, "Match all\n", address="x.%u").revoked_host_keys == "/k/x.%u"
    finally:
        ssh_config._expanded.cache_clear()


@pytest.mark.parametrize("more", ["", "Match all\n"], ids=["read here", "read by ssh"])
def test_a_jump_host_is_named_by_tokens_once(tmp_path: Path, more: str) -> None:
    text = f"Host robot*\n  ProxyJump %r@%h.gate:22,%n-%p\n{more}"
    found = resolved(tmp_path, text, address="robot.%u", user="b%d", port=2222)
    assert found.proxy_jump == ("b%d@robot.%u.gate:22", "robot.%u-2222")
    with pytest.raises(ConnectError, match=r"is no part of a jump host|hostname contains invalid characters"):
        resolved(tmp_path, text, address="robot,evil.example")


def test_a_jump_host_s_own_way_is_not_expanded_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ways: list[tuple[str, ...]] = []

    def opened(connection: StrictConnection) -> None:
        ways.append((connection.settings.hostname, *connection.settings.proxy_jump))

    monkeypatch.setattr(StrictConnection, "open", opened)
    text = "Host robot*\n  ProxyJump %n-a,%n-b,end\n"
    jump_host(resolved(tmp_path, text, address="robot.%u"), Deadline(5))
    assert ways == [("end", "robot.%u-a", "robot.%u-b")]


@pytest.mark.parametrize("jump", ["gate-%h", "bot"])
def test_jump_hosts_without_end_are_told(tmp_path: Path, jump: str) -> None:
    settings = resolved(tmp_path, f"Host *\n  ProxyJump {jump}\n")
    with pytest.raises(ConnectError, match="ProxyJump leads in a circle: "):
        jump_host(settings, Deadline(5))


def test_no_command_of_the_user_s_is_none_for_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two files the first one wins, also where it says that there is no command."""
    texts = {tmp_path / "own": "Host bot\n  ProxyCommand none\n", tmp_path / "etc": "Host *\n  ProxyCommand nc %h %p\n"}
    monkeypatch.setattr(ssh_config, "config_texts", lambda _chosen: texts)
    assert resolved(tmp_path).proxy_command is None


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
