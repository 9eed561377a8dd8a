"""What a Dockerfile reaches beyond its context: images it names, and what the engine would fetch for it."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from srprov.definitions.dockerfile import check, fetches, images_of, stages, unclear
from tests.bounded import bounded
from tests.conftest import examples

URL = "http://169.254.169.254/latest/meta-data /x"
FETCHED = [
    f"FROM a\nADD {URL}\n",
    f"FROM a\nadd --chown=1:1 {URL}\n",
    f"FROM a\nONBUILD ADD {URL}\n",
    f"FROM a\nAD\\\nD {URL}\n",
    f"FROM a\nAD\\\n# a comment\n\nD {URL}\n",
    f"# escape=`\nFROM a\nAD`\nD {URL}\n",
    f"FROM a\nRUN x `\nADD {URL}\n",
    f"FROM a\nRUN <<END\nADD {URL}\nEND\n",
    'FROM a\nADD ["http:\\/\\/127.0.0.1/x", "/x"]\n',
    'FROM a\nADD ["\\u0068ttp:\\u002f/127.0.0.1/x", "/x"]\n',
    "FROM a\nARG WHERE\nADD ${WHERE} /x\n",
    "FROM a\r\nAD\\\r\nD git@lab:x.git /x\r\n",
    "FROM a\nADD me@lab:x.git /x\n",
    "FROM a\nADD a-@127.0.0.1:x.git /x\n",
    "FROM a\nADD a@b@127.0.0.1:x.git /x\n",
    f"FROM a\n# a `\n# b \\\nADD {URL}\n",
    f"FROM a\n# a `\n \t# b \\\nAD\\\n# c \\\n# d `\nD {URL}\n# e `\n",
]


@pytest.mark.parametrize("text", FETCHED)
def test_what_the_engine_would_fetch_is_seen_however_it_is_written(text: str) -> None:
    assert fetches(text)


@pytest.mark.parametrize(
    "text",
    [
        "FROM a\nADD --chown=me:me src/*.tar.gz /x/\n",
        'FROM a\nADD ["a b", "/x"]\n',
        "FROM a\nRUN apt-get update && \\\n    apt-get install curl\nCOPY add http.txt /x/\nRUN curl http://lab/\n",
    ],
)
def test_a_file_of_the_context_is_not_fetched(text: str) -> None:
    assert fetches(text) == ()


def test_every_image_that_a_dockerfile_names_is_known() -> None:
    text = (
        "ARG BASE\nFROM --platform=linux/arm64 debian:bookworm AS build\nFROM build AS second\nFROM $BASE\n"
        "COPY --from=build /a /a\nCOPY --from=0 /a /a\nCOPY --chown=1 --from=srprov/other:1 /a /a\n"
    )
    assert images_of(text) == ("$BASE", "debian:bookworm", "srprov/other:1")


def test_a_stage_is_an_image_to_itself_and_a_number_beyond_all_stages_is_one() -> None:
    """Docker looks for an image of the robot under these names."""
    number = "9" * 20
    text = f"FROM a AS fedcba\nCOPY --from=fedcba /x /x\nFROM a\nCOPY --from=0 /x /x\nCOPY --from={number} /x /x\n"
    assert images_of(text) == (number, "a", "fedcba")
    assert images_of("FROM a AS one\nFROM one AS one\nCOPY --from=one /x /x\n") == ("a",)


@pytest.mark.parametrize(
    "mount",
    [
        *("FROM=srprov/other:1,target=/x", "type=bind,from=a,from=srprov/other:1", "from=0,From=srprov/other:1"),
        *("source=/from=a,from=srprov/other:1", "type=cache,from=srprov/other:1,id=a"),
    ],
)
def test_an_image_that_a_command_mounts_is_known_however_it_is_written(mount: str) -> None:
    """BuildKit, which builds what was exported, takes keys in any case, and the last of several."""
    text = f"FROM a\nRUN --mount={mount} cat /x\n"
    assert "srprov/other:1" in images_of(text) and unclear(text) is None


@pytest.mark.parametrize(
    "words", ["--mount=type=bind,fr'o'm=srprov/other:1", '--mount="from=b"', "--mount=from\\=b", "--network=none --"]
)
def test_options_of_a_command_that_builders_take_apart_in_their_own_way_are_refused(words: str) -> None:
    assert unclear(f"FROM a\nRUN {words} cat /x\n") == (2, "an option holds a quote or an escape, or nothing")
    assert unclear("FROM a\nRUN --network=none cat '/x' -- \"$y\" \\n\n") is None


def test_an_image_that_a_command_mounts_is_known() -> None:
    assert images_of("FROM a\nRUN --mount=type=bind,from=srprov/other:1,target=/x cat /x\n") == ("a", "srprov/other:1")


def test_an_image_behind_a_continued_line_is_known() -> None:
    assert "srprov/other:1" in images_of("FROM a\nFR\\\nOM srprov/other:1\n")
    assert "srprov/other:1" in images_of("FROM a\nFROM \\\n srprov/other:1\n")


def test_a_comment_hides_no_image_whatever_it_ends_in() -> None:
    text = "FROM busybox\n# a `\n# b \\\nFROM srprov/other:1\n# c \\\n# d `\nCOPY --from=srprov/more:1 /a /a\n"
    assert images_of(text) == ("busybox", "srprov/more:1", "srprov/other:1")


UNCLEAR = [
    'FROM a\nCOPY --f"rom"=srprov/victim:1 /x /x\n',
    "FROM a\nCOPY --fr\\om=srprov/victim:1 /x /x\n",
    "FROM a\nCOPY --fr\\\nom'='srprov/victim:1 /x /x\n",
    'FROM a\nONBUILD copy --f"rom"=srprov/victim:1 /x /x\n',
    "FROM a\nCOPY \f--from=srprov/victim:1 /x /x\n",
    "FROM a\nCOPY --chown=1\u00a0--from=srprov/victim:1 /x /x\n",
    "FROM a\nFROM\fsrprov/victim:1\n",
    "FROM a\nFROM\vsrprov/victim:1\n",
    "FROM a\nADD\vhttp://127.0.0.1/x /x\n",
    'FROM a\nADD http:"//"127.0.0.1/x /x\n',
    'FROM a\nADD [ "x", http:"//"127.0.0.1/x /x\n',
    "FROM a\nADD http:\\//127.0.0.1/x /x\n",
    'FROM a\nRUN <<END\nADD http:"//"127.0.0.1/x /x\nEND\n',
    # for a builder that knows them, the line after `#x` begins an instruction; for others it goes on with `y`
    "FROM a\nRUN <<'#x'\ny \\\n#x\nADD http://127.0.0.1/x /x\n",
    "FROM a\nONBUILD RUN 3<<'x\\'\nx\\\nFROM srprov/victim:1\n",
    "FROM a\nRUN ${X:-<}${X:-<}'#x' '<<'\n",
    "FROM a\nRUN \\\\\ncat <<x\n",
    'FROM a\nCOPY <<"" /x\n',
    "FROM a\nRUN <<EOF\nHEALTHCHECK CMD x\nEOF\n",
    "FROM a\nRUN true || echo $(( <<E ))\nFROM a AS srprov/victim:1\nE\nFROM a\nCOPY --from=srprov/victim:1 /x /x\n",
    "FROM a\nRUN echo $((1\t<<E))\nENV A=1\n",
    "FROM a\nCOPY $((\t<<E\t)) /x\nE",
    # quotes within a variable within quotes: the text's `RUN x` ends a here-document for a builder
    "FROM a\nRUN RUN() { :; } # \"${X:-'\"'}\" '\"' <<'RUN x \\' '\"' \"${X:-'\"'}\"\nRUN x \\\nFROM \\\nb\nRUN y\n",
    'FROM a\nRUN : "${X:-"\'"}" <<E "${X:-"\'"}"\n',
    "FROM a\nRUN ${X:-${Y}<}${X:-${Y}<}E '<<'\n",
    "FROM a\nRUN : <${X:- }<E\n",
    "FROM a\nRUN : <$X<E\n",
    'FROM a\nRUN : <""<E\n',
    "FROM a\nRUN : \\<\\<E\n",
    'FROM a\nRUN : "a << b"\n',
    # what hides a FROM hides it as one of these
    "FROM a AS srprov/victim:1\n",
    "FROM a as Evil/Base:1\nFROM evil/base:1\n",
    "FROM a AS 0\n",
    "FROM a\nE\n",
    "FROM a\nONBUILD E x\n",
    "FROM a\nONBUILD ONBUILD RUN x\n",
    "FROM a\nONBUILD FROM b\n",
    f"FROM a\n{'ONBUILD ' * 3000}RUN x\n",
    # the mark of a build stands behind each FROM
    "FR\\\nOM a\n",
    "FROM a\n\tR\\\nUN x\n",
    # an old builder goes on there: the last line is an image's then
    "FROM a\nRUN echo \\\\\nFROM a AS b\n\nFROM b\n",
    "FROM a\nRUN echo \\\\\\ \t\nFROM a AS b\nFROM b\n",
    "ARG A=1 \\\\\nARG ALL_PROXY\nFROM a\n",
    'FROM a\nRUN x \\\\\nADD http:"//"127.0.0.1/x /x\n',
    "FROM a\n# note\u2028FROM srprov/victim:1\n",
    "FROM a\nRUN x\rFROM srprov/victim:1\n",
    "FROM a\nAD\\\n\u00a0# note\nD http://127.0.0.1/x /x\n",
    "# escape=`\nFROM a\n",
    "# syntax=evil.example/frontend:1\nFROM a\n",
    "#SYNTAX = 127.0.0.1:5000/docker/dockerfile:1\nFROM a\n",
    "//syntax=docker/dockerfile/x\nFROM a\n",
    '{"syntax": "evil.example/frontend"}\nFROM a\n',
    "FROM -- srprov/victim:1\n",
    "FROM a\nONBUILD -- ADD http://127.0.0.1/x /x\n",
    "FROM a\nRUN echo x \\\n",
    "FROM a\nRUN echo x \\ \n\n  # c\n",
    "FROM a\nONBU\u0130LD ADD http://127.0.0.1/x /x\n",
]

HIDDEN = [
    "ARG http_proxy=http://evil.example\nFROM a\nARG V=1\nRUN x\n",
    "ARG A=1 HTTPS_PROXY=x\nFROM a\n",
    "# c\narg \\\n  No_Proxy=x\nFROM a\n",
    'ARG "http_proxy"=x\nFROM a\n',
    "ARG A=tp\nARG ht${A}_proxy=x\nFROM a\n",
    "ARG h\\ttp_proxy=x\nFROM a\n",
    "ARG A='\\' http_proxy=x '\nFROM a\n",
]


@pytest.mark.parametrize("text", HIDDEN)
def test_a_proxy_that_a_builder_leaves_out_of_what_it_knows_a_layer_by_is_refused(text: str) -> None:
    """A layer that came through a stranger's proxy would be in the image of another experiment with the same step."""
    (found,) = check(text, "Dockerfile")
    assert "a proxy before FROM" in found.message and found.location.line <= text.count("FROM") + text.count("ARG") + 1


