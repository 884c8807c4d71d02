# SPDX-License-Identifier: Apache-2.0
"""What the nodes say on the therapist's pages is there in German, and no pattern is stale.

The sentences are read from the source of what says them, so that a new one fails here until it has
its German, or stands below in a group that stays English, with the reason.
"""

from __future__ import annotations

import json
import re

import pytest
from page_modules import PLAYED_DOCUMENT
from sentences import PACKAGE, sentences

from screw_module_ros.devices.cia402 import State as DriveState
from screw_module_ros.devices.drive_settings import JOINTS
from screw_module_ros.nodes.web_bridge import measures_for_screens
from screw_module_ros.therapy.progress import ERRORS
from screw_module_ros.therapy.protocol_file import protocols_for_screens
from screw_module_ros.therapy.session import State
from screw_module_ros.therapy.weighing import PLACES

SPEAKERS = (
    "therapy/session.py", "therapy/trial.py", "therapy/hand.py", "therapy/attendance.py",
    "therapy/asked.py", "therapy/adaptation.py", "therapy/support.py", "therapy/weighing.py",
    "therapy/arm.py", "therapy/arm_weights.py", "therapy/protocol_file.py", "therapy/games.py",
    "therapy/progress.py", "therapy/record.py", "therapy/keeping.py", "therapy/scores.py",
    "nodes/therapy_session.py", "nodes/therapy_recording.py", "nodes/session_recorder.py",
    "nodes/supervisor.py", "nodes/bridge_gateway.py", "nodes/support/answering.py",
    "nodes/support/place.py", "nodes/support/parameters.py", "recording/pseudonym.py",
    "recording/recorder.py", "recording/bag.py", "loop/requests.py", "loop/controller.py",
    "loop/drive.py", "loop/plane.py", "loop/plane_controller.py", "loop/law_runner.py",
    "loop/plane_law_runner.py", "safety/checks.py", "safety/permit.py", "safety/supervision.py",
    "settings.py", "bridge/door.py", "bridge/server.py", "bridge/client.py",
    "bridge/record_desk.py", "devices/drive_logic.py", "devices/drive.py", "devices/encoder.py",
    "devices/force_base.py", "can_io/port.py", "nodes/support/topics.py",
)  # fmt: skip
"""Whose sentences a therapist's page may show: the session, what refuses it a service, what stops
it, the record and the bridge.

Others stay English there: what a device is set up with, warns of or reports by codes of its own
(the rest of `devices/` and `can_io/`), and the nodes and calibrations above, which name registers,
frames and parameters for the robot's operator, who finds them as they are in
docs/troubleshooting.md; what a file of one's own has wrong (`therapy/protocol.py`,
`settings_file.py`); laws and arms of other packages; what the operating system says; the session's
report and what is exported, which are documents.
"""

ENGLISH = {
    "logs, diagnostics and texts for a terminal": (
        r"^(trials done|support \[N\]|size \[B\]|rate \[1/s\]|age \{\} \[s\]|bag writer|reset)$",
        r"^(no session|asked for|motion permitted|stopped|\{\} recorded)$|^vertical (un)?locked$",
        r"^session \{\}: \{\}$|^as before the supervisor|^the drives stay off|^waiting: \{\}$",
        r"^check whether the pin|^the stop or lock cannot|^call ~/reset, then|^\{\}: \{\} sessions",
        r"bags below|messages wait in|messages were not|^the disk has room|^looking for topics",
        r"^what the patient told|a request was refused|^cut off a|^a request failed|^the client",
        r"^(it does not read|its token was taken away|ended early)$|is no whole backup|it holds",
        r"^unreadable: |its patient was forgotten: left out|has no dated session|^set \{\}$",
    ),
    "a start, a parameter file, a reset: what the operator does": (
        r"^required names|^there are |^(estopped|latched)|^the nodes listen|^docs/security|^keeps",
        r"^open to the network|^it is empty|nothing can be written into|^a parameter has an empty",
        r"^use_sim_time is|^Fixed while|^Given at|fixed once the node has|^\(write 1|^one of$",
        r"^old parameter names|is now \{\}|is unknown to node|^it knows|^parameter \{\}$|given to",
        r" values are wanted$|a value of type|is latched: call|^the cause persists|still enabled$",
        r"^disable it or wait|^supervisor/reset|^Torque without|^Supervisor gone|^Emergency stop",
        r"^Controller silent|^law \{\}: this node has parameters",
    ),
    "what the operator homes, tares or sets up, and what he is warned of at an enabling": (
        r"^no position to home|^the nut moves|^let it rest|^DANGER|^UNGUARDED|^keep a hand",
        r"hold its torque back by itself|^choose the `profile`|^waive what|^only `allow",
        r"^heartbeat of|^in its place only|clear the fault first|still recovering",
        r"still being disabled|not being commanded",
        r"^the torque command was|is not configured$|^the driver of the|^base id|^bit \{\}$",
        r"^\{\} status: \{\}$",
    ),
    "a file of one's own that has something wrong": (
        r"^levels: |^page = |^picture = |^game \{\}|^either share|^fade|must be less than",
        r"^\{\}\{\} is (unknown|missing)$|^known are|^\{\}: \{\} is wanted$|a list\{\} is|1\.0e-4",
        r"^protocol \{\}: name = |^at = |a mapping of names",
    ),
    "a client that speaks the bridge's protocol wrongly": (
        r"websocket protocol|^JSON texts|bytes that are|clients are connected|is no JSON|^args: ",
        r"with the key op|^id: |^op = |^throttle_rate|^compression|^ask for none|, type: names",
        r"of each topic the newest|surrogate pair",
    ),
    "what is no sentence: SQL, headers, faults of who calls a function": (
        r"[A-Z]{4,} |^json_extract|^AND |^attachment|^filename=|^circuit_of|^DETACH",
        r"^(score|session) WHERE$",
    ),
    "a name and a sentence, which are said each for itself, units, or the page's own sentence": (
        r"^(law|arm) \{\}: \{\}$|^with arm \{\}$|^emergency stop$|^force command$",
        r"^\{\} min, \{\}, \{\} m$",
    ),
}


