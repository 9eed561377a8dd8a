"""A Dockerfile -> what srprov must know of it: whether it is one, and whether its image has a healthcheck.

Takes the text; gives instructions with their lines. Pure. Nothing is expanded; Docker itself builds it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from srprov.codes import Code
from srprov.definitions import dockerwords, heredoc, images
from srprov.errors import Diagnostic, Location

_FROM = re.compile(r"(?:--\S*\s+)*(?P<image>\S+)(?:\s+as\s+(?P<name>\S+))?", re.IGNORECASE)
MAX_BYTES = 128 * 1024
_EXPANDED = re.compile(r"[$\"'\\`]")
"""What the builder takes for variables, quotes or escapes in an image's name."""
_FROM_LINE = re.compile(rf"\s*(?:ONBUILD\s+)*FROM\s+{_FROM.pattern}\s*", re.IGNORECASE)
_FROM_OPTION = re.compile(r"\s--(from|mount)=(\S+)")
_NUMBER = re.compile("[0-9]{1,9}")
"""Of a stage; one that is too large for a number is an image's name again."""
_ADD_LINE = re.compile(r"\s*(?:ONBUILD\s+)*ADD\b(?P<what>.*)", re.IGNORECASE)
_LOCAL = re.compile(r"[\w./ \t\"\[\],=*?@+:-]*", re.ASCII)
"""What cannot be a URL once `://` is not in it: no variable and no escape."""
_REMOTE = re.compile(r"://|@[^\s/@]*:")
_STRANGE = re.compile("[\x00-\x08\x0a-\x1f\x7f-\x9f\u2028\u2029]")
"""Control characters and separators of lines: each reader of a Dockerfile has its own idea of them."""
_OTHER_BLANK = re.compile(r"[^\S \t\r]")
_ESCAPE = re.compile(r"#\s*escape\s*=\s*[^\\\s]", re.IGNORECASE)
_FRONTEND = re.compile(r"(?i)(#|//)\s*syntax\s*=(?!\s*(docker\.io/)?docker/dockerfile(-upstream)?([:@][\w.:@-]+)?\Z)")
OPTIONS = re.compile(r"(?:--\S*(?:\s+|\Z))*")
"""What stands before the words of an instruction."""
_QUOTE = re.compile(r"[\"'\\]")
_CONTINUED = re.compile(r"(?<!\\)\\\Z")
_JOINTS = (_CONTINUED, re.compile(r"\\\Z"), re.compile(r"(?<!`)`\Z"), re.compile(r"`\Z"))
"""Where builders join lines: of two escapes at a line's end the second joins, or does not; or at backticks."""
READINGS = len(_JOINTS)
_MOST_PROBLEMS = 100


def is_dockerfile(path: str) -> bool:
    """Return whether a path is a Dockerfile, by its name: `…Dockerfile` or `*.dockerfile`."""
    name = path.rsplit("/", 1)[-1]
    return name.endswith("Dockerfile") or name.startswith("Dockerfile.") or name.endswith(".dockerfile")


def instructions(text: str, continued: re.Pattern[str] = _CONTINUED) -> Iterator[tuple[int, str, str]]:
    """Yield (line, INSTRUCTION, rest), comments left out before lines are joined where `continued` matches."""
    start, joined = 0, ""
    for number, line in enumerate(text.removeprefix("\ufeff").split("\n"), 1):
        bare = line.strip()
        if not bare or bare.startswith("#"):
            continue
        start = start or number
        whole = line.rstrip(" \t\r")
        if continued.search(whole):
            joined += whole[:-1]
            continue
        word, *rest = (joined + line).strip().split(None, 1)
        yield start, word.upper(), " ".join(rest)
        start, joined = 0, ""
    if words := joined.split(None, 1):
        # the text ends within an instruction, which builders run all the same
        yield start, words[0].upper(), " ".join(words[1:]).rstrip()


def stages(text: str) -> Iterator[tuple[int, str, str]]:
    """Yield (line, image, name) of every stage; the name is in lower case, or empty."""
    for number, word, rest in instructions(text):
        match = _FROM.fullmatch(rest) if word == "FROM" else None
        if match is not None:
            yield number, match["image"], (match["name"] or "").lower()


