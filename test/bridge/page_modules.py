# SPDX-License-Identifier: Apache-2.0
"""Runs the pages' modules without a browser."""

from __future__ import annotations

import shutil

PLAYED_DOCUMENT = """
class Played {
  constructor() { this.classList = { add() {}, remove() {}, toggle() {} }; this.textContent = ""; }
  append() {} setAttribute() {} replaceChildren() {} checkValidity() { return true; }
}
globalThis.document = { createElement: () => new Played(), getElementById: () => new Played() };
globalThis.getComputedStyle = () => ({ fontSize: "16px" });
"""


def node_program() -> str | None:
    """Return Node, which comes with Playwright."""
    try:
        from playwright._impl._driver import compute_driver_executable
    except ImportError:
        return shutil.which("node")
    found = compute_driver_executable()
    return str(found[0] if isinstance(found, tuple) else found)
