# SPDX-License-Identifier: Apache-2.0
"""The page of `make evidence`: one file, to read and to print."""

from __future__ import annotations

import re
from typing import Any

import jinja2
from markupsafe import Markup

_PAGE = """<!doctype html>
<html lang="en"><meta charset="utf-8"><title>Evidence of screw_module_ros</title>
<style>
body { font: 15px/1.45 system-ui, sans-serif; margin: 2em auto; max-width: 72em; padding: 0 1em;
       color: #1a1a1a; background: #fff }
p.first { border-left: 6px solid #b00020; background: #fdf0f1; padding: .6em 1em; font-weight: 600 }
table { border-collapse: collapse; width: 100%; margin: .6em 0 1.6em }
th, td.came { white-space: nowrap }
th, td { text-align: left; vertical-align: top; padding: .3em .6em; border-bottom: 1px solid #ccc;
         overflow-wrap: anywhere }
td.number { text-align: right; white-space: nowrap }
article { border: 1px solid #ccc; border-radius: 4px; padding: .2em 1em; margin: .8em 0;
          break-inside: avoid }
article.open { border: 2px solid #b00020 }
.bad { color: #b00020; font-weight: 600 } .good { color: #1b6e2c }
code { font-size: .92em; overflow-wrap: anywhere } h3 { margin: .5em 0 }
@media print { details { display: block } body { margin: 0; max-width: none } }
</style>
<body>
<p class="first">{{ cannot }}</p>
<h1>Evidence of screw_module_ros</h1>
<p>Made {{ made }}. {{ hazards|length }} hazards,
<span class="{{ 'bad' if opened else 'good' }}">{{ opened|length }} open</span>.
A hazard is open while a test or fault row that shows it failed, or was not carried out on this
build. Passing shows that the simulated robot behaves so, no more.</p>
<h2>The build</h2>
<table>
<tr><th>software<td>{{ build.software }}
<tr><th>commit<td><code>{{ build.commit }}</code>, {{ build.committed }}
<tr><th>tree<td>{% if build.dirty %}<span class="bad">DIRTY: {{ build.dirty|length }} files differ
from the commit</span>: {{ build.dirty|join(', ') }}{% else %}<span class="good">clean: as
committed</span>{% endif %}
<tr><th>what was tried, SHA-256<td><code>{{ build.tried }}</code>
{% for name, version in build.laws.items() %}<tr><th>law {{ name }}<td>{{ version }}
{% endfor %}<tr><th>evidence.json, SHA-256<td><code>{{ sha256 }}</code>
<tr><th>where tests ran<td>{{ machines|join('; ') or 'nowhere yet' }}
</table>
{% if opened %}<h2>Open hazards</h2>
{% for hazard in opened %}{{ one(hazard) }}{% endfor %}{% endif %}
<h2>Hazards that all tests of this build show as met</h2>
{% for hazard in hazards if not hazard.open %}{{ one(hazard) }}{% else %}<p>None.</p>{% endfor %}
{% if sessions %}<h2>Sessions</h2>
<p>Which software moved a patient. <em>This build</em>: the same bytes of code as here.</p>
<table><tr><th>begun<th>robot<th>software<th>law<th>protocol<th>its SHA-256<th>parameters, SHA-256
{% for each in sessions %}<tr><td>{{ each.begun }}<td>{{ each.robot }}<td>{{ each.software }}
{%- if each.software.partition(',')[0] == build.software.partition(',')[0] %} (this build
{{- ', dirty' if build.dirty }}){% endif %}
<td>{{ each.law }}<td>{{ each.protocol }}<td><code>{{ each.protocol_sha256[:16] }}</code>
<td><code>{{ each.parameters_sha256[:16] }}</code>
{% endfor %}</table>{% endif %}
<h2>Digests</h2>
<table><tr><th>file or folder<th>SHA-256
{% for name, sum in build.files.items() %}<tr><td><code>{{ name }}</code><td><code>{{ sum }}</code>
{% endfor %}</table>
<h2>Parts that were not made here</h2>
<p>{{ parts|length }} packages of this environment, those of tests and tools among them; in
CycloneDX: parts.cdx.json. Their known anomalies are for a person to list.</p>
<table><tr><th>package<th>version<th>licence
{% for part in parts %}<tr><td>{{ part.name }}<td>{{ part.version }}<td>{{ part.licence }}
{% endfor %}</table>
"""
_HAZARD = """<article{{ ' class=open' if hazard.open }}>
<h3>{{ 'OPEN: ' if hazard.open }}{{ hazard.name }}</h3>
<p><em>{{ hazard.section }}.</em> <strong>Cause:</strong> {{ plain(hazard.cause) }}.
<strong>Mitigation:</strong> {{ plain(hazard.mitigation) }}.</p>
<table><tr><th>shown by<th>came<th>tests<th>seconds<th>when, at commit
{% for proof in hazard.proofs %}<tr><td><code>{{ proof.name }}</code>
<td class="came {{ 'good' if proof.came == 'passed' else 'bad' }}">{{ proof.came }}
<td class="number">{{ proof.passed }} of {{ proof.passed + proof.failed + proof.skipped }}
<td class="number">{{ '%.2f'|format(proof.seconds) }}
<td>{{ proof.at }} {{ proof.commit[:12] }}
{% endfor %}{% for name in hazard.by_hand %}<tr><td><code>{{ name }}</code><td>by hand<td><td><td>
not part of this page
{% endfor %}</table></article>
"""


def page(found: dict[str, Any], sha256: str) -> str:
    """Return the page of what was found; sha256: of its JSON."""
    templates = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    hazard = templates.from_string(_HAZARD)
    opened = [each for each in found["hazards"] if each["open"]]
    machines = {p["machine"] for each in found["hazards"] for p in each["proofs"]} - {""}
    return templates.from_string(_PAGE).render(
        **found, sha256=sha256, opened=opened, machines=sorted(machines),
        one=lambda each: Markup(hazard.render(hazard=each, plain=_plain)),
    )  # fmt: skip


def _plain(text: str) -> str:
    """Return a text of the pages without the marks of links, code and stress."""
    return re.sub(r"[`*]", "", re.sub(r"\[([^]]+)\]\([^)]+\)", r"\1", text)).rstrip(".")