def clauses(text: str) -> list[str]:
    """Return the parts of a sentence between semicolons, its variable parts as {}."""
    found = re.sub(r"\{[^}]*\}", "{}", text).split("; ")
    return [each.strip(" ;:,\n") for each in found if re.search("[A-Za-z]{3}", each)]


def told(least: int) -> set[str]:
    """Return what the speakers say in `least` words and more."""
    return {clause for name in SPEAKERS for text in sentences(PACKAGE / name, least)
            for clause in clauses(text)}  # fmt: skip


def words_told() -> set[str]:
    """Return words and titles that stand in sentences, or alone on the page."""
    measures = {each["name"]: each["label"] for each in measures_for_screens()}
    games = [each for each in protocols_for_screens() if "levels" in each]
    return {
        *(state.word for state in State), *(state.text for state in DriveState), *JOINTS,
        *PLACES, "left", "right",
        *(each["title"] for each in protocols_for_screens()),
        *(level for game in games for level in game["levels"]),
        *(measures[name] for name in (*ERRORS, "duration", "peak_speed", "path_error", "sparc",
                                      "robot_share") if name != "pm4"),
    }  # fmt: skip


@pytest.fixture(scope="module")
def german():
    """Return the German of each pattern of the nodes."""
    text = (PACKAGE / "bridge/pages/static/js/german_nodes.js").read_text("utf-8")
    pairs = re.findall(r'("(?:[^"\\]|\\.)*"):\s+("(?:[^"\\]|\\.)*"),?', text)
    return {json.loads(one): json.loads(other) for one, other in pairs}


def stays_english(clause: str) -> bool:
    return any(re.search(each, clause) for group in ENGLISH.values() for each in group)


def test_every_sentence_that_a_node_says_on_the_pages_is_there_in_german(german):
    known = {re.sub(r"\{\d\}", "{}", english) for english in german}
    missing = {clause for clause in told(2) - known if not stays_english(clause)}
    assert not missing | (words_told() - known)


def test_every_german_pattern_is_of_something_that_a_node_says(german):
    texts = [text for path in PACKAGE.rglob("*.py") for text in sentences(path, 1)]
    said = {clause for text in texts for clause in (*clauses(text), text.strip())} | words_told()
    said |= {re.sub(r"\{[^}]*\}", "{}", text) for text in texts}
    assert not {each for each in german if re.sub(r"\{\d\}", "{}", each) not in said}


@pytest.mark.parametrize("pattern", [each for group in ENGLISH.values() for each in group])
def test_every_exception_is_needed(pattern):
    parts = re.split(r"\|(?=[^()]*(?:\([^()]*\)[^()]*)*$)", pattern)  # not within brackets
    assert not [part for part in parts if not any(re.search(part, each) for each in told(2))]


def test_german_patterns_fill_in_what_the_english_ones_have(german):
    for english, other in german.items():
        places = re.findall(r"\{\d\}", english)
        assert places == [f"{{{n}}}" for n in range(len(places))], english
        assert other.strip() and sorted(re.findall(r"\{\d\}", other)) == places, english
        assert "; " not in english, english


