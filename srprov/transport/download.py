"""A file from an https address, in pieces as they come; the server is a stranger.

Its certificate, and that of each server that it leads to, is checked. Everything before the content has one time, and
from then on only content gives time back (`srprov/pace.py`), so neither headers nor trailers outlast it.
"""

from __future__ import annotations

import ssl
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from typing import Any

from srprov.pace import Pace
from srprov.session import Progress

_PIECE = 1 << 20
_STEP = 64 << 20
_SILENCE_S = 60.0


def download(url: str, seconds: float, progress: Progress) -> Iterator[bytes]:
    """Yield a file.

    Args:
        url: Where it is; https.
        seconds: For all of it.
        progress: Told now and then how much is there.

    Raises:
        ValueError: The address is no https.
        OSError, HTTPException: It cannot be read, or not in time.
    """
    if not url.startswith("https://"):
        raise ValueError("it is not https")
    end, got, told, pace = time.monotonic() + seconds, 0, 0, Pace(_SILENCE_S)
    opener = urllib.request.build_opener(_HttpsOnly(), urllib.request.HTTPSHandler(context=_context(pace)))
    request = urllib.request.Request(url, headers={"User-Agent": "srprov", "Accept-Encoding": "identity"})  # noqa: S310 - https, as was checked above
    with opener.open(request, timeout=_SILENCE_S) as response:
        while piece := response.read1(_PIECE):
            got += len(piece)
            pace.goes_on(len(piece))
            if time.monotonic() > end:
                raise OSError(f"it was not there within {seconds:g} s")
            if got - told >= _STEP:
                told = got
                progress(f"downloaded {got >> 20} MiB")
            yield piece
            pace.resume()


def _context(pace: Pace) -> ssl.SSLContext:
    """Return what makes sockets that receive only as long as there is time left."""

    class Paced(ssl.SSLSocket):
        def recv_into(self, buffer: Any, nbytes: int | None = None, flags: int = 0) -> int:  # noqa: ANN401 - any that can be written to
            late = TimeoutError(f"it gave nothing, or next to nothing, for {_SILENCE_S:g} s")
            if (left := pace.left) <= 0:
                raise late
            self.settimeout(left)
            try:
                return super().recv_into(buffer, nbytes, flags)
            except TimeoutError:
                raise late from None

    context = ssl.create_default_context()
    context.sslsocket_class = Paced
    return context


class _HttpsOnly(urllib.request.HTTPRedirectHandler):
    def redirect_request(self, req: Any, fp: Any, code: Any, msg: Any, headers: Any, newurl: str) -> Any:  # noqa: ANN401 - as the base class has it
        if not newurl.startswith("https://"):
            raise urllib.error.URLError(f"it leads to {newurl[:200]}, which is not https")
        fp.close()  # the base class would read all that comes with it
        return super().redirect_request(req, fp, code, msg, headers, newurl)
