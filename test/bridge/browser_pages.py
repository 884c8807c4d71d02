# SPDX-License-Identifier: Apache-2.0
"""Pages of the bridge in a real browser."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

DEADLINE_MS = 600_000
"""It only ends a hang: beside other work pages and robots are slow."""


def opened(
    browser: Any, address: str, errors: list[str], size: tuple[int, int] = (1280, 720),
    is_error: Callable[[Any], bool] = lambda said: False,
) -> Any:  # fmt: skip
    """Open a page; what goes wrong in it comes into `errors`, of its console what is an error."""
    page = browser.new_page(viewport={"width": size[0], "height": size[1]})
    page.set_default_timeout(DEADLINE_MS)
    page.on("pageerror", lambda error: errors.append(f"{address.partition('#')[0]}: {error}"))
    page.on("console", lambda said: errors.append(said.text) if is_error(said) else None)
    page.goto(address)
    return page


def start_on(page: Any, protocol: str) -> None:
    """Fill in the form of a therapist's page, or of a robot on it, and press Start."""
    page.get_by_role("button", name="New").click()
    page.get_by_label("Arm", exact=True).select_option("right")
    page.get_by_label("Protocol", exact=True).select_option(protocol)
    page.get_by_label("Record").uncheck()
    page.get_by_label("Ask for pain").uncheck()
    for box in page.locator(".checks input").all():
        box.check()
    page.get_by_role("button", name="Start").click()