@pytest.mark.parametrize(
    "run",
    [
        "#(nop) COPY dir:0 in /conf ",
        '["/bin/sh", "-c", "#(nop) COPY dir:0 in /conf "]',
        '["/bin/sh", "-c", "\\u0023(n\\u006fp) COPY dir:0 in /conf "]',
        '["/bin/sh", "-c", "#(no\\\np) COPY dir:0 in /conf "] x',
    ],
)
def test_a_run_that_a_builder_would_take_for_a_copy_is_refused(run: str) -> None:
    """It was the layer of that COPY in another experiment's image, which then had none of the files."""
    (found,) = check(f"FROM a\nRUN {run}\n", "Dockerfile")
    assert "another instruction" in found.message and found.location.line == 2


def test_a_proxy_in_a_stage_counts_there_and_other_args_are_taken() -> None:
    text = 'ARG TAG=1 "A"\nFROM a:${TAG}\n'
    assert unclear(text) is not None
    assert unclear("ARG TAG=\"a b\" B='c' C\nFROM a:${TAG}\nARG http_proxy=http://lab:3128\nRUN x\n") is None


@pytest.mark.parametrize("text", UNCLEAR)
def test_what_docker_may_read_otherwise_is_refused_at_its_line(text: str) -> None:
    (found,) = check(text, "Dockerfile")
    assert "Docker may read this line otherwise" in found.message
    where = unclear(text)
    assert where is not None and found.location.line == where[0] <= text.count("\n")


