"""What a Dockerfile reaches beyond its context: images it names, and what the engine would fetch for it."""

from __future__ import annotations

import pytest

from srprov.definitions.dockerfile import fetches, images_of

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


def test_an_image_behind_a_continued_line_is_known() -> None:
    assert "srprov/other:1" in images_of("FROM a\nFR\\\nOM srprov/other:1\n")
    assert "srprov/other:1" in images_of("FROM a\nFROM \\\n srprov/other:1\n")
