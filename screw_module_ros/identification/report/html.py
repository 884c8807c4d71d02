# SPDX-License-Identifier: Apache-2.0
"""The HTML page of the Markdown report."""

from __future__ import annotations

from html import escape

from markdown_it import MarkdownIt

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 62rem; margin: 2rem auto;
       padding: 0 1rem; }
table { border-collapse: collapse; margin: 1rem 0; font-size: 13.5px; }
th, td { border-bottom: 1px solid #ddd; padding: 0.3rem 0.7rem; text-align: left;
         vertical-align: top; }
th { border-bottom: 2px solid #888; }
tr.good td:last-child { color: #00734f; }
tr.bad td:last-child { color: #b33a00; font-weight: 600; }
img { max-width: 100%; margin: 0.5rem 0; }
blockquote { margin: 0.5rem 0; padding: 0 1rem; border-left: 3px solid #0072b2; color: #444; }
pre { background: #f6f6f6; padding: 0.6rem; overflow-x: auto; font-size: 12px; }
"""


def html_page(text: str) -> str:
    """Return the page of a Markdown text."""
    body = MarkdownIt("commonmark").enable("table").render(text)
    for verdict, kind in (
        ("agrees", "good"), ("recovered", "good"), ("differs", "bad"), ("MISSED", "bad"),
        ("missed", "bad"),
    ):  # fmt: skip
        cell = f"<td>{verdict}</td>\n</tr>"
        parts = body.split(cell)
        for index in range(len(parts) - 1):
            before, _, row = parts[index].rpartition("<tr>")
            parts[index] = f'{before}<tr class="{kind}">{row}'
        body = cell.join(parts)
    body = body.replace("<h2>Misses</h2>", '<h2 id="misses">Misses</h2>')
    title = escape("The thesis's characterization, repeated")
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f"<style>{_STYLE}</style></head><body>\n{body}</body></html>\n"
    )