@pytest.mark.parametrize(
    "text",
    [
        'ARG TAG=1\nFROM --platform=$BUILDPLATFORM debian:${TAG} AS b\nRUN "a\\\\b" \\\n  x\nCOPY --from=b "a b" /x\n',
        'FROM a\r\nCOPY --chown=$U:$G ["a b", "/x/"]\r\nADD \\\r\n  ["a b", "/x"]\r\n',
        'FROM a\nRUN echo $((1<<2)) && cat <<< "$x" < b\nRUN ["sh", "-c", "cat <<E\\n1\\nE"]\nRUN cat <a $B && <b $C\n',
        "FROM a\n\trun\\\n  x < ${A} && y 2>&1\nONBUILD RUN cat < a > b\nHEALTHCHECK NONE\n",
        '\ufeffFROM a\nENV A=\'1\' B="\u00a02"\nADD $WHERE /x\nRUN `x`\n# "copy" it\n',
    ],
)
def test_an_ordinary_dockerfile_reads_the_same(text: str) -> None:
    assert (unclear(text), check(text, "Dockerfile")) == (None, [])


def test_an_instruction_after_a_line_that_ends_with_two_escapes_is_seen() -> None:
    text = "FROM a\nRUN x \\\\\nADD http://127.0.0.1/x /x\nRUN y \\\\\nFROM srprov/other:1\n"
    assert fetches(text) and "srprov/other:1" in images_of(text)


