# SPDX-License-Identifier: Apache-2.0
"""The report: one page for one patient, every number explained, for the owner alone."""

import re
import stat
from pathlib import Path

import pytest
from screw_module_msgs.msg import TrialResult
from simulated_patient import HEALTHY, brief, recorded, short
from small_bag import small_bag

from screw_module_ros.therapy.measures import COLUMNS, COMPUTED, MEASURES
from screw_module_ros.therapy.protocol import KINDS, REACH
from screw_module_ros.therapy.protocol_file import load_protocol
from screw_module_ros.therapy.recorded import Act, read_sessions
from screw_module_ros.therapy.replay import replayed
from screw_module_ros.therapy.report import STATEMENT, write_report
from screw_module_ros.therapy.report_content import (
    OTHERS,
    other_tests,
    summary,
)
from screw_module_ros.therapy.report_figures import (
    outward_paths,
    paths_figure,
    trials_figure,
)
from screw_module_ros.therapy.session import State

pytestmark = pytest.mark.long

CLOCK = load_protocol("clock_adaptive")


@pytest.fixture(scope="module")
def sessions():
    return [recorded(HEALTHY, short(CLOCK), 1, 0), recorded(HEALTHY, short(CLOCK), 2, 2)]


@pytest.fixture(scope="module")
def replays(sessions):
    return [replayed(session) for session in sessions]


@pytest.fixture(scope="module")
def html(sessions, replays, tmp_path_factory):
    file = write_report(tmp_path_factory.mktemp("report") / "page.html", sessions, replays)
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    return file.read_text("utf-8")


def test_every_link_leads_to_a_definition(html):
    links = set(re.findall(r'href="#(\w+)"', html))
    targets = set(re.findall(r'<dt id="(\w+)"', html))
    assert targets == {measure.name for measure in MEASURES}
    assert links and links <= targets


def test_every_number_of_a_trial_that_is_a_measure_is_defined():
    own = {"trial", "block", "circuit", "kind", "assisted", "slot_duration", "side_stiffness",
           "moved", "first", "last", "samples", "rate"}  # fmt: skip
    assert set(COLUMNS) - own == {measure.name for measure in MEASURES}


def test_the_message_has_every_measure():
    fields = TrialResult.get_fields_and_field_types()
    assert set(COLUMNS) <= set(fields)
    numbers = {name for name, kind in fields.items() if kind == "double"}
    told = {"rate", "slot_duration", "side_stiffness", "support", "score"}
    assert numbers - told == set(COMPUTED)


def test_the_page_says_what_it_is_and_needs_nothing_from_outside(html):
    assert STATEMENT in html
    assert "P-7K3QX" in html and "Sampled at 200 Hz" in html
    assert "bit for bit" in html
    assert not re.findall(r'(?:src|href)="(?!#|data:)', html)
    assert html.count("data:image/png") == 3


def test_a_session_that_ended_early_says_why_and_how_much_of_it_was_done(sessions):
    whole = sessions[0]
    acts = [
        Act(0, State.RUNNING, ""),
        Act(9, State.PAUSED, "the plane's torque is off"), Act(11, State.RUNNING, ""),
        Act(15, State.PAUSED, "the plane's torque is off"), Act(18, State.RUNNING, ""),
        Act(20, State.ABORTED, "the therapist ended it"),
    ]  # fmt: skip
    row = summary(whole._replace(acts=acts, trials=whole.trials[:3]))
    assert row.trials == "3 of 8"
    assert row.course == (
        "paused 2 times: the plane's torque is off; ended early: the therapist ended it"
    )
    assert summary(whole._replace(acts=acts[:1])).course == "its end is not recorded"


def test_simulated_time_is_no_date(sessions):
    """The rig's clock begins anew with each start, and not at 0: the folder's name has the date."""
    trials = [{**row, "started_ns": 1000 * 10**9} for row in sessions[0].trials]
    simulated = sessions[0]._replace(trials=trials, folder=Path("renamed"))
    assert summary(simulated).date == "simulated"
    named = simulated._replace(folder=Path("P-7K3QX_elevator_2026_01_05-08_00_00"))
    assert re.fullmatch(r"2026-01-0[45] \d\d:\d\d, simulated", summary(named).date), "in UTC"


