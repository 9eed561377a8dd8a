"""The judge of what only reads: it passes every question that srprov asks, and none of what changes a robot."""

from __future__ import annotations

import pytest

from srprov import time_sync
from srprov.execution.locks import who_holds
from srprov.facts.host import host_queries
from srprov.facts.preconditions import precondition_queries
from srprov.facts.probes import counters
from srprov.modules.observe import observe_queries
from srprov.probing import look
from srprov.probing.script import run, upload
from srprov.sandbox import sandboxed
from srprov.snapshot import debian, gitscript, questions, sources
from srprov.transport.container_look import LOOK, told
from srprov.transport.shell.frames import batch, start_command
from srprov.trials import hosts
from srprov.wire import Query, sh
from tests.fakes import World
from tests.readonly import READS, commands, engine_requests, engine_violations, shell_violations
from tests.unit.probing.worlds import request
from tests.worlds import experiment, plan_for, service

OF_ROOT = gitscript.Found(folder="/root/w", uid=0)
QUESTIONS = [
    *host_queries(),
    counters(0),
    *observe_queries(),
    *precondition_queries(),
    who_holds(),
    *look.queries(request(), "r1", {6: 4711}),
    *look.queries(request(tunnel=20000), "r2", {}),
    Query(command=time_sync.SCRIPT),
    Query(command=hosts.SCRIPT),
    *(question.query() for question in questions.QUESTIONS),
    *(Query(command=gitscript.script(OF_ROOT, root=root)) for root in (True, False)),
    Query(command=gitscript.script(gitscript.Found(folder="/home/a b/it's", uid=1000), root=True)),
    debian.policy_query(["tree", "g++"]),
    sources.origins_query(),
    *(
        sources.keys_query(
            [sources.Source("http://a/b", "c", key="/etc/apt/keyrings/a.gpg"), sources.Source("http://b", "c")],
            root=root,
        )
        for root in (True, False)
    ),
]
CONFINED = sh(*gitscript.confined(OF_ROOT, 5, root=True))


@pytest.mark.parametrize("question", [one for one in QUESTIONS if isinstance(one, Query)], ids=lambda q: q.command[:30])
def test_every_question_only_reads(question: Query) -> None:
    assert shell_violations(question.command) == []
    assert len(list(commands(question.command))) >= 1, "the judge saw something"


def test_a_whole_session_only_reads() -> None:
    """The login's command line, and the batch with its frames, as they are sent."""
    assert shell_violations(start_command("0" * 32, "sh", root=True, mark="1" * 32)) == []
    assert shell_violations(start_command("0" * 32, "docker system dial-stdio", root=True)) == []
    every = [one.command for one in QUESTIONS if isinstance(one, Query)]
    sent = batch("0" * 32, every).decode()
    assert shell_violations(sent) == []
    names = {words[0].text for words in commands(sent)}
    assert names >= {"eval", "printf"}


def test_every_step_of_a_plan_is_seen_to_change_something() -> None:
    """Scripts and files of all modules: the judge passes none of them."""
    world = World().add("r1", "r2")
    steps = plan_for(world, experiment(service("a", robot="r1"), service("b", robot="r2"))).steps
    scripts = [
        c.script if isinstance(c.script, str) else c.script() for s in steps for c in s.commands if hasattr(c, "script")
    ]
    assert len(scripts) >= 4
    for script in scripts:
        assert shell_violations(batch("0" * 32, [script]).decode()), script


def test_a_probe_changes_nothing_but_its_own_file() -> None:
    """It is written, opened and gone before it begins; all else that `srprov probe` asks is a question."""
    own = "/var/lib/srprov/.probe.0a1b2c3d"
    brought = shell_violations(upload("0a1b2c3d", "amd64").script)
    others = [act for act in brought if own not in act]
    stale = "find /var/lib/srprov -maxdepth 1 -name .probe.* -mmin +2 -delete"
    assert set(others) == {"mkdir -p /var/lib/srprov", stale, "base64 -d", "gzip -dc", "command exec"}
    assert f"rm -f {own}" in brought
    acts = shell_violations(run(request(), "r1", "0a1b2c3d", {6: 4711}).script)
    assert [act.split()[0] for act in acts] == ["/proc/self/fd/8"]


