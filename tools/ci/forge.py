"""What srprov says of a change, told to GitHub or GitLab: one comment that is updated, SARIF, and marks beside lines.

    forge.py comment NAME FILE    write a file's Markdown as the comment NAME on this pull or merge request
    forge.py sarif FILE           upload SARIF to GitHub's code scanning
    forge.py annotate FILE        print what `srprov validate --format json` wrote as GitHub's commands for marks

Run by steps.sh; which forge it is, and which request, its runner's variables say. The token comes from
SRPROV_CI_TOKEN. Needs Python 3.9 alone. A token that may not write gets a warning and exit code 0: on requests from
forks that is as it should be.
"""

from __future__ import annotations

import base64
import gzip
import json
import os
import re
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote

LONGEST = 65_000
"""Characters of a comment; GitHub takes 65,536."""
MOST_PAGES = 50
PER_PAGE = 100
TIMEOUT_S = 30
MAY_NOT = (403, 404)
"""What a forge answers to a token that may not write; 404 where it may not even know what is there."""


class ForgeError(Exception):
    """The forge did not do it; `status` is HTTP's, or 0."""

    def __init__(self, message: str, status: int = 0) -> None:
        super().__init__(message)
        self.status = status


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    """The token goes to no other address than the runner's own."""

    def redirect_request(self, *_about: object) -> None:
        return None


class Forge:
    """Where the request is: the address of its comments, and whose comments are ours."""

    comments: str
    """Below the address of the API."""
    updating = "PATCH"

    def __init__(self, api: str, headers: Mapping[str, str]) -> None:
        self._api, self._headers = api.rstrip("/"), {"User-Agent": "srprov", **headers}
        self._opener = urllib.request.build_opener(_NoRedirect)

    def one(self, number: int) -> str:
        """Return where one comment is."""
        raise NotImplementedError

    def is_ours(self, comment: Mapping[str, Any]) -> bool:
        """Tell whether the token's owner wrote a comment: anybody may write our marker into theirs."""
        raise NotImplementedError

    def ask(self, method: str, path: str, body: Mapping[str, Any] | None = None) -> Any:  # noqa: ANN401 - JSON
        """Send a request, and return the answer's JSON.

        Raises:
            ForgeError: It was not done.
        """
        data = None if body is None else json.dumps(body).encode()
        headers = {**self._headers, "Content-Type": "application/json"}
        request = urllib.request.Request(f"{self._api}/{path}", data=data, headers=headers, method=method)  # noqa: S310 - the runner's own address
        try:
            with self._opener.open(request, timeout=TIMEOUT_S) as answer:
                return json.loads(answer.read() or b"null")
        except urllib.error.HTTPError as error:
            raise ForgeError(f"{method} {path}: {error.code} {error.reason}", error.code) from None
        except (OSError, ValueError) as error:
            raise ForgeError(f"{method} {path}: {error}") from None

    def say(self, marker: str, text: str) -> str:
        """Write our comment with a marker anew, or the first one; return what was done."""
        body = {"body": f"{marker}\n{text}"}
        for comment in self._all():
            if str(comment.get("body", "")).startswith(marker) and self.is_ours(comment):
                self.ask(self.updating, self.one(int(comment["id"])), body)
                return "updated"
        self.ask("POST", self.comments, body)
        return "written"

    def _all(self) -> Iterator[Mapping[str, Any]]:
        for page in range(1, MOST_PAGES + 1):
            found = self.ask("GET", f"{self.comments}?per_page={PER_PAGE}&page={page}")
            yield from found
            if len(found) < PER_PAGE:
                return


class GitHub(Forge):
    """The pull request that the workflow runs for."""

    def __init__(self, environ: Mapping[str, str]) -> None:
        accept = {"Accept": "application/vnd.github+json", "X-GitHub-Api-Version": "2022-11-28"}
        super().__init__(environ["GITHUB_API_URL"], {"Authorization": f"Bearer {token(environ)}", **accept})
        self._repository = f"repos/{environ['GITHUB_REPOSITORY']}"
        event = json.loads(Path(environ["GITHUB_EVENT_PATH"]).read_text(encoding="utf-8"))
        number = event.get("pull_request", {}).get("number")
        self.comments = f"{self._repository}/issues/{number}/comments" if number else ""
        self._author = environ.get("SRPROV_CI_AUTHOR") or "github-actions[bot]"

    def one(self, number: int) -> str:
        """Return where one comment is."""
        return f"{self._repository}/issues/comments/{number}"

    def is_ours(self, comment: Mapping[str, Any]) -> bool:
        """Tell whether the workflow's own user wrote it."""
        return bool((comment.get("user") or {}).get("login") == self._author)

    def upload(self, sarif: bytes, environ: Mapping[str, str]) -> None:
        """Hand SARIF to code scanning, for the commit that the workflow runs for."""
        packed = base64.b64encode(gzip.compress(sarif)).decode()
        body = {"commit_sha": environ["GITHUB_SHA"], "ref": environ["GITHUB_REF"], "sarif": packed}
        self.ask("POST", f"{self._repository}/code-scanning/sarifs", body)