def until_stage(text: str, target: str) -> str:
    """Return the text up to the end of a stage, by its name or number: no stage needs a later one.

    Raises:
        ValueError: There is no such stage; the message names those that there are.
    """
    if not target:
        return text
    begins = [(number, name) for number, _, name in stages(text)]
    named = [index for index, (_, name) in enumerate(begins) if name == target.lower()]
    if not named and target.isdecimal() and int(target) < len(begins):
        named = [int(target)]
    if not named:
        known = ", ".join(name for _, name in begins if name) or "none has a name"
        raise ValueError(f"the Dockerfile has no stage '{target[:60]}' ({known})")
    following = begins[named[-1] + 1 :]
    return "\n".join(text.split("\n")[: following[0][0] - 1]) + "\n" if following else text


def declared(text: str) -> frozenset[str]:
    """Return the names that ARG instructions declare."""
    words = (word for _, name, rest in instructions(text) if name == "ARG" for word in rest.split())
    return frozenset(word.partition("=")[0] for word in words)


def is_open(image: str) -> bool:
    """Return whether only the builder knows which image a name in FROM means."""
    return _EXPANDED.search(image) is not None


def has_healthcheck(text: str) -> bool:
    """Return whether the last stage, or an earlier stage that it is built from, sets a healthcheck."""
    by_stage: dict[str, bool] = {}
    name, found = "", False
    for _, word, rest in instructions(text):
        match = _FROM.fullmatch(rest) if word == "FROM" else None
        if match is not None:
            found, name = by_stage.get(match["image"].lower(), False), (match["name"] or "").lower()
        elif word == "HEALTHCHECK":
            found = rest.strip().upper() != "NONE"
        by_stage[name] = found
    return found


def images_of(text: str) -> tuple[str, ...]:
    """Return the images that any reading of the text starts from or takes files of, as written, sorted."""
    found: set[str] = set()
    for lines in _readings(text):
        stages, own = {"scratch"}, ""
        for line in lines:
            if start := _FROM_LINE.match(line):
                stages.add(own)  # within a stage its own name is still that of an image
                if start["image"].lower() not in {*stages, "\\", "`"}:
                    found.add(start["image"])
                own = (start["name"] or "").lower()
            for name in _named_by_options(line):
                if name.lower() not in stages and not _NUMBER.fullmatch(name):
                    found.add(name)
    return tuple(sorted(found))


def _named_by_options(line: str) -> Iterator[str]:
    """Yield what the options of an instruction take files of: of a mount each `from`, of which the last one counts."""
    for option, value in _FROM_OPTION.findall(line):
        for field in value.split(",") if option == "mount" else (f"from={value}",):
            key, _, name = field.partition("=")
            if key.lower() == "from" and name:
                yield name


def fetches(text: str) -> tuple[str, ...]:
    """Return what any reading of the text ADDs that is not surely a file of the build's context, sorted.

    An image that only the builder knows counts too: its ONBUILD instructions may ADD anything.

    A classic build's engine fetches a URL itself, in the robot's own network: its loopback, its metadata service.
    """
    added = {match["what"].strip() for lines in _readings(text) for line in lines if (match := _ADD_LINE.match(line))}
    unknown = {f"FROM {image}" for image in images_of(text) if is_open(image)}
    return tuple(sorted(unknown | {what for what in added if not _LOCAL.fullmatch(what) or _REMOTE.search(what)}))


def _readings(text: str) -> Iterator[list[str]]:
    """Yield the instructions, one a line, as each builder may join them."""
    return ([f"{word} {rest}" for _, word, rest in instructions(text, joint)] for joint in _JOINTS)


def check(text: str, shown: str) -> list[Diagnostic]:
    """Return what is wrong with a Dockerfile as far as srprov can tell."""
    lines = text.split("\n")
    if (found := unclear(text)) is not None:
        message = f"Docker may read this line otherwise than srprov does: {found[1]}"
        hint = "write FROM, COPY and ADD with plain words and spaces, or as a JSON list; what is long, into a file"
        place, excerpt = Location(shown, found[0]), lines[found[0] - 1].rstrip("\r")
        return [Diagnostic(place, message, "", excerpt, hint, code=Code.DOCKERFILE)]
    first = next(((number, word, rest) for number, word, rest in instructions(text) if word != "ARG"), None)
    if first is None:
        hint = "a Dockerfile begins with FROM"
        return [Diagnostic(Location(shown), "holds no instruction", hint=hint, code=Code.DOCKERFILE)]
    (number, word, rest), excerpt = first, lines[first[0] - 1]
    place = Location(shown, number, len(excerpt) - len(excerpt.lstrip()) + 1)
    if word != "FROM":
        return [Diagnostic(place, f"a Dockerfile begins with FROM, not {word[:40]}", "", excerpt, code=Code.DOCKERFILE)]
    if not rest:
        return [Diagnostic(place, "FROM needs an image", "", excerpt, code=Code.DOCKERFILE)]
    return _wrong_bases(text, shown)


