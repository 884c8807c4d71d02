# SPDX-License-Identifier: Apache-2.0
"""The pages: plain HTML, CSS and JavaScript modules, served unchanged, without external files."""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).resolve().parent / "static"
PAGES = {
    "/": "index.html", "/patient": "patient.html", "/therapist": "therapist.html",
    "/record": "record.html",
}  # fmt: skip
"""Path on the server -> file in FOLDER."""

_OWN = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'; "
    "frame-src 'self'"
)
GAME_POLICY = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data:; media-src data:; frame-ancestors 'self'"
)
"""Of a game's page that the bridge serves: it reaches nobody but the page that shows it, and has no
token, since it is of no origin."""
POLICY = "Content-Security-Policy"
SECURITY_HEADERS = {
    POLICY: _OWN,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
    "Cross-Origin-Resource-Policy": "same-origin",
}
"""No page loads anything from elsewhere, is shown within another, or is kept after it is closed.
Frames are for games."""