@pytest.mark.parametrize("end", ["", "\n", "\n\n# a comment\n", "\n \\\n"])
def test_an_instruction_that_the_text_ends_in_is_read(end: str) -> None:
    """Builders run it, as if nothing were continued."""
    assert list(stages(f"FROM a\nFROM b AS c \\{end}")) == [(1, "a", ""), (2, "b", "c")]
    assert list(stages(f"\\{end}")) == []


def test_stages_are_read_behind_continued_lines() -> None:
    text = "FROM a AS one\nFR\\\nOM b@sha256:0 \\\n# note\n  AS Two\nFROM\ttwo\n"
    assert list(stages(text)) == [(1, "a", "one"), (2, "b@sha256:0", "two"), (6, "two", "")]


def test_a_base_that_only_the_builder_knows_may_fetch_anything() -> None:
    """Its ONBUILD instructions cannot be looked at before the build."""
    assert fetches("ARG B=evil/base:1\nFROM $B\n") == ("FROM $B",)
    assert fetches("FROM srprov/vic'tim':1\n") == ("FROM srprov/vic'tim':1",)


def docker(text: str, joint: str) -> list[tuple[str, str]]:
    """Return the instructions as Docker's own parser reads them (buildkit, frontend/dockerfile/parser/parser.go)."""
    found, lines = [], iter(text.split("\n"))
    for line in lines:
        whole = re.sub(r"^#.*$", "", line.lstrip())
        while (match := re.search(joint, whole)) is not None:
            whole = whole[: match.start()]
            more = next((one for one in lines if one.strip() and not one.lstrip().startswith("#")), None)
            if more is None:
                break
            whole += more
        if whole.strip():
            word, _, rest = whole.partition(" ")
            found.append((word.upper(), rest.strip()))
    return found


PIECES = [
    *("FROM x/y", "FROM x/y AS b", "FROM b", "COPY --from=x/z /a /a", f"ADD {URL}", "FR", "OM x/y", "AD", f"D {URL}"),
    *("RUN a", "RUN <<A", "A", "# a", " # a", "#", "", " ", "\\", "\\\\", "`", "``", "ONBUILD "),
]
ENDS = ["\n", "\n", "\n", "\\\n", "\\ \t\n", "\\\\\n", "`\n", "``\n", ""]


@given(st.lists(st.tuples(st.sampled_from(PIECES), st.sampled_from(ENDS)), max_size=12), st.sampled_from(["\\\\", "`"]))
@settings(max_examples=examples(300))
def test_whatever_docker_reads_from_a_file_is_known(drawn: list[tuple[str, str]], escape: str) -> None:
    text = "FROM a\n" + "".join(piece + end for piece, end in drawn)
    for joint in (rf"{escape}[ \t]*$", rf"(?<!{escape}){escape}[ \t]*$"):
        read = docker(text, joint)
        added = [rest for word, rest in read if word == "ADD" or (word == "ONBUILD" and rest.startswith("ADD "))]
        assert fetches(text) or not [rest for rest in added if "://" in rest]
        named = [rest.split()[0] for word, rest in read if word == "FROM" and rest.startswith("x/y")]
        named += ["x/z" for word, rest in read if word == "COPY" and rest.startswith("--from=x/z ")]
        assert not [name for name in named if name not in images_of(text)]


def test_a_long_word_with_signs_of_an_address_is_gone_through_once() -> None:
    text = f"FROM a\nADD {'@' * 120_000} /x\n"
    assert bounded(lambda: fetches(text), cpu_s=0.5) == ()