def _wrong_bases(text: str, shown: str) -> list[Diagnostic]:
    """Return every FROM whose image cannot be one; what holds a variable or quotes is left to the builder."""
    lines, begins = text.split("\n"), [number for number, *_ in instructions(text)]
    ends = dict(zip(begins, [*begins[1:], len(lines) + 1], strict=True))
    known, found = {"scratch"}, list[Diagnostic]()
    for number, image, name in stages(text):
        if image.lower() not in known and not _EXPANDED.search(image) and (wrong := images.fault(image)):
            at = next((line for line in range(number, ends[number]) if image in lines[line - 1]), number)
            place = Location(shown, at, lines[at - 1].find(image) + 1)
            found.append(Diagnostic(place, wrong, "", lines[at - 1], images.hint(image), code=Code.IMAGE_NAME))
        known.add(name)
    return found[:_MOST_PROBLEMS]


def unclear(text: str) -> tuple[int, str] | None:
    """Return the first line that Docker may read otherwise than srprov does, and why; None where both read the same.

    Docker takes quotes and escapes out of words, ends lines at line feeds only, and has other blanks than others.
    """
    if more := dockerwords.beyond(text.count("\n"), (number for number, *_ in instructions(text))):
        return more
    last, lines = (0, ""), text.removeprefix("\ufeff").replace("\r\n", "\n").split("\n")
    for number, line in enumerate(lines, 1):
        last = last if line.strip(" \t")[:1] in ("", "#") else (number, line.rstrip(" \t"))
        if strange := _STRANGE.search(line):
            return number, f"it holds the character U+{ord(strange[0]):04X}"
        if _OTHER_BLANK.match(line.lstrip(" \t")):
            return number, "it begins with a blank that is neither a space nor a tab"
        if _ESCAPE.match(line.strip()):
            return number, "it changes the escape character"
        if _FRONTEND.match(line.strip()):
            return number, "it names another frontend than docker/dockerfile"
        if last[0] == number and last[1].endswith("\\\\"):
            return number, "some builders go on after two escapes at its end, and others do not"
    if last[1].endswith("\\"):  # what srprov adds below would be a part of it
        return last[0], "it goes on, and nothing follows"
    if number := dockerwords.hidden_proxy(instructions(text)):
        return number, "a proxy before FROM is no part of what a builder knows a layer by; write it below"
    for number, instruction, words in instructions(text):
        word, rest = dockerwords.triggered(instruction, words)
        if word not in (dockerwords.TRIGGERED if instruction == "ONBUILD" and words else dockerwords.KNOWN):
            return number, "it begins with no instruction that builders know"
        if dockerwords.is_split(instruction, lines[number - 1]):
            return number, "the word of its instruction goes on in another line"
        if word in ("RUN", "COPY", "ADD") and not dockerwords.is_list(rest) and heredoc.may_begin(rest):
            return number, "it may begin a here-document, which the engine's builder does not know"
        if word == "RUN" and dockerwords.is_builders_own(rest):
            return number, "a builder may take it for another instruction: it holds #(nop)"
        if word in ("FROM", "COPY", "ADD", "RUN") and (why := _unclear_words(word, rest)):
            return number, why
    return None


def _unclear_words(instruction: str, rest: str) -> str:
    """Return why the words of a FROM, COPY or ADD, or a RUN's options, may not be what they look like, or nothing."""
    if instruction != "RUN" and _OTHER_BLANK.search(rest):
        return "it holds a blank that is neither a space nor a tab"
    options = OPTIONS.match(rest)
    words = rest[options.end() :] if options else rest
    stage = _FROM.fullmatch(rest) if instruction == "FROM" else None
    if stage and stage["name"] and not dockerwords.STAGE.fullmatch(stage["name"]):
        return "no stage can have that name"
    if options and (_QUOTE.search(options[0]) or "--" in options[0].split()):
        return "an option holds a quote or an escape, or nothing"
    # what a COPY copies is in the build's context, however it is written; what FROM names is asked for then
    taken_as_is = instruction in ("COPY", "FROM", "RUN") or (instruction == "ADD" and dockerwords.is_list(words))
    return "a name holds a quote or an escape" if not taken_as_is and _QUOTE.search(words) else ""