def test_the_figures_show_only_what_there_is_and_from_zero(sessions):
    free = [row for row in sessions[0].trials if not row["assisted"]]
    session = sessions[0]._replace(trials=free)
    (panel,) = paths_figure(session).axes
    assert panel.get_title(loc="left") == "Without assistance: 2 outward reaches"
    figure = trials_figure([session])
    assert [text.get_text() for text in figure.legends[0].texts] == ["without assistance"]
    for axes in figure.axes:
        low, high = axes.get_ylim()
        if "SPARC" in axes.get_title(loc="left"):
            assert high - low >= 0.5
        else:
            assert low == 0.0 < high


def test_paths_lead_from_the_centre_to_their_targets(sessions):
    paths = outward_paths(sessions[0])
    assert len(paths) == 4
    assert [(path.assisted, path.late) for path in paths] == [
        (False, False), (False, True), (True, False), (True, True)
    ], "the later ones of each panel of the figure"  # fmt: skip
    for path in paths:
        assert abs(path.points[0]).max() < 0.011, "from when the target was shown"
        assert max(abs(path.points[-1] - path.target)) < 0.011


def test_the_page_prints_on_paper(html):
    """The definitions begin a page, and nothing that a click would open is left out."""
    style = html.partition("@media print")[2].partition("</style>")[0]
    assert ".definitions { break-before: page" in style
    assert "size: A4" in html
    shown, _, hidden = html.partition("<details>")
    assert "Last change of assistance: " in shown and "details { display: none" in style


def test_a_text_is_no_markup(sessions, replays, tmp_path):
    """A file that came from elsewhere may have anything as a title."""
    protocol = sessions[0].protocol._replace(title="<script>alert(1)</script>")
    titled = sessions[0]._replace(protocol=protocol)
    content = write_report(tmp_path / "page.html", [titled], replays[:1]).read_text("utf-8")
    assert "<script>" not in content and "&lt;script&gt;" in content


def test_several_patients_or_none_are_refused(sessions, replays, tmp_path):
    other = sessions[1]._replace(patient="P-22222")
    with pytest.raises(ValueError, match="P-22222, P-7K3QX"):
        write_report(tmp_path / "page.html", [sessions[0], other], replays)
    with pytest.raises(ValueError, match="none"):
        write_report(tmp_path / "page.html", [], [])
    assert not list(tmp_path.iterdir())


def test_an_evaluation_shows_what_is_not_a_reach(tmp_path):
    session = recorded(HEALTHY, brief(load_protocol("evaluation"), 2.0, 2), 1)
    assert len(session.trials) == 4 + 1 + 1 + 2 + 2
    found = {name: value for _, name, value in other_tests(session)}
    assert found["hold_deviation"] < 5.0, "[mm]; it rests where it was brought to"
    assert 50.0 < found["pm4"] < 140.0, "[mm]; held back by a spring of 100 N/m"
    assert found["largest_force"] > 5.0, "[N]; the arm pushes against what holds it"
    assert found["size"] > 0.0
    file = write_report(tmp_path / "page.html", [session], [replayed(session)])
    assert "Reaching against a spring" in file.read_text("utf-8")


def test_every_kind_of_trial_has_figures_in_the_report():
    assert OTHERS.keys() == set(KINDS) - {REACH}


def test_the_software_that_moved_the_patient_is_named(tmp_path):
    (session,) = read_sessions(small_bag(tmp_path, reaches=[{"pm4": 0.1}] * 2))
    page = write_report(tmp_path / "a.html", [session], [replayed(session)]).read_text("utf-8")
    assert "moved by the software 0.1.0 0123456789ab" in page
    assert "differed from that commit" not in page
    told = "0.1.0 0123456789ab, commit 0a1b2c3d4e5f, dirty"
    (dirty,) = read_sessions(small_bag(tmp_path, "P-9M4TR", software=told))
    page = write_report(tmp_path / "c.html", [dirty], [replayed(session)]).read_text("utf-8")
    assert f"moved by the software {told}: it differed from that commit" in page
    old = session._replace(folder=tmp_path / "nothing")
    page = write_report(tmp_path / "b.html", [old], [replayed(session)]).read_text("utf-8")
    assert "moved by the software of a version that did not tell" in page