@pytest.mark.parametrize(
    "script",
    [
        "touch /tmp/x", "cat /etc/passwd > /tmp/x", "cat x >> y", "echo x | tee y", "cat $(touch /tmp/x)",
        'printf "%s" "$(rm -rf /tmp/x)"', "`id`", "ip link add x type dummy", "ip link set x up", "ip -j link del x",
        "ip -n x link del y", "ip netns exec x reboot", "ip netns exec x wg set y private-key z",
        "bridge fdb append 00:00:00:00:00:00 dev x", "bridge -batch -", "iptables -A INPUT -j DROP", "iptables -F",
        "modprobe vxlan", "docker run x", "docker system prune", "find . -delete", "find . -exec rm {} +",
        "sed -i s/a/b/ x", "sed -n 's/a/b/w x' y", "date -s 10:00", "eval \"$x\"", "$x", "sh -c 'touch x'", "sh x",
        "if true; then mkdir x; fi", "for f in a b; do rm $f; done", "case x in y) kill 1;; esac", "(reboot)",
        "true && reboot", "x=$(reboot)", "PATH=/tmp ls", "LD_PRELOAD=x ls", "cat <<E\nE", "f() { rm x; }",
        "flock x rm", "nsenter --net=/proc/7/ns/net reboot", "nsenter -t 7 -a ip link", "nft flush ruleset",
        "nsenter --net=/proc/7/ns/net ip link del x", "iptables-save -f /tmp/x",
        "exec reboot", "while read l; do dd of=$l; done", "sort -o x y", "test -e x || mkdir x", "ls\nrm x",
        "cat x 2>/tmp/y", "echo 'unterminated", "case x in a) ls;; *) touch y;; esac", "export LD_PRELOAD=x",
        "xargs rm", "xargs -0 rm", "xargs -0 sh -c 'rm \"$@\"' sh", "xargs -0 sh -c \"$x\" sh",
        "xargs -0 sh -c 'ls' sh rm",
        "\\rm x", "r'm' x", "(eval 'rm x')", "command rm x", "r[m] x", "PATH=/usr/local/evil ls",
    ],
)  # fmt: skip
def test_what_changes_something_is_seen(script: str) -> None:
    assert shell_violations(script), [[word.text for word in words] for words in commands(script)]


@pytest.mark.parametrize(
    "script",
    [
        "base64 -d", "timeout 5 reboot", "timeout 5 sh -c 'rm x'", "timeout -k 1 5 ls", "timeout 5",
        "env -i git status",
        "git diff", "dpkg-query -W", "apt-cache policy tree", "apt-cache -o Dir::Cache::pkgcache= search x",
        f"{sh('apt-cache', '-o', 'Dir::Cache::pkgcache=', '-o', 'Dir::Cache::srcpkgcache=', 'policy', '-o', 'x')}",
        f"{CONFINED} reboot", f"{CONFINED} sh -c 'rm x'", f"{CONFINED} env -i git status",
        f"{CONFINED} env -i git diff",
        f"{CONFINED} env -i LD_PRELOAD=x git ls-files -v -z",
        f"{CONFINED} env -i GIT_DIR=x git ls-files -v -z --output=x",
        f"{CONFINED} env -i git --exec-path=/tmp ls-files -v -z", f"{CONFINED} env -i git diff-index --patch HEAD",
        *(
            f"{CONFINED.replace(word, '')} {sh('sh', '-c', '(:) && echo forks')}"
            for word in ("--nproc=0:0", "--fsize=0:0", "--no-new-privs", "prlimit")
        ),
        f"{CONFINED.replace('--reuid=65534', '--reuid=0')} {sh('sh', '-c', '(:) && echo forks')}",
        f"{CONFINED.replace('dac_read_search', 'sys_admin')} {sh('sh', '-c', '(:) && echo forks')}",
    ],
)  # fmt: skip
def test_a_program_that_could_do_more_than_read_is_seen(script: str) -> None:
    """Without one of its limits, as root, or asked anything else, git is not let pass."""
    assert shell_violations(script)


def test_what_cp_looks_at_is_only_read() -> None:
    """Names come on standard input, into a folder that is closed off."""
    assert shell_violations(told(["./it's", "./-delete"], sandboxed("/m", LOOK, "/m"))) == []
    assert shell_violations(told(["./a"], sandboxed("/m", LOOK.replace("find", "rm"), "/m")))
    assert shell_violations(told(["./a"], sandboxed("/m", LOOK, "/m", way="rw")))


def test_the_list_is_closed_and_says_nothing_that_writes() -> None:
    writers = "rm mv cp dd tee touch mkdir rmdir ln chmod chown kill mount tar git sysctl sh eval exec env xargs"
    assert not set(READS) & set(writers.split())


def test_requests_are_read_with_their_bodies() -> None:
    """A body that looks like a request is none, whether its length is told or it comes in chunks."""
    get = b"GET /v1.41/info HTTP/1.1\r\nHost: engine\r\n\r\n"
    post = b"POST /v1.41/x HTTP/1.1\r\nContent-Length: %d\r\n\r\n%s" % (len(get), get)
    chunks = b"POST /images/load HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n5\r\nGET /\r\n0\r\n\r\n"
    assert list(engine_requests(get + post + get + chunks + get)) == [
        ("GET", "/v1.41/info"), ("POST", "/v1.41/x"), ("GET", "/v1.41/info"), ("POST", "/images/load"),
        ("GET", "/v1.41/info"),
    ]  # fmt: skip
    assert engine_violations(get + get) == []
    assert engine_violations(get + post) == ["POST /v1.41/x"]
    assert engine_violations(b"rm -rf /") and engine_violations(get[:-2])
