"""Answers that are compressed once for all browsers, and not by the server's loop for each of them."""

import gzip
from collections.abc import Mapping

from starlette.requests import Request
from starlette.responses import Response

COMPRESSION = 5
"""The level of zlib for all that the dashboard sends."""


def answer_of(packed: bytes, request: Request, media_type: str, headers: Mapping[str, str]) -> Response:
    """Return an answer of content that gzip has compressed; decompress it for a client that does not take gzip."""
    if "gzip" in request.headers.get("Accept-Encoding", ""):
        packing = {"Content-Encoding": "gzip", "Vary": "Accept-Encoding"}
        return Response(packed, headers={**headers, **packing}, media_type=media_type)
    return Response(gzip.decompress(packed), headers=dict(headers), media_type=media_type)
