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

SECURITY_HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
    "Cross-Origin-Resource-Policy": "same-origin",
}
"""No page loads anything from elsewhere, is shown within another, or is kept after it is closed."""
