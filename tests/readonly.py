"""What was sent to a robot, read as its shell and its engine read it; held against a closed list of what only reads.

Takes the bytes of a shell's standard input, of its command line, or of a connection to a Docker Engine; gives
violations, empty when everything is on the list. It is a small part of a shell's grammar, and what is not in it is a
violation, never passed over: here-documents, functions, backquotes, a command's name that is not a plain word.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from srprov.sandbox import _ENTER, _ESCAPED


class NotUnderstood(ValueError):
    """Shell text beyond the grammar that is known here."""


@dataclass
class Word:
    """One word: its text with quotes taken away, whether that is all of it, and the commands inside of it."""

    text: str = ""
    literal: bool = True
    inner: list[str] = field(default_factory=list)


@dataclass
class Operator:
    """`;`, `|`, `>`, a newline …"""

    text: str


Token = Word | Operator
_OPERATORS = ("&&", "||", ";;", "<<", ">>", ">&", "<&", "<>", ">|", ";", "&", "|", "(", ")", "<", ">", "\n")
_KEYWORDS = {"if", "then", "elif", "else", "fi", "do", "done", "while", "until", "!", "{", "}"}
_RULING = {"PATH", "ENV", "BASH_ENV", "LD_PRELOAD", "LD_LIBRARY_PATH", "IFS"}
"""Variables that decide which programs a name means."""
_OUR_PATH = "PATH=$p/usr/local/sbin:"
"""`p` has the whole paths of what was there."""
_SEPARATORS = ("IFS=", "IFS=:", "IFS=/")
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


class _Lexer:
    def __init__(self, text: str) -> None:
        self.text, self.at = text, 0

    def tokens(self) -> Iterator[Token]:
        text = self.text
        while self.at < len(text):
            here = text[self.at]
            if text.startswith("\\\n", self.at):
                self.at += 2
            elif here in " \t":
                self.at += 1
            elif here == "#":
                end = text.find("\n", self.at)
                self.at = len(text) if end < 0 else end
            elif operator := next((one for one in _OPERATORS if text.startswith(one, self.at)), ""):
                self.at += len(operator)
                yield Operator(operator)
            else:
                yield self._word()

    def _word(self) -> Word:
        word, text = Word(), self.text
        while self.at < len(text) and text[self.at] not in " \t\n;&|()<>":
            here = text[self.at]
            if here == "'":
                end = text.index("'", self.at + 1)
                word.text += text[self.at + 1 : end]
                self.at = end + 1
            elif here == '"':
                self.at += 1
                while text[self.at] != '"':
                    self._piece(word, quoted=True)
                self.at += 1
            else:
                self._piece(word, quoted=False)
        return word

    def _piece(self, word: Word, *, quoted: bool) -> None:
        """Take one character, or one expansion."""
        text, here = self.text, self.text[self.at]
        if here == "\\":
            following = text[self.at + 1]
            word.text += following if not quoted or following in '$`"\\\n' else here + following
            self.at += 2
        elif here == "`":
            raise NotUnderstood("a backquote")
        elif here == "$":
            self._expansion(word)
        else:
            if not quoted and here in "*?[" and not text.startswith("[ ", self.at):
                word.literal = False  # may become the name of a file
            word.text += here
            self.at += 1

    def _expansion(self, word: Word) -> None:
        text, start, before = self.text, self.at, word.text
        word.literal = False
        if text.startswith("$((", start):
            self.at = text.index("))", start) + 2
        elif text.startswith("$(", start):
            self.at = start + 2
            word.inner.append(self._until_closed())
        elif text.startswith("${", start):
            self.at += 2
            while text[self.at] != "}":
                if text[self.at] == "'":
                    self.at = text.index("'", self.at + 1) + 1
                else:
                    self._piece(word, quoted=False)
            self.at += 1
        else:
            name = _NAME.match(text, start + 1)
            self.at = name.end() if name else start + 2
        word.text = before + text[start : self.at]

    def _until_closed(self) -> str:
        """Return the text up to the parenthesis that closes a command substitution."""
        start, depth = self.at, 1
        inside = _Lexer(self.text)
        inside.at = start
        for token in inside.tokens():
            if isinstance(token, Operator):
                depth += (token.text == "(") - (token.text == ")")
            if not depth:
                break
        if depth:
            raise NotUnderstood("a substitution without its end")
        self.at = inside.at
        return self.text[start : inside.at - 1]


def commands(script: str) -> Iterator[list[Word]]:
    """Return every simple command of a script as words, also in substitutions; redirections come as `>` and target.

    Raises:
        NotUnderstood: It uses more of the shell than is known here.
    """
    try:
        tokens: list[Token] = [*_Lexer(script).tokens(), Operator("\n")]
    except (IndexError, ValueError) as error:
        raise NotUnderstood(str(error)) from error
    current: list[Word] = []
    at = 0
    while at < len(tokens):
        token = tokens[at]
        at += 1
        if isinstance(token, Operator):
            if token.text == "<<" or (token.text == "(" and current):
                raise NotUnderstood(f"{token.text!r} after {[word.text for word in current]}")
            if token.text in ("<", "<&", ">", ">>", ">&", ">|", "<>"):
                target = tokens[at]
                at += 1
                assert isinstance(target, Word), "a redirection has a target"
                if current and current[-1].text.isdigit():
                    current.pop()
                yield from _substituted(target)
                yield [Word(token.text), target]
                continue
            if current:
                yield current
            current = []
            continue
        yield from _substituted(token)
        if not current and token.literal and token.text in _KEYWORDS:
            continue
        if not current and token.literal and token.text in ("for", "case"):
            at = yield from _head(tokens, at, token.text)
            continue
        if not current and token.literal and token.text == "esac":
            continue
        if not current and re.match(r"[A-Za-z_][A-Za-z0-9_]*=", token.text):
            if (
                token.text.partition("=")[0] in _RULING
                and not token.text.startswith(_OUR_PATH)
                and token.text not in _SEPARATORS
            ):
                current = [Word("export"), token]
            continue
        current.append(token)
        if _in_case(tokens, at, current):
            current = []
            at += 1


def _substituted(word: Word) -> Iterator[list[Word]]:
    for inner in word.inner:
        yield from commands(inner)


def _head(tokens: Sequence[Token], at: int, keyword: str) -> Iterator[list[Word]]:
    """Pass `for NAME in WORDS` or `case WORD in`; give where it ends."""
    while at < len(tokens):
        token = tokens[at]
        if isinstance(token, Operator) and token.text in (";", "\n"):
            break
        if isinstance(token, Word):
            yield from _substituted(token)
            if keyword == "case" and token.literal and token.text == "in":
                at += 1
                break
        at += 1
    return at


def _in_case(tokens: Sequence[Token], at: int, current: Sequence[Word]) -> bool:
    """Return whether what was read is the pattern of a `case`: one word and its closing parenthesis."""
    following = tokens[at] if at < len(tokens) else None
    if len(current) != 1 or not isinstance(following, Operator) or following.text != ")":
        return False
    depth = 0
    for token in reversed(tokens[: at - 1]):
        if isinstance(token, Operator):
            depth += (token.text == ")") - (token.text == "(")
            if depth < 0:
                return False  # inside of a subshell that this parenthesis closes
            if token.text == ";;":
                return True
        elif token.text == "in" and token.literal:
            return True
    return False


def _only(*allowed: str) -> Callable[[Sequence[str]], bool]:
    return lambda words: set(words) <= set(allowed)


def _anything(_words: Sequence[str]) -> bool:
    return True


def _no_option(*forbidden: str) -> Callable[[Sequence[str]], bool]:
    return lambda words: not any(word.startswith(forbidden) for word in words)


def _date(words: Sequence[str]) -> bool:
    return all(word == "-u" or word.startswith("+") for word in words)


def _ip(words: Sequence[str]) -> bool:
    if list(words[:2]) == ["netns", "exec"]:
        return list(words[3:6]) == ["wg", "show", "all"]
    rest = list(words)
    if "-n" in rest:  # the name of a namespace follows
        at = rest.index("-n")
        del rest[at : at + 2]
    plain = [word for word in rest if not word.startswith("-")]
    flags = [word for word in rest if word.startswith("-")]
    return set(flags) <= {"-j", "-d", "-o", "-4", "-6", "-br", "-json"} and plain[1:2] == ["show"]


def _find(words: Sequence[str]) -> bool:
    if any(word in ("-delete", "-ok", "-okdir", "-execdir", "-fprint", "-fprintf", "-fls") for word in words):
        return False
    runs = [words[at + 1 : at + 2] for at, word in enumerate(words) if word == "-exec"]
    return all(run in (["sha256sum"], ["stat"]) for run in runs)


def _flock(words: Sequence[str]) -> bool:
    """`flock -sn FILE true`: asks whether somebody holds a lock, and holds it no longer than that."""
    return list(words[:1]) == ["-sn"] and list(words[2:]) == ["true"]


def _sed(words: Sequence[str]) -> bool:
    if ["sed", *words] == shlex.split(_ESCAPED):
        return True
    return list(words[:1]) == ["-n"] and not any("w" in word.rpartition("/")[2] for word in words[1:])


_CAPS = ("-all", "-all,+dac_read_search")
_LIMITED = {"--nproc=0:0", "--fsize=0:0"}
"""No further process, and no byte into any file."""
_TRIES_TO_FORK = ["sh", "-c", "(:) && echo forks"]
_GIT_ASKS: tuple[list[str], ...] = (
    ["rev-parse", "--quiet", "--verify", "HEAD"],
    ["symbolic-ref", "--quiet", "--short", "HEAD"],
    ["config", "--local", "--no-includes", "--null", "--get-regexp"],
    ["for-each-ref", "--count=1", "--contains", "HEAD"],
    ["diff-index", "--patch", "--no-ext-diff", "--no-textconv", "--no-color"],
    ["ls-files", "--others", "--exclude-standard"],
    ["ls-files", "-v", "-z"],
)
"""What git is asked in a repository, each with its first words; nothing else, and not without limits."""


def _setpriv(words: Sequence[str]) -> bool:
    """`setpriv … prlimit … PROGRAM`: one that the kernel lets start no other, write nothing, and that is not root."""
    at = next((at for at, word in enumerate(words) if not word.startswith("--")), len(words))
    for name, equals, value in (word.partition("=") for word in words[:at]):
        known = {
            "--reuid": value.isdigit() and int(value) > 0,
            "--regid": value.isdigit(),
            "--inh-caps": value in _CAPS,
            "--ambient-caps": value in _CAPS,
            "--bounding-set": value in _CAPS,
            "--securebits": value == "+no_setuid_fixup",
        }
        if not (known.get(name, False) if equals else name in ("--clear-groups", "--no-new-privs")):
            return False
    rest = list(words[at:])
    if "--no-new-privs" not in words[:at] or rest[:1] != ["prlimit"]:
        return False
    limits = [word for word in rest[1:] if re.fullmatch(r"--(nproc|fsize|core|data|cpu)=[0-9]+:[0-9]+", word)]
    program = rest[1 + len(limits) :]
    return set(limits) >= _LIMITED and (program == _TRIES_TO_FORK or program[:1] == ["head"] or _git(program))


def _git(words: Sequence[str]) -> bool:
    if list(words[:2]) != ["env", "-i"] or "git" not in words:
        return False
    at = list(words).index("git")
    if not all(re.match(r"(GIT_[A-Z_]+|PATH|HOME|LC_ALL)=", word) for word in words[2:at]):
        return False
    rest = list(words[at + 1 :])
    while rest[:1] in (["--no-pager"], ["--no-replace-objects"], ["-c"]):
        rest = rest[2:] if rest[0] == "-c" else rest[1:]
    writes = any(word.startswith(("--output", "--ext-diff", "--textconv")) for word in rest)
    return any(rest[: len(asked)] == asked for asked in _GIT_ASKS) and not writes


def _apt_cache(words: Sequence[str]) -> bool:
    """`policy`, with caches that are in no file."""
    told = ["-o", "Dir::Cache::pkgcache=", "-o", "Dir::Cache::srcpkgcache=", "policy"]
    return list(words[:5]) == told and not any(word.startswith("-") for word in words[5:])


_BUILTINS = "printf echo test [ read exit : true false continue break unset umask cd"
_PROGRAMS = "cat ls readlink grep tr head tail wc df stat sha256sum uname id getconf sleep cut du"
_DIAL = ["system", "dial-stdio"]
READS: dict[str, Callable[[Sequence[str]], bool]] = {
    **dict.fromkeys((*_BUILTINS.split(), *_PROGRAMS.split()), _anything),
    "command": lambda words: list(words[:1]) == ["-v"],
    "set": lambda words: (
        list(words[:1]) == ["--"] or set(words) <= {"-e", "-u", "-f", "+f"}
    ),  # behind `--`: the shell's own words
    "export": _only("PATH", "LC_ALL", "SRPROV_SESSION", "mounted", "folder"),
    "date": _date,
    "sed": _sed,
    "sort": _no_option("-o", "--output"),
    "find": _find,
    "ip": _ip,
    "bridge": _ip,
    "flock": _flock,
    "iptables": lambda words: (
        list(words) == ["-V"] or ("-S" in words and set(words) <= {"-S", "-t", "nat", "filter", "-w"})
    ),
    "nft": lambda words: bool(re.fullmatch("(-s )?(-n )?list (tables?|ruleset).*", " ".join(words))),
    "nsenter": lambda words: words[0].startswith(("--net=/proc/", "--net=$n")) and words[1] == "ip" and _ip(words[2:]),
    "ip6tables": lambda words: list(words) == ["-V"],
    **dict.fromkeys(
        ("iptables-save", "ip6tables-save", "iptables-legacy-save", "ip6tables-legacy-save"),
        lambda words: list(words) in (["-t", "raw"], ["-c"]),
    ),
    "iw": lambda words: list(words[:1]) == ["dev"] and list(words[2:]) == ["link"],
    "modprobe": lambda words: list(words[:1]) == ["-n"],
    "chronyc": lambda words: list(words) == ["-c", "-n", "tracking"],
    "base64": lambda words: list(words) in ([], ["-w", "0"]),
    "realpath": lambda words: list(words[:2]) == ["-e", "--"],
    "unshare": lambda words: [word for word in words if word != "-r"] == ["-m", "true"],
    "dpkg-query": lambda words: list(words[:2]) == ["-W", "-f"] and len(words) == 3,
    "apt-cache": _apt_cache,
    "setpriv": _setpriv,
    "docker": lambda words: (
        list(words) in (_DIAL, ["-H", "unix:///var/run/docker.sock", *_DIAL])
        or list(words[:1]) in (["version"], ["info"])
    ),
}
"""Command -> whether it only reads with these arguments. Nothing else does."""
_HARMLESS_TARGETS = {"/dev/null", "1", "2"}


def shell_violations(script: str) -> list[str]:
    """Return what in a shell text is not on the list, as the words of the command."""
    found: list[str] = []
    try:
        for words in commands(script):
            found += _violations(words)
    except NotUnderstood as error:
        found.append(f"not understood: {error}: {script[:120]!r}")
    return found


def _violations(words: Sequence[Word]) -> list[str]:
    name, rest = words[0], [word.text for word in words[1:]]
    shown = " ".join(word.text for word in words)[:160]
    if name.text in ("<", "<&"):
        return []
    if name.text in (">", ">>", ">&", ">|", "<>"):
        return [] if words[1].literal and words[1].text in _HARMLESS_TARGETS else [shown]
    if not name.literal:
        return [shown]
    if name.text == "exec":
        return _violations(words[1:]) if words[1:] else []
    if name.text == "timeout":
        return _violations(words[2:]) if len(words) > 2 and rest[0].isdigit() else [shown]
    entered = rest[rest[:1] == ["-r"] :]
    if name.text == "unshare" and entered[:5] == ["-m", "sh", "-c", _ENTER, "sh"] and entered[7:8] == ["ro"]:
        return shell_violations(entered[6])  # in a mount namespace of its own, where nothing can be written
    if name.text == "xargs" and [*rest[:3], *rest[4:]] == ["-0", "sh", "-c", "sh"] and words[4].literal:
        return shell_violations(rest[3])  # what it is given becomes words of that
    if name.text == "eval":
        return shell_violations(rest[0]) if len(words) == 2 and words[1].literal else [shown]
    if name.text == "sh":
        if not rest:
            return []  # reads its input, which is looked at by itself
        return shell_violations(rest[1]) if rest[0] == "-c" and len(rest) == 2 and words[2].literal else [shown]
    check = READS.get(name.text)
    return [] if check is not None and check(rest) else [shown]


def engine_requests(sent: bytes) -> Iterator[tuple[str, str]]:
    """Return method and path of every HTTP/1.1 request that was written on a connection.

    Raises:
        NotUnderstood: Bytes that are no request.
    """
    while sent:
        head, end, sent = sent.partition(b"\r\n\r\n")
        first, *lines = head.decode("latin-1").split("\r\n")
        line = re.fullmatch(r"([A-Z]+) (\S+) HTTP/1\.1", first)
        if line is None or not end:
            raise NotUnderstood(f"no request line: {first[:120]!r}")
        fields = {key.strip().lower(): value.strip() for key, _, value in (one.partition(":") for one in lines)}
        yield line[1], line[2]
        if fields.get("transfer-encoding", "").lower() == "chunked":
            sent = _after_chunks(sent)
        else:
            sent = sent[int(fields.get("content-length", "0")) :]


def _after_chunks(body: bytes) -> bytes:
    while True:
        size, _, body = body.partition(b"\r\n")
        length = int(size.split(b";")[0], 16)
        body = body[length + 2 :]
        if not length:
            return body


def engine_violations(sent: bytes) -> list[str]:
    """Return the requests that are neither GET nor HEAD."""
    try:
        return [f"{method} {path}" for method, path in engine_requests(sent) if method not in ("GET", "HEAD")]
    except (NotUnderstood, ValueError) as error:
        return [f"not understood: {error}"]
