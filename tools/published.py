# SPDX-License-Identifier: Apache-2.0
"""The figures that README and pages quote, from the runs that found them.

    tools/run python tools/published.py --demo demo_output/DATE --reproduction reproduction_output
    tools/run python tools/published.py --study study_output --write

fails if a run says otherwise than `docs/published.yaml`; with --write it renews that file, the
figure of README and the paragraphs that quote it, which stand between `<!-- published: NAME -->`
and `<!-- end -->`. `test/tools/test_published.py` compares the paragraphs with the file. The tables
of a run of `study` are kept in the page itself, between `<!-- study: NAME -->` and `<!-- end -->`;
the run's own words say which they are, and its figures go beside the page.
"""

from __future__ import annotations

import re
import shutil
import sys
import textwrap
from pathlib import Path
from typing import Any

import click
import yaml

from screw_module_ros.identification import report, requirements
from screw_module_ros.identification.experiments import EXPERIMENTS
from screw_module_ros.identification.report import Module, Outcome, Report
from screw_module_ros.identification.results import load_result
from screw_module_ros.identification.stand import LoopSettings
from screw_module_ros.plant.settings import load_world

ROOT = Path(__file__).resolve().parent.parent
KEPT = ROOT / "docs/published.yaml"
FIGURE = ROOT / "docs/force_position.png"
PAGES = ("README.md", "docs/limits.md", "docs/characterization.md", "docs/performance.md")
_HEAD = (
    "# What README and pages quote: from the runs, by tools/published.py --write. Do not edit.\n"
)
STUDIES = ROOT / "docs/studies.md"
MODES = ROOT / "docs/modes.md"
_CALLED = re.compile(r"`study((?: --(?:plane|support|impedance))*)[^`]*`")
_BLOCK = re.compile(r"(<!-- published: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
_WIDTH = 140


def of_demo(folder: Path) -> dict[str, Any]:
    """Return what a run of the demo found: offsets [N] of each mode."""
    found = yaml.safe_load((folder / "results.yaml").read_text("utf-8"))
    return {
        "stiffness": found["spring"]["stiffness"],
        "damping": found["spring"]["damping"],
        "modes": {
            mode["name"]: {
                "moving": round(mode["offset"]["mean"], 3),
                "less_damper": round(mode["offset_without_damper"]["mean"], 3),
                "holding": round(mode["held"], 3),
            }
            for mode in found["modes"]
        },
    }


def of_reproduction(folder: Path) -> dict[str, Any]:
    """Return what `make reproduce` found on the thesis's module, from its kept results."""
    outcomes = {
        name: Outcome(load_result(folder / "thesis", name), "", 0.0) for name in EXPERIMENTS
    }
    found = Report([Module(None, load_world(), LoopSettings(), folder / "thesis", outcomes)])
    again, numbers = found.counts(report.INPUT), found.counts(report.CALCULATION)
    required = found.modules[0].result(requirements.NAME)
    assert required is not None
    chosen = [
        f"{row.experiment}, {row.ours.text}: {report.value_text(row.ours)}, the thesis has "
        f"{row.thesis.value:g}"
        for row in found.compared if row.group == report.CHOSEN
    ]  # fmt: skip
    return {
        "headline": found.headline,
        "inputs": f"{sum(again.values()) - again[report.DIFFERS]} of {sum(again.values())}",
        "calculations": f"{sum(numbers.values()) - numbers[report.DIFFERS]} of "
        f"{sum(numbers.values())}",
        "chosen": chosen,
        "requirements": list(requirements.sentences(required)),
    }


def _newtons(kept: dict[str, Any], what: str, digits: int = 1) -> list[str]:
    return [f"{mode[what]:.{digits}f}" for mode in kept["modes"].values()]


def demo_text(kept: dict[str, Any]) -> str:
    """Return the caption of README's figure."""
    one, three, five = _newtons(kept, "moving")
    still, still3, still5 = _newtons(kept, "holding")
    bare, bare3, bare5 = _newtons(kept, "less_damper")
    return (
        "*`make demo`: a simulated patient moves the handle against a spring of "
        f"{kept['stiffness']:g} N/m (dotted) and then holds it still (squares). All three modes "
        f"have the same spring and a damper of {kept['damping']:g} Ns/m, which mode 5 needs: it "
        "takes away the friction that would bring a released handle to rest. With plain impedance "
        "control the force of the hand is on average "
        f"{one} N away from the dotted line in motion and {still} N at rest: the screw's friction. "
        f"Feedback of the handle's force with gain 5 reduces it to {three} and {still3} N, a "
        f"disturbance observer to {five} and {still5} N. The damper's own force is part of this: "
        f"without it {bare}, {bare3} and {bare5} N are left in motion. The [thesis](CITATION.cff) "
        "found about 10 N and 2 N, without a damper, on its hardware, the real machine behind this "
        "software: compare its figures 6-1 and 6-10. The spikes occur when the nut crosses its "
        "play.*"
    )


def _prediction(kept: dict[str, Any]) -> str:
    return f"**{kept['headline']}.**"


def predictions_text(kept: dict[str, Any]) -> str:
    """Return what the predictions are worth."""
    return (
        f"{_prediction(kept)} So `make reproduce` begins its report. A prediction follows from "
        "plant and law and was given to neither: only predictions can show that the simulation "
        "behaves as the thesis's machine did, and they hardly do. Most printed values were given "
        f"to the simulated module; that {kept['inputs']} of them are found again shows that the "
        "methods work, not that the module is right. What the laws achieve here is therefore a "
        "result on this simulation, to be found again on hardware."
    )


def chosen_text(kept: dict[str, Any]) -> str:
    """Return which outcomes decided a value of the plant."""
    return (
        f"{_prediction(kept)} Neither prediction nor input is an outcome by which a value of the "
        f"plant was chosen: {'; '.join(kept['chosen'])}. Contact and grease film of the play, for "
        "which the thesis has no value, were chosen so that on a rigid support a gain of 5 runs "
        "and chatter begins not far above; they were not chosen again for the axial support."
    )


def requirements_text(kept: dict[str, Any]) -> str:
    """Return what was asked of the machine and is met."""
    return " ".join(kept["requirements"]) + (
        " [Characterization](docs/characterization.md) has the table of all that chapter 2 and "
        "appendix D ask, in the report of `make reproduce`."
    )


def modes_table(kept: dict[str, Any]) -> str:
    """Return the offsets of the demo as a table."""
    lines = ["| mode | from the spring, moving | without the damper's force | holding |",
             "|---|---|---|---|"]  # fmt: skip
    for name, mode in kept["modes"].items():
        told = " | ".join(f"{mode[what]:.2f} N" for what in ("moving", "less_damper", "holding"))
        lines.append(f"| {name} | {told} |")
    return "\n".join(lines)


BLOCKS = {
    "demo": ("demo", demo_text),
    "predictions": ("reproduction", predictions_text),
    "chosen": ("reproduction", chosen_text),
    "requirements": ("reproduction", requirements_text),
    "modes": ("demo", modes_table),
}
"""Paragraph -> section of the file, and what writes it."""


def paragraph(name: str, kept: dict[str, Any]) -> str:
    """Return a paragraph as it stands in a page."""
    section, text = BLOCKS[name]
    found = text(kept[section])
    if found.startswith("|"):
        return found
    return textwrap.fill(found, _WIDTH, break_long_words=False, break_on_hyphens=False)


def rendered(page: str, kept: dict[str, Any]) -> str:
    """Return a page with its paragraphs as the file has them."""
    return _BLOCK.sub(
        lambda found: f"{found[1]}{paragraph(found[2], kept)}\n{found[3]}", page
    )


def study_name(text: str) -> str:
    """Return the name of the block for the text of a run of `study`, by the words of its call.

    Raises ValueError for a text that names none, and for a run of other laws or single cases.
    """
    called = _CALLED.search(text)
    if not called or "--law" in called[0]:
        raise ValueError("study.md names no run of the shipped laws: run `study` again")
    return called[1].replace(" --", " ").strip() or "vertical"


def with_study(page: str, text: str) -> str:
    """Return the page with the tables of a run of `study` in their block.

    Raises ValueError as `study_name`, and where the page has no such block.
    """
    name = study_name(text)
    block = re.compile(rf"(<!-- study: {name} -->\n).*?(<!-- end -->)", re.DOTALL)
    if not block.search(page):
        raise ValueError(f"{STUDIES.name} has no block `<!-- study: {name} -->`")
    body = re.sub(r"^# Study\n\n", "", text).replace("\n## ", "\n**").strip()
    body = re.sub(r"^(\*\*Family .*)$", r"\1**", body, flags=re.MULTILINE)
    return block.sub(lambda found: f"{found[1]}{body}\n{found[2]}", page)


def differences(kept: dict[str, Any], found: dict[str, Any]) -> list[str]:
    """Return what a run says otherwise, section by section."""
    return [
        f"{section}: {key} is {value!r}, docs/published.yaml has {kept[section].get(key)!r}"
        for section, values in found.items()
        for key, value in values.items()
        if kept[section].get(key) != value
    ]


_FOLDER = click.Path(exists=True, file_okay=False, path_type=Path)


@click.command()
@click.option("--demo", type=_FOLDER, help="Folder of a run of the demo.")
@click.option("--reproduction", type=_FOLDER, help="Folder of a whole run of `reproduce`.")
@click.option("--study", "studies", multiple=True, type=_FOLDER, help="Folder of a run of `study`.")
@click.option("--write", is_flag=True, help="Renew the file, the figure and the paragraphs.")
def main(
    demo: Path | None, reproduction: Path | None, studies: tuple[Path, ...], write: bool
) -> None:
    """Compare runs with what README and pages quote, or renew it."""
    kept = yaml.safe_load(KEPT.read_text("utf-8")) if KEPT.exists() else {}
    found: dict[str, Any] = {}
    if demo:
        found["demo"] = of_demo(demo)
    if reproduction:
        found["reproduction"] = of_reproduction(reproduction)
    page = before = STUDIES.read_text("utf-8")
    for folder in studies:
        page = with_study(page, (folder / "study.md").read_text("utf-8"))
    if not write:
        told = differences(kept, found)
        told += ["docs/studies.md has other tables of the study"] if page != before else []
        if told:
            sys.exit("\n".join([*told, "To renew: the same command with --write"]))
        return
    STUDIES.write_text(page, "utf-8")
    shown = MODES.read_text("utf-8")
    for picture in (picture for folder in studies for picture in folder.glob("*.png")):
        if (name := f"impedance_{picture.name}") in shown:
            shutil.copyfile(picture, MODES.parent / name)
    kept |= found
    KEPT.write_text(
        _HEAD + yaml.safe_dump(kept, sort_keys=False, allow_unicode=True), encoding="utf-8"
    )
    if demo:
        shutil.copyfile(demo / FIGURE.name, FIGURE)
    for name in PAGES:
        page = ROOT / name
        page.write_text(rendered(page.read_text("utf-8"), kept), encoding="utf-8")


if __name__ == "__main__":
    main()