class GitLab(Forge):
    """The merge request that the pipeline runs for."""

    updating = "PUT"

    def __init__(self, environ: Mapping[str, str]) -> None:
        super().__init__(environ["CI_API_V4_URL"], {"PRIVATE-TOKEN": token(environ)})
        request = environ.get("CI_MERGE_REQUEST_IID")
        project = quote(environ["CI_PROJECT_ID"], safe="")
        self.comments = f"projects/{project}/merge_requests/{request}/notes" if request else ""
        self._me: object = None

    def one(self, number: int) -> str:
        """Return where one comment is."""
        return f"{self.comments}/{number}"

    def is_ours(self, comment: Mapping[str, Any]) -> bool:
        """Tell whether the token's user wrote it."""
        if self._me is None:
            self._me = self.ask("GET", "user")["id"]
        return bool((comment.get("author") or {}).get("id") == self._me)


def token(environ: Mapping[str, str]) -> str:
    """Return the token.

    Raises:
        ForgeError: There is none, which is as one that may not write.
    """
    found = environ.get("SRPROV_CI_TOKEN", "")
    if not found:
        raise ForgeError("there is no token (SRPROV_CI_TOKEN)", MAY_NOT[0])
    return found


def forge(environ: Mapping[str, str]) -> Forge:
    """Return the forge that this runs on."""
    return GitLab(environ) if environ.get("GITLAB_CI") else GitHub(environ)


def fitting(text: str) -> str:
    """Return text that fits into a comment: one that is too long is cut after a line, and says so."""
    if len(text) <= LONGEST:
        return text
    kept = text[: LONGEST - 200].rpartition("\n")[0]
    end = "\n\n</details>" * max(0, kept.count("<details>") - kept.count("</details>"))
    return f"{kept}{end}\n\n*Too long for a comment: the rest stands in what the job keeps.*\n"


def marker(name: str) -> str:
    """Return the line by which a comment is found again; it is not shown."""
    return f"<!-- srprov:{re.sub('[^A-Za-z0-9_./]', '_', name)} -->"


def annotations(found: Mapping[str, Any]) -> Iterator[str]:
    """Return GitHub's commands for marks beside lines, of what `validate --format json` says."""
    for level, key in (("error", "problems"), ("warning", "warnings")):
        for one in found[key]:
            place = f"file={_value(one['file'])},line={one['line']},col={one['column']},title={_value(one['code'])}"
            yield f"::{level} {place}::{_text(one['message'] + (' (' + one['hint'] + ')' if one['hint'] else ''))}"


def _text(text: str) -> str:
    """Return text that ends no command; source: GitHub's workflow commands."""
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _value(text: str) -> str:
    return _text(text).replace(":", "%3A").replace(",", "%2C")


def main(words: list[str], environ: Mapping[str, str]) -> int:
    """Do what a command line says; return the exit code."""
    what, *rest = words or [""]
    if what == "annotate" and len(rest) == 1:
        for line in annotations(json.loads(Path(rest[0]).read_text(encoding="utf-8"))):
            print(line)
        return 0
    if (what, len(rest)) not in (("comment", 2), ("sarif", 1)):
        print(__doc__, file=sys.stderr)
        return 5
    try:
        print(told(what, rest, environ))
    except ForgeError as error:
        may_not = error.status in MAY_NOT
        why = f"{error}; the token may not write here, as on requests from forks" if may_not else str(error)
        print(f"::warning::{_text(why)}" if environ.get("GITHUB_ACTIONS") else f"warning: {why}")
        return 0 if may_not else 1
    return 0


def told(what: str, rest: list[str], environ: Mapping[str, str]) -> str:
    """Tell the forge, and return what was done in words."""
    there = forge(environ)
    if what == "sarif":
        assert isinstance(there, GitHub)
        there.upload(Path(rest[0]).read_bytes(), environ)
        return "SARIF was uploaded"
    if not there.comments:
        return "no comment: this run is of no pull or merge request"
    done = there.say(marker(rest[0]), fitting(Path(rest[1]).read_text(encoding="utf-8")))
    return f"the comment was {done}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:], os.environ))
