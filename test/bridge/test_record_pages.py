# SPDX-License-Identifier: Apache-2.0
"""The pages of the record in a real browser, against the real server and a folder of bags."""

from __future__ import annotations

import itertools

import pytest
from browser_pages import opened as opened_in
from fake_gateway import TOKENS, FakeGateway, Served, make_server
from small_bag import MARCH, small_bag

from screw_module_ros.therapy.record import Record
from screw_module_ros.therapy.scores import Score, keep_scores

pytestmark = pytest.mark.long

HER, WEEK = "P-7K3QX", 7 * 86400
SIZES = [(1280, 720), (1024, 768)]  # a laptop, a tablet of 10 inches


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """One patient over seven weeks, one seen once, one whose therapy has ended."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    place = tmp_path / "sessions"
    for week in range(7):
        rows = [{"duration": 1.6 - week / 20 + n / 100, "sparc": -1.6, "path_error": 0.004,
                 "pm4": 0.12, "mean_speed": 0.1, "support": 11.0} for n in range(8)]  # fmt: skip
        small_bag(place, HER, MARCH + week * WEEK, rows)
    small_bag(place, "P-22222", MARCH, [{}], side="right")
    small_bag(place, "P-33333", MARCH, [{}])
    keep_scores(place, "P-33333", [Score("2026-03-03T14:00:00+01:00", "closed", 1.0)])
    return place


@pytest.fixture
def server(folder):
    config = {"robots": ["/"], "protocols": [], "measures": []}
    with Served(make_server(FakeGateway(), folder=folder, config=config)) as server:
        yield server


@pytest.fixture
def opened(browser, server):
    """Return what opens a page of the record; nothing may go wrong in it without a word."""
    pages, errors = [], []

    def make(size=SIZES[0], who="therapist:T7", path="/record"):
        pages.append(opened_in(
            browser, f"{server.address}{path}#token={TOKENS[who]}", errors, size,
            lambda told: "(Conflict)" not in told.text,
        ))  # fmt: skip
        return pages[-1]

    yield make
    for page in pages:
        page.close()
    assert errors == []


def button(page, name):
    return page.get_by_role("button", name=name, exact=True)


def open_patient(page):
    button(page, HER).click()
    page.locator(".line canvas").first.wait_for()


@pytest.mark.parametrize("size", SIZES)
def test_every_page_fits_and_can_be_touched(opened, size):
    page = opened(size)
    button(page, HER).wait_for()

    def fits():
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        small = page.evaluate(
            "[...document.querySelectorAll('button, select, input:not([type=checkbox])')]"
            ".filter((b) => b.offsetHeight < 40 || b.offsetWidth < 40).map((b) => b.outerHTML)"
        )
        cut = "[...document.querySelectorAll('.scroll')].some((e) => e.scrollWidth > e.clientWidth)"
        assert small == [] and not page.evaluate(cut)
        assert HER not in page.url and TOKENS["therapist:T7"] not in page.url

    fits()
    open_patient(page)
    fits()
    boxes = [each.bounding_box() for each in page.locator(".line").all()]
    assert len(boxes) == 12, "eleven lines, and what they are of"
    assert max(box["y"] + box["height"] for box in boxes) <= size[1], "on one screen"
    for name, seen in (("Report", ".report"), ("Export", ".card"), ("Forget", ".kept")):
        button(page, name).first.click()
        page.locator(seen).first.wait_for()
        fits()
        button(page, "Back").click()
        page.locator(".line canvas").first.wait_for()


INK = """(canvas) => {
  const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  return data.filter((value, i) => i % 4 === 3 && value > 0).length;
}"""


def test_lines_are_drawn_and_said(opened):
    page = opened()
    open_patient(page)
    line = page.get_by_role("figure").filter(has_text="duration [s]")
    assert "1.64 (1.60 to 1.67) → 1.33 (1.30 to 1.37)" in line.inner_text()
    assert "within the error of measurement" in line.inner_text()
    assert line.locator("canvas").evaluate(INK) > 1000
    rests = page.get_by_role("figure").filter(has_text="rests")
    assert not rests.locator("canvas").is_visible(), "an empty plot is none"


def test_a_score_is_kept_by_choices_and_numbers(opened, folder):
    page = opened()
    open_patient(page)
    page.get_by_label("Scale").select_option("Ashworth, elbow")
    page.get_by_label("Value").select_option("1+")
    button(page, "Keep").click()
    page.get_by_role("cell", name="1+").wait_for()
    page.get_by_label("Scale").select_option("Fugl-Meyer, upper extremity")
    page.get_by_label("Value").fill("34")
    page.get_by_label("When").select_option(index=2)
    button(page, "Keep").click()
    page.get_by_role("cell", name="34", exact=True).wait_for()
    page.get_by_label("Arm", exact=True).select_option("right")
    page.get_by_role("cell", name="Arm to be trained").wait_for()
    button(page, "Mark as closed").click()
    button(page, "Mark as open").wait_for()
    record = Record(folder)
    kept = [(row["scale"], row["value"]) for row in record.scores(HER)]
    record.close()
    assert kept == [("FM_UE", 34.0), ("MAS_elbow", 1.5), ("side", 1.0), ("closed", 1.0)]
    page.go_back()
    button(page, "P-22222").wait_for()
    assert not button(page, HER).is_visible()
    page.get_by_label("also closed ones").check()
    assert button(page, HER).is_visible() and button(page, "P-33333").is_visible()


def test_a_report_is_read_and_saved_and_an_export_too(opened):
    page = opened()
    open_patient(page)
    button(page, "Report").first.click()
    page.get_by_text("Sessions of P-7K3QX").wait_for()
    with page.expect_download() as saved:
        button(page, "Save").click()
    assert saved.value.suggested_filename == f"report_{HER}.html"
    page.go_back()
    button(page, "Export").click()
    with page.expect_download() as saved:
        button(page, "Save the file").click()
    assert saved.value.suggested_filename == f"export_{HER}.zip"
    page.get_by_label("give a new pseudonym").check()
    with page.expect_download() as saved:
        button(page, "Save the file").click()
    assert HER not in saved.value.suggested_filename


def test_a_patient_is_forgotten_after_the_pseudonym_was_written_again(opened, folder):
    page = opened()
    open_patient(page)
    button(page, "Forget").click()
    page.get_by_text("backups, and copies").wait_for()
    page.get_by_label("Write the pseudonym again").fill("P-22222")
    assert button(page, "Forget").is_disabled()
    page.get_by_label("Write the pseudonym again").fill(HER)
    button(page, "Forget").click()
    page.get_by_text("The patient was forgotten").wait_for()
    button(page, "P-22222").wait_for()
    assert not button(page, HER).is_visible()
    assert not [path for path in folder.iterdir() if path.name.startswith(HER)]


def test_a_patient_s_token_shows_nothing(opened):
    page = opened(who="patient")
    page.get_by_text("This token is the patient's").wait_for()
    assert not button(page, HER).is_visible()


def test_the_therapists_page_leads_to_the_record_and_stays_open(opened):
    """In a tab of its own: a page that is left would pause the session."""
    page = opened(path="/therapist")
    with page.expect_popup() as other:
        page.get_by_role("link", name="Patients").click()
    button(other.value, HER).wait_for()
    assert page.url.endswith("/therapist")
    other.value.close()


def test_what_was_last_time_is_proposed_to_who_types_a_pseudonym(opened):
    page = opened(path="/therapist")
    field = page.get_by_label("Pseudonym of the patient")
    side = page.get_by_label("Arm", exact=True)
    field.fill("P-22222")
    page.get_by_text("Last time: right arm").wait_for()
    assert side.input_value() == "right"
    side.select_option("left")  # what was chosen stays
    field.fill(HER)
    page.get_by_text("11.0 N support").wait_for()
    assert side.input_value() == "left"
    again = page.get_by_role("button", name="As last time")
    again.click()
    page.get_by_text("From Start on as last time: left arm").wait_for()
    assert again.get_attribute("aria-pressed") == "true"
    again.click()
    page.get_by_text("From Start on").wait_for(state="hidden")
    field.fill("P-7777A")
    page.get_by_text("11.0 N support").wait_for(state="hidden")
    assert not again.is_visible()


def test_what_is_refused_is_said(opened, folder):
    page = opened()
    open_patient(page)
    for path in itertools.chain(folder.glob("*.db"), folder.glob("*_scores.json")):
        path.unlink()
        path.mkdir()
    button(page, "All patients").click()
    page.get_by_text("the record of").wait_for()
    assert page.get_by_role("alert").is_visible()