SAID = [
    ("the arm pulls hard", "der Arm zieht stark"),
    ("the arm weighs 18.2 N: at most 20.2 N of support, as more would lift it",
     "der Arm wiegt 18.2 N: höchstens 20.2 N Stütze, denn mehr würde ihn heben"),
    # A sentence in another one, a word in a sentence, sentences in a row.
    ("not weighed: the therapist ended it", "nicht gewogen: die Therapeutin hat es beendet"),
    ("let it hang: far, 2 of 3", "hängen lassen: fern, 2 von 3"),
    ("not weighed: the weight varies by 1.2 N (0.7 N at most), he helps or trembles: let him "
     "loosen the arm, then weigh again; the arm is brought back",
     "nicht gewogen: das Gewicht schwankt um 1.2 N (höchstens 0.7 N), er hilft mit oder zittert: "
     "lassen Sie ihn den Arm lockern, dann wiegen Sie noch einmal; der Arm wird zurückgebracht"),
    ("time as before (metric +0.000); side walls already the softest allowed (metric +0.031); "
     "support 50% to 45% of the weight, as 6 of 8 were reached",
     "Zeit wie bisher (Maß +0.000); Seitenwände schon am weichsten (Maß +0.031); "
     "Stütze 50% auf 45% vom Gewicht, da 6 von 8 erreicht wurden"),
    ("encoder: no sample for 7.1 ms", "Encoder: seit 7.1 ms keine Messung"),
    ("impedance_controller: encoder and drive disagree by 3.1 mm after 4.0 and 0.9 mm: compare "
     "`lead` and `counts_per_turn` of encoder and amplifier",
     "impedance_controller: Encoder und Antrieb unterscheiden sich um 3.1 mm nach 4.0 und 0.9 mm: "
     "`lead` und `counts_per_turn` von Encoder und Verstärker vergleichen"),
    ("amplifier: the vertical drive is in fault; manus: the shoulder drive is silent: its "
     "statusword is stale", "amplifier: senkrechter Antrieb: ist jetzt: Störung; manus: "
     "Schulterantrieb: meldet nichts, sein Statuswort ist alt"),
    ("12 min, 34 movements, 5 min of play, score 80 %, 3.4 m",
     "12 min, 34 Bewegungen, 5 min gespielt, Wertung 80 %, 3.4 m"),
    ("the arm pulls hard (2)", "der Arm zieht stark (2)"),
    ("pain 3 → 5, tired 2 → ?", "Schmerz 3 → 5, Müdigkeit 2 → ?"),
    ("duration [s]", "Dauer [s]"),
    # What is not known stays whole, and English.
    ("drive node 5 of the plane failed to start", "drive node 5 of the plane failed to start"),
    ("amplifier: the motor is off, left", "amplifier: the motor is off, left"),
    ("", ""),
]  # fmt: skip


@pytest.mark.parametrize(("english", "expected"), SAID)
def test_a_node_s_sentence_is_filled_in_or_stays_as_it_is(result_of, english, expected):
    assert result_of(f"""
        globalThis.localStorage = {{ getItem: () => "de" }};
        const {{ said }} = await import("./js/language.js");
        const result = said({json.dumps(english)});
    """) == expected


def test_cards_of_the_page_say_what_a_node_refuses_in_german(result_of):
    """Of each service, and of a parameter."""
    assert result_of(PLAYED_DOCUMENT + """
        globalThis.localStorage = { getItem: () => "de" };
        const { SupportCard } = await import("./js/therapist/support.js");
        const { SessionCard } = await import("./js/therapist/session.js");
        const { armSentence, failure } = await import("./js/words.js");
        const why = "the vertical torque is off";
        const refused = "the arm was not weighed: at most 15 N of support";
        const support = new SupportCard(async (service) => (service.endsWith("set_parameters")
          ? { results: [{ successful: false, reason: refused }] }
          : { success: false, message: why }), () => ({}));
        const session = new SessionCard([], async () => ({ success: false, message: why }));
        await support.ask("therapy_session/lower");
        const lower = support.told.textContent;
        await support.set(20);
        await session.ask("therapy_session/start");
        const result = [lower, support.told.textContent, session.told.textContent,
          armSentence({ arm: "the arm is brought back" }),
          failure(new Error("no session has been started"))];
    """) == [
        "das senkrechte Drehmoment ist aus", "der Arm wurde nicht gewogen: höchstens 15 N Stütze",
        "das senkrechte Drehmoment ist aus", "Der Arm wird zurückgebracht.",
        "es wurde keine Sitzung begonnen",
    ]  # fmt: skip
