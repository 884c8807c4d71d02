# SPDX-License-Identifier: Apache-2.0
"""Modules of the pages that need no browser: what they tell after a loss, and of which session."""

from __future__ import annotations

import json
import re
import subprocess

import numpy as np
import pytest
from page_modules import PLAYED_DOCUMENT, node_program
from urdf_model import Model

import picture
from screw_module_ros.bridge.pages import FOLDER
from screw_module_ros.drawing import Path3D
from screw_module_ros.geometry import inverse
from screw_module_ros.nodes.robot_description import robot_description
from screw_module_ros.nodes.web_bridge import measures_for_screens
from screw_module_ros.recording.pseudonym import PATTERN, checked_pseudonym
from screw_module_ros.therapy.protocol import GAME, KINDS
from screw_module_ros.trials.moving_picture import moving_picture

COUNTED = PLAYED_DOCUMENT + """
const { Count } = await import("./js/patient/main.js");
import { ABORTED, FINISHED, MOVING, PAUSED, PREPARE, REACHED, RUNNING } from "./js/link.js";
const count = new Count();
let before = null;
function told(state, phase, trial) {
  const now = { state, phase, trial };
  count.take(now, before, false);
  before = now;
}
"""


def test_a_target_counts_once_though_its_trial_was_repeated(result_of):
    """A pause during the hold at the target repeats the trial."""
    assert result_of(COUNTED + """
        told(RUNNING, PREPARE, 1); told(RUNNING, MOVING, 1); told(RUNNING, REACHED, 1);
        told(PAUSED, REACHED, 1); told(RUNNING, PREPARE, 1); told(RUNNING, REACHED, 1);
        told(RUNNING, REACHED, 2); told(FINISHED, 0, 2);
        const result = [count.reached, count.hasSeenAll];
    """) == [2, True]


def test_a_session_after_one_that_was_ended_in_its_first_trial_counts_anew(result_of):
    assert result_of(COUNTED + """
        told(RUNNING, REACHED, 1); told(ABORTED, 0, 1); count.miss();
        told(RUNNING, PREPARE, 1);
        const result = [count.reached, count.hasSeenAll];
    """) == [0, True]


def test_a_screen_that_lost_its_connection_tells_no_number(result_of):
    script = """
        import { veil } from "./js/words.js";
        told(RUNNING, PREPARE, 1); told(RUNNING, REACHED, 1);
        count.miss();
        told(RUNNING, MOVING, 4); told(FINISHED, 0, 4);
        const { reached, hasSeenAll } = count;
        const result = veil({ isOpen: true, isHeard: true, isTold: true, safety: 0, trials: 4,
                              state: before, reached, hasSeenAll });
    """
    assert result_of(COUNTED + script) == ["flowers", "Finished. Thank you!", ""]


def test_only_reaches_have_targets(result_of):
    """An evaluation has circles, holding and pushing as well."""
    assert result_of(ROWS + """
        card.take({ ...trial(3, 4), kind: "reach", reached: true });
        card.take({ ...trial(4, 5), kind: "hold", reached: true });
        card.take({ ...trial(5, 6), kind: "strength", reached: false });
        card.show();
        const result = card.summary.textContent;
    """) == "P-22222: 1 of 3 targets reached"
    assert result_of(ROWS + """
        card.take({ ...trial(3, 4), assisted: true, reached: true });
        card.show();
        const result = card.summary.textContent;
    """) == "P-22222: 1 of 3 targets reached, without assistance 0 of 2"
    script = """
        import { veil } from "./js/words.js";
        told(RUNNING, PREPARE, 1); told(RUNNING, REACHED, 1);
        count.take({ state: RUNNING, phase: MOVING, trial: 2, kind: "hold" }, before, false);
        told(FINISHED, 0, 2);
        const { reached, hasSeenAll, hasOthers } = count;
        const result = veil({ isOpen: true, isHeard: true, isTold: true, safety: 0, trials: 2,
                              state: before, reached, hasSeenAll, hasOthers });
    """
    assert result_of(COUNTED + script) == ["flowers", "Finished. Thank you!", "1 target reached"]


@pytest.mark.parametrize(("state", "told"), [
    ("RUNNING", ["wait", "One moment …", "The exercise has stopped"]),
    ("PAUSED", ["wait", "One moment …", "The exercise has stopped"]),
    ("STARTING", ["wait", "One moment …", "The exercise has stopped"]),
    ("IDLE", None),
])  # fmt: skip
def test_a_session_that_has_gone_silent_asks_for_nothing(result_of, state, told):
    """The robot still tells where the hand is when the session's node has died."""
    assert result_of(f"""
        import {{ veil }} from "./js/words.js";
        import {{ {state} }} from "./js/link.js";
        const result = veil({{ isOpen: true, isHeard: true, isTold: false, safety: 0,
                               state: {{ state: {state} }} }});
    """) == told


@pytest.mark.parametrize(("block", "shown"), [
    ("'Reaching'", [[1]]), ("'Strength'", []), ("'constructor'", [[1], [2]]),
])  # fmt: skip
def test_the_targets_of_one_block_are_shown(result_of, block, shown):
    """Those of a whole evaluation overlapped on a phone."""
    assert result_of(f"""
        import {{ targetsOf }} from "./js/link.js";
        const protocol = {{ targets: [[1], [2]], blocks: {{ Reaching: [[1]], Strength: [] }} }};
        const result = targetsOf(protocol, {{ block: {block} }});
    """) == shown


@pytest.mark.parametrize(("safety", "state", "told"), [
    (0, "PAUSED", "Pause"), (0, "STARTING", "One moment …"), (2, "PAUSED", "The robot has stopped"),
])  # fmt: skip
def test_a_pause_tells_the_patient_what_kind_it_is(result_of, safety, state, told):
    """Nobody `goes on in a moment` after a stop, and a session that begins was not interrupted."""
    _, title, _ = result_of(f"""
        import {{ veil }} from "./js/words.js";
        import {{ {state} }} from "./js/link.js";
        const result = veil({{ isOpen: true, isHeard: true, isTold: true, safety: {safety},
                               state: {{ state: {state} }} }});
    """)
    assert title == told


@pytest.mark.parametrize(("asked", "robot"), [
    ("null", "/left"), ("'/right'", "/right"), ("'right'", "/right"), ("'rigth'", None),
])  # fmt: skip
def test_a_patients_screen_shows_no_other_robot_than_was_asked_for(result_of, asked, robot):
    """`?robot=right` showed the left one's hand to the right one's patient."""
    assert result_of(f"""
        import {{ chosenRobot }} from "./js/link.js";
        const result = chosenRobot(["/left", "/right"], {asked}) ?? null;
    """) == robot


@pytest.mark.parametrize(("height", "is_drawn"), [("0.2", True), ("null", False)])
def test_the_elevators_car_is_seen_though_the_plane_is_not_homed(result_of, height, is_drawn):
    """A session up and down needs no plane: it ran, but the patient did not see the hand."""
    assert result_of(f"""
        import {{ drawElevator }} from "./js/patient/scenes.js";
        const drawn = [];
        const draws = (_, name) => () => drawn.push(name);
        const ctx = new Proxy({{}}, {{ get: draws, set: () => true }});
        const state = {{ start: {{ z: 0.18 }}, target: {{ z: 0.32 }}, phase: 2 }};
        const hand = {{ x: null, y: null, z: {height}, isKnown: false }};
        drawElevator({{ ctx, width: 800, height: 600 }}, {{ state, hand }});
        const result = drawn.includes("roundRect");
    """) == is_drawn


DRAWN = PLAYED_DOCUMENT + """
    const { Count } = await import("./js/patient/main.js");
    const { SCENES, drawSign } = await import("./js/patient/scenes.js");
    const { BLUE, INK, ORANGE, drawHand } = await import("./js/draw.js");
    let calls = [];
    const ctx = new Proxy({}, {
      get: (_, name) => (...values) => calls.push([name, ...values]),
      set: (_, name, value) => calls.push([name, value]) > 0,
    });
    const picture = { ctx, width: 1280, height: 720 };
    const draw = (space, hand) => SCENES[space](picture, {
      hand: { isKnown: true, ...hand }, seen: new Count(), bloom: 1, side: "right",
      state: { kind: "reach", phase: 3, start: { z: 0.18 }, target: { x: 0, y: 0, z: 0.2 } },
    });
    // The corners of the first polygon of this colour.
    const polygon = (colour) => {
      const end = calls.findIndex(([name], i) => name === "closePath"
        && calls[i + 1][1] === colour);
      return calls.slice(0, Math.max(end, 0)).slice(-4).filter(([name]) => name.endsWith("To"));
    };
"""


@pytest.mark.parametrize("space", ["plane", "space"])
def test_hand_and_target_are_seen_from_two_metres(result_of, space):
    """A degree of view: 35 mm at 2 m, of a screen that is 300 mm high."""
    assert result_of(DRAWN + f"""
        draw("{space}", {{ x: 0.1, y: 0, z: 0.2 }});
        const [[, x], [, right]] = polygon(ORANGE);
        const discs = calls.filter(([name], i) => name === "arc" && calls[i + 1][1] === BLUE);
        const radii = [right - x, ...discs.map(([, , , radius]) => radius)];
        const result = [radii.length, Math.min(...radii) >= 720 * 35 / 300 / 2];
    """) == [2, True]


@pytest.mark.parametrize(("state", "told"), [
    ("phase: 1, kind: 'reach'", "Relax: the robot moves your hand"),
    ("phase: 2, kind: 'reach'", "Move the blue hand to the orange diamond"),
    ("phase: 3, kind: 'reach', target: { x: 0, z: 0.04 }", "Lower the elevator to the person"),
    ("phase: 4, kind: 'reach'", "Take your time"),
    ("phase: 4, kind: 'hold'", "Hold your hand still"),
    ("phase: 5, kind: 'reach'", "Well done"),
    ("phase: 0, kind: 'reach'", ""),
])  # fmt: skip
def test_the_patient_is_told_what_to_do_now(result_of, state, told):
    assert result_of(f"""
        import {{ task }} from "./js/words.js";
        const start = {{ x: 0, z: 0.18 }};
        const result = task({{ start, target: {{ x: 0.1, z: 0.18 }}, {state} }});
    """) == told


TOLD = re.compile(r'\bt\(\s*"((?:[^"\\\\]|\\\\.)*)"')
TABLES = ("PAGE", "CHECKS", "LIMITS", "RECORD", "SIDES", "SCALES")
WORDS = ("words.js", "cells.js")


def told_by_the_words(result_of):
    """Return the English sentences of the pages, with those of tables, and the German ones."""
    text = "".join((FOLDER / "js" / name).read_text("utf-8") for name in WORDS)
    english, german = result_of(f"""
        import * as sentences from "./js/words.js";
        import * as cells from "./js/cells.js";
        const words = {{ ...sentences, ...cells }};
        import {{ GERMAN }} from "./js/german.js";
        const texts = (value) =>
          typeof value === "string" ? [value] : Object.values(value).flatMap(texts);
        const tables = {json.dumps(TABLES)}.flatMap((name) => texts(words[name]));
        const result = [tables, GERMAN];
    """)
    return {*TOLD.findall(text), *filter(None, english)}, german


def test_no_sentence_of_the_therapists_pages_is_missing_in_german_or_left_over(result_of):
    english, german = told_by_the_words(result_of)
    assert english == set(german)
    for one, other in german.items():
        places = [sorted(re.findall(r"\{\d\}", each)) for each in (one, other)]
        assert other.strip() and places[0] == places[1], one


@pytest.mark.parametrize("name", WORDS)
def test_every_sentence_of_the_words_goes_through_the_language(name):
    """One that stands alone would stay English."""
    text = re.sub(r"//.*", "", (FOLDER / "js" / name).read_text("utf-8"))
    text = TOLD.sub("", re.sub(r"= table\(\{.*?\n\}\);", "", text, flags=re.S))
    filled = [re.sub(r"\$\{[^}]*\}", "", each) for each in re.findall(r"`([^`]*)`", text)]
    alone = [each for each in [*re.findall(r'"([^"\n]*)"', text), *filled]
             if re.search(r"[a-z]{2} [a-z]{2}", each)]  # fmt: skip
    # What the nodes say, to know it again.
    assert set(alone) <= {"the patient asked", "the therapist paused it", "emergency stop"}


def test_german_sentences_are_filled_in_and_what_nodes_say_is_known(result_of):
    assert result_of("""
        globalThis.localStorage = { getItem: () => "de" };
        const words = await import("./js/words.js");
        const { measureTitle } = await import("./js/cells.js");
        const state = { state: 2, patient: "P-7K3QX", protocol: "x", trial: 2, trials: 9,
          reason: "the arm pulls hard", recorded: true, kind: "reach", rest: null };
        const about = { side: "left", protocol: "lift", level: "", support: 6, stiffness: 80 };
        const result = [words.sessionSentence(state, []), words.toTick("A"),
          words.badge({ state: 1 }, { level: 0 })[0], words.asLastTime(about),
          measureTitle({ label: "path error", unit: "mm" })];
    """) == [
        "P-7K3QX: x. Pause, Bewegung 2 von 9: der Arm zieht stark. Sie wird aufgezeichnet.",
        "Noch anzukreuzen: A.", "▶\ufe0e Läuft",
        "Letztes Mal: Arm links, lift, 6.0 N Stütze, 80 N/m Seitenwände.",
        "Abstand von der Geraden [mm]",
    ]  # fmt: skip


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != GAME])
def test_every_kind_of_trial_has_its_words(result_of, kind):
    assert result_of(f"""
        import {{ task }} from "./js/words.js";
        const result = task({{ phase: 3, kind: "{kind}", start: {{ x: 0 }}, target: {{ x: 1 }} }});
    """)


@pytest.mark.parametrize(("space", "hand", "told"), [
    ("plane", "x: 0.1, y: 0.009, z: null", "Get ready"),  # the vertical is not homed, nor used
    ("plane", "x: 0.1, y: 0.011, z: 0.18", "Relax: the robot moves your hand"),
    ("vertical", "x: null, y: null, z: 0.175", "Get ready"),
    ("space", "x: 0.1, y: 0, z: 0.25", "Relax: the robot moves your hand"),
])  # fmt: skip
def test_a_hand_that_is_at_the_start_is_not_told_that_it_is_moved(result_of, space, hand, told):
    """Between two reaches it is there already: the sentence came and went each two seconds."""
    assert result_of(PLAYED_DOCUMENT + f"""
        const {{ isAtStart }} = await import("./js/patient/main.js");
        const {{ task }} = await import("./js/words.js");
        const state = {{ phase: 1, start: {{ x: 0.1, y: 0, z: 0.18 }}, hit_radius: 0.01 }};
        const world = {{ state, protocol: {{ space: "{space}" }}, hand: {{ {hand} }} }};
        const result = task(state, isAtStart(world));
    """) == told


@pytest.mark.parametrize(("hand_y", "way"), [(-0.1, -1), (0.1, 1), (0.01, None)])
def test_the_floor_shows_whether_a_target_is_farther_or_nearer(result_of, hand_y, way):
    """Without it a hand that is too far away is seen at a target that is nearer and lower."""
    assert result_of(DRAWN + f"""
        draw("space", {{ x: 0, y: {hand_y}, z: 0.2 }});
        const [tip, base] = polygon(INK); // of the arrow's head
        const result = tip ? Math.sign(tip[2] - base[2]) : null;
    """) == way


def test_a_left_hand_is_a_right_one_mirrored(result_of):
    assert result_of(DRAWN + """
        const ends = (side) => {
          calls = [];
          drawHand(ctx, 0, 0, 10, side);
          return calls.filter(([name]) => name.endsWith("To")).map(([, x, y]) => [x, y]);
        };
        const [left, right] = [ends("left"), ends("right")];
        const result = [left[0][0] === right[0][0],
          right.every(([x, y], i) => left[i][0] === -x && left[i][1] === y)];
    """) == [False, True]


def test_each_reason_to_wait_has_a_sign_of_its_own_shape(result_of):
    """Words alone are not read from two metres, and colours alone not told apart."""
    told, shapes = result_of(DRAWN + """
        const { veil } = await import("./js/words.js");
        const told = [{ isOpen: false }, { isHeard: false }, { safety: 2 },
          ...[2, 3, 4, 5].map((state) => ({ state: { state } }))].map((each) => veil({
            isOpen: true, isHeard: true, isTold: true, safety: 0, trials: 1, ...each })[0]);
        const shapes = told.map((sign) => {
          calls = [];
          drawSign(picture, sign);
          return JSON.stringify(calls.filter(([name]) => !name.endsWith("Style")));
        });
        const result = [told, shapes];
    """)
    assert told == ["lost", "wait", "stop", "pause", "flowers", "done", "start"]
    assert len(set(shapes)) == 7


def test_a_target_blooms_where_it_was_reached_and_once_for_each_movement(result_of):
    assert result_of(COUNTED + """
        const at = (y, trial, phase) => {
          const now = { state: RUNNING, phase, trial, target: { x: 0, y, z: 0.18 } };
          count.take(now, before, false);
          before = now;
        };
        at(0.14, 1, MOVING); at(0.14, 1, REACHED); at(0.14, 1, PREPARE); at(0.14, 1, REACHED);
        at(0, 2, MOVING); at(0, 2, REACHED); at(0.14, 3, MOVING); at(0.14, 3, REACHED);
        const places = [[0, 0.14, 0.18], [0, 0, 0.18], [0.14, 0, 0.18]];
        const result = places.map(([x, y, z]) => count.times({ x, y, z }));
    """) == [2, 1, 0]


@pytest.mark.parametrize(("space", "colour"), [
    ("plane", "#cc79a7"), ("space", "#cc79a7"), ("vertical", "#f0e442"),
])  # fmt: skip
def test_a_target_that_was_reached_makes_the_picture_richer(result_of, space, colour):
    protocol = json.dumps({"centre": [0, 0, 0.18], "targets": [[0.1, 0.1, 0.18]]})
    assert result_of(DRAWN + f"""
        const seen = new Count();
        const state = {{ kind: "reach", phase: 3, state: 1, trial: 1,
          start: {{ x: 0, y: 0, z: 0.18 }}, target: {{ x: 0.1, y: 0.1, z: 0.18 }} }};
        const reached = () => {{
          calls = [];
          SCENES["{space}"](picture, {{ hand: {{ z: null }}, seen, bloom: 1, side: "right",
            state: {{ ...state, phase: 1 }}, protocol: {protocol} }});
          return calls.filter((each) => each.join() === "fillStyle,{colour}").length;
        }};
        const result = [reached()];
        seen.take({{ ...state, phase: 5 }}, state, false);
        result.push(reached());
        seen.take({{ ...state, phase: 5, trial: 2 }}, state, false);
        result.push(seen.times(state.target));
    """) == [0, 1 if space == "vertical" else 6, 2]


@pytest.mark.parametrize("is_still", ["true", "false"])
def test_fruit_keeps_still_for_who_wants_little_motion(result_of, is_still):
    assert result_of(DRAWN + f"""
        const {{ FruitGame }} = await import("./js/patient/fruit.js");
        const game = new FruitGame(() => 0.5);
        game.isStill = {is_still};
        game.picked = 40;  // where the wind blows
        const places = [0.5, 0.5].map((dt) => {{
          game.step(dt, [0, 0, 0.1]);
          return game.place[0];
        }});
        const result = places[0] === places[1];
    """) == (is_still == "true")


FORM = PLAYED_DOCUMENT + """
    const { SessionCard } = await import("./js/therapist/session.js");
    const protocols = [{ name: "a", protocol: "a" }, { name: "b", protocol: "b" }];
    const card = new SessionCard(protocols, () => {});
"""


def test_the_form_follows_the_session_also_when_another_began_meanwhile(result_of):
    """A page without a connection misses the end of one session and the start of the next."""
    assert result_of(FORM + """
        card.show({ state: 1, patient: "P-22222", protocol: "a" });
        card.show({ state: 1, patient: "P-33333", protocol: "b" });
        const result = [card.patient.value, card.protocol.value, card.start.disabled];
    """) == ["P-33333", "b", True]


@pytest.mark.parametrize("recorded", [True, False])
def test_the_form_shows_whether_the_session_that_runs_is_recorded(result_of, recorded):
    """Another page, or a console, may have started it; the next one is recorded by default."""
    assert result_of(FORM + f"""
        card.record.checked = true;
        const seen = (state, recorded) => {{
          card.show({{ state, recorded, patient: "P-22222", protocol: "a" }});
          return card.record.checked;
        }};
        const result = [seen(5, false), seen(1, {str(recorded).lower()}), seen(3, false)];
    """) == [True, recorded, True]


STOPPED = """
    const { safetySentence } = await import("./js/words.js");
    const safety = { level: 2, reasons: ["emergency stop"] };
    const endpoint = { enabled: [false, false] };
"""


@pytest.mark.parametrize(("state", "way_out"), [
    (1, "Then press Resume, which repeats the movement, or End session."),
    (2, "Then press Resume, which repeats the movement, or End session."),
    (0, "Then press Start."),
    (3, "Then press Start."),
])  # fmt: skip
def test_after_a_software_stop_a_therapist_is_told_what_to_do(result_of, state, way_out):
    """A therapist has no console, and no page may reset a stop."""
    told, is_bad = result_of(STOPPED + f"""
        const result = safetySentence(safety, endpoint, {{ state: {state} }});
    """)
    assert is_bad
    assert told.startswith("The robot has stopped: the software stop was asked for. See to the")
    assert "ask its operator to remove the cause, reset the stop and switch the torque on" in told
    assert told.endswith(way_out)
    assert "~/" not in told and "console" not in told


def test_the_supervisors_answer_to_a_console_is_not_shown(result_of):
    assert result_of(PLAYED_DOCUMENT + """
        const { RobotPanel } = await import("./js/therapist/main.js");
        const tell = RobotPanel.prototype.softwareStop;
        const words = [];
        const panel = { robot: "/", session: { tell: (sentence) => words.push(sentence) } };
        panel.bridge = { call: async () => ({ success: true, message: "call ~/reset" }) };
        await tell.call(panel);
        panel.bridge = { call: async () => ({ success: false, message: "nobody answers" }) };
        await tell.call(panel);
        const result = words;
    """) == [
        "Software stop asked for …",
        "The software stop was carried out. What to do now stands beside its button.",
        "Software stop asked for …",
        "The software stop failed: nobody answers. Use the emergency stop.",
    ]


def test_a_stopped_robot_is_neither_started_nor_resumed(result_of):
    """The session would pause again at once, without a word of why the button did nothing."""
    assert result_of(FORM + """
        const seen = (state, isStopped) => {
          card.patient.value = "P-22222";
          card.side.value = "left";
          for (const [, box] of card.checks) box.checked = true;
          card.show({ state, patient: "P-22222", protocol: "a" }, isStopped,
            isStopped ? "stopped" : "");
          return [card.start, card.resume, card.end].map((each) => !each.disabled);
        };
        const result = [seen(0, true), seen(0, false), seen(2, true), seen(2, false)];
    """) == [[False] * 3, [True, False, False], [False, False, True], [False, True, True]]


@pytest.mark.parametrize(("state", "recorded", "can_stop"), [
    (0, False, False), (1, False, False), (2, False, False), (3, False, False),
    (0, True, False),  # of a session that the node has forgotten
    (1, True, True), (2, True, True), (3, True, True),  # it ends a second after the session
])  # fmt: skip
def test_a_recording_is_stopped_only_where_there_is_one(result_of, state, recorded, can_stop):
    assert result_of(FORM + f"""
        const before = card.save.disabled;
        const told = {{ state: {state}, patient: "P-22222", protocol: "a" }};
        card.show({{ ...told, recorded: {json.dumps(recorded)} }});
        const result = [before, !card.save.disabled];
    """) == [True, can_stop]


SUPPORT = PLAYED_DOCUMENT + """
    const { SupportCard } = await import("./js/therapist/support.js");
    const calls = [];
    const card = new SupportCard(async (service, args) => {
      calls.push([service, args]);
      return answer;
    }, () => ({ patient: "P-22222", side: "left" }));
    let answer = { success: true, message: "keep off the handle" };
    const axis = { support: 9, support_limit: 25, hand_off: false };
    const state = { state: 0, support: 9, arm: "", arm_weight: 18, arm_spread: 1 };
"""


@pytest.mark.parametrize(("weight", "limit", "brakes", "told"), [
    ("18", 25, True, [20, "the arm's weight and 2 N"]),
    ("null", 25, True, [15, "the arm is not weighed"]),
    ("18", 0, True, [0, "this mode feeds no force back: choose mode 3, 4 or 5"]),
    ("18", 8, False, [8, "at a stop the drive coasts, so the arm falls"]),
    ("24", 25, True, [25, "the robot carries no more"]),
])  # fmt: skip
def test_the_limit_of_the_support_has_its_reason(result_of, weight, limit, brakes, told):
    assert result_of(f"""
        const {{ supportLimit }} = await import("./js/words.js");
        const drive = {{ brakes: {str(brakes).lower()} }};
        const result = supportLimit({weight}, {{ support_limit: {limit} }}, drive);
    """) == told


def test_the_support_is_set_in_steps_of_the_weight(result_of):
    """The node refuses what is beyond a bound, and its sentence stays until the next act."""
    assert result_of(SUPPORT + """
        card.show(state, axis, { brakes: true });
        const bounds = [card.input.step, card.input.max, card.shown.textContent];
        answer = { results: [{ successful: false, reason: "the arm weighs 18.0 N" }] };
        await card.set(25);
        card.show(state, axis, { brakes: true });
        const result = [bounds, card.told.textContent, card.input.value, calls[0][1].parameters[0]];
    """) == [
        [0.9, 20.001, "9.0 N, 50 %"], "the arm weighs 18.0 N", 9,
        {"name": "support.force", "value": {"type": 3, "double_value": 25}},
    ]  # fmt: skip


def test_a_slider_that_is_held_is_not_moved_under_the_hand(result_of):
    assert result_of(SUPPORT + """
        card.show(state, axis, null);
        card.input.value = 13.5;
        card.input.oninput();
        card.show({ ...state, support: 8.1 }, axis, null);
        const held = [card.input.value, card.shown.textContent];
        answer = { results: [{ successful: true, reason: "" }] };
        await card.set(13.5);
        card.show({ ...state, support: 13.5 }, axis, null);
        const result = [held, card.input.value];
    """) == [[13.5, "13.5 N, 75 %"], 13.5]


def test_what_the_dialogue_waits_for_is_told_and_it_knows_whose_arm_it_is(result_of):
    assert result_of(SUPPORT + """
        await card.ask("therapy_session/weigh", card.whose());
        card.show({ ...state, arm: "strap the arm in" }, axis, null);
        const told = card.arm.textContent;
        card.show({ ...state, state: 2 }, axis, null);
        const off = [card.weigh.disabled, card.lower.disabled];
        card.show({ ...state, state: 1 }, axis, null);
        const result = [calls, told, card.arm.textContent, ...off, card.lower.disabled];
    """) == [
        [["therapy_session/weigh", {"patient": "P-22222", "side": "left"}]], "Strap the arm in.",
        "The arm weighs 18.0 N; its places differ by 1.0 N.", True, False, True,
    ]  # fmt: skip


@pytest.mark.parametrize(("axis", "told"), [
    ("null", "The vertical axis is silent."),
    ("{ ...axis, hand_off: true }", "The hand has left the handle: the support is away until it"),
    ("axis", "In use 9.0 N, at most 20.0 N: the arm's weight and 2 N."),
])  # fmt: skip
def test_what_is_in_use_is_told(result_of, axis, told):
    found = result_of(SUPPORT + f"""
        card.show(state, {axis}, {{ brakes: true }});
        const result = card.use.textContent;
    """)
    assert found.startswith(told)


def test_the_form_shows_whose_arm_the_session_is_for(result_of):
    assert result_of(FORM + """
        card.show({ state: 1, patient: "P-22222", side: "right", protocol: "a" });
        const running = [card.whose(), card.side.disabled];
        card.show({ state: 3, patient: "P-22222", side: "right", protocol: "a" });
        const result = [running, card.whose().side, card.side.disabled];
    """) == [[{"patient": "P-22222", "side": "right"}, True], "", False]


def test_the_reason_of_a_refused_limit_stays(result_of):
    assert result_of(PLAYED_DOCUMENT + """
        const { LimitsCard } = await import("./js/therapist/limits.js");
        const card = new LimitsCard(async (service) => service.endsWith("set_parameters")
          ? { results: [{ successful: false, reason: "wish.low: too high" }] }
          : { descriptors: [], values: [] });
        await card.set("wish.low", 0.3);
        await new Promise((resolve) => setTimeout(resolve, 50));
        const result = card.told.textContent;
    """) == "wish.low: too high"


def test_limits_that_another_page_has_set_are_shown(result_of):
    assert result_of(PLAYED_DOCUMENT + """
        const { LimitsCard } = await import("./js/therapist/limits.js");
        const set = { "wish.low": 0.03, "wish.high": 0.33 };
        let allowed;
        const card = new LimitsCard(async (service, { names }) => service.includes("describe")
          ? { descriptors: names.map(() => ({ description: "height [m]",
              floating_point_range: [{ from_value: 0, to_value: 0.36 }] })) }
          : { values: names.map((name) => ({ double_value: set[name] ?? 1 })) },
          (values) => { allowed = values; });
        await card.load();
        const { input } = card.sliders["wish.low"];
        Object.assign(set, { "wish.low": 0.1, "wish.high": 0.2 });
        const high = card.sliders["wish.high"].input;
        high.oninput();  // it is being moved on this page
        await card.refresh();
        const result = [input.value, allowed["wish.low"], high.value];
    """) == [0.1, 0.1, 0.33]


ROWS = PLAYED_DOCUMENT + """
    const { MovementsCard } = await import("./js/therapist/movements.js");
    const at = (sec) => ({ header: { stamp: { sec, nanosec: 0 } } });
    const trial = (number, sec, patient = "P-22222") =>
      ({ ...at(sec), patient, protocol: "a", trial: number, block: 1, circuit: 1, duration: 1,
        peak_speed: 1, path_error: 1, sparc: -1, robot_share: null });
    const change = (circuit, sec) => ({ ...at(sec), block: 1, circuit, duration: 1,
      side_stiffness: 1, reason: "" });
    const card = new MovementsCard([]);
    card.take(trial(1, 1)); card.take(trial(2, 2)); card.takeChange(change(1, 2));
    const shown = () => [card.trials.map((each) => each.trial),
      card.changes.map((each) => each.circuit)];
"""


@pytest.mark.parametrize(("state", "expected"), [
    ("{ state: 1, patient: 'P-22222', protocol: 'a', trial: 2 }", [[1, 2], [1]]),  # goes on
    ("{ state: 1, patient: 'P-22222', protocol: 'a', trial: 1 }", [[], []]),  # begins anew
    ("{ state: 1, patient: 'P-33333', protocol: 'a', trial: 9 }", [[], []]),
    ("{ state: 3, patient: 'P-22222', protocol: 'a', trial: 2 }", [[1, 2], [1]]),
])  # fmt: skip
def test_another_session_does_not_show_the_movements_of_the_last(result_of, state, expected):
    assert result_of(ROWS + f"card.follow({state}); const result = shown();") == expected


@pytest.mark.parametrize(("kept", "expected"), [
    ("[], []", [[1, 2, 3], [1]]),  # the bridge was started again
    ("[trial(1, 1), trial(2, 2)], [change(1, 2)]", [[1, 2, 3], [1]]),
    ("[trial(3, 4)], [change(2, 3)]", [[1, 2, 3], [1, 2]]),
    ("[trial(1, 3, 'P-33333')], []", [[1, 3], []]),  # and another session
    ("[trial(1, 3)], []", [[1, 3], []]),  # of the same patient
])  # fmt: skip
def test_movements_stay_when_the_bridge_was_started_again(result_of, kept, expected):
    """With each connection it sends what it has kept, and then what comes."""
    told = "P-33333" if "P-33333" in kept else "P-22222"
    assert result_of(ROWS + f"""
        const connect = (trials, changes) => {{
          trials.forEach((each) => card.take(each));
          changes.forEach((each) => card.takeChange(each));
        }};
        connect({kept});
        card.take(trial(3, 4, "{told}"));
        const once = shown();
        connect({kept});
        card.take(trial(3, 4, "{told}"));
        const result = [once, shown()];
    """) == [expected, expected]


def test_measures_are_shown_as_the_bridge_describes_them(result_of):
    """Labels, units and factors exist once, in therapy/measures.py."""
    measures = json.dumps(measures_for_screens())
    assert result_of(PLAYED_DOCUMENT + f"""
        const {{ MovementsCard }} = await import("./js/therapist/movements.js");
        const {{ measureTitle }} = await import("./js/cells.js");
        const card = new MovementsCard({measures});
        const cells = [];
        document.createElement = () => {{
          const made = new Played();
          made.append = (...words) => {{
            cells.push(...words.filter((each) => typeof each === "string"));
          }};
          return made;
        }};
        card.row({{ trial: 7, reached: true, duration: 1.234, peak_speed: 0.2, path_error: 0.0042,
                   sparc: null, robot_share: 0.25 }});
        const result = [card.measures.map(measureTitle), cells];
    """) == [
        ["Duration [s]", "Peak speed [mm/s]", "Path error [mm]", "SPARC",
         "Robot's share of the work [%]"],
        ["7", "✓ yes", "1.23", "200", "4.2", "–", "25"],
    ]  # fmt: skip


@pytest.mark.parametrize(("error", "told"), [
    ('new Error("", { cause: "lost" })', "the connection to the robot was lost"),
    ('new Error("wrong token", { cause: "refused" })', "Not let in: wrong token"),
    ('new Error("a/service", { cause: "unanswered" })', "a/service did not answer"),
    ('new Error("not a pseudonym")', "not a pseudonym"),
])  # fmt: skip
def test_an_error_has_a_sentence(result_of, error, told):
    script = f'import {{ failure }} from "./js/words.js"; const result = failure({error});'
    assert result_of(script) == told


def test_sentences_stand_in_modules_of_their_own():
    """The places to translate: of the therapist's page, and of the patient's screen."""
    sentence = re.compile(r"""["`][A-Z][a-z]+ [a-z][^"`]*["`]""")
    for file in (FOLDER / "js").rglob("*.js"):
        found = sentence.findall(file.read_text("utf-8"))
        has_words = file.name in (*WORDS, "languages.js", "german.js", "german_nodes.js")
        assert bool(found) == has_words, f"{file.name}: {found}"


def test_pseudonyms_of_page_and_node_are_the_same_and_no_names(result_of):
    made, fits = result_of("""
        import { PATTERN, cleaned, newPseudonym } from "./js/therapist/session.js";
        const pattern = new RegExp(`^(?:${PATTERN})$`, "v");
        const made = Array.from({ length: 300 }, newPseudonym);
        const texts = [...made, "P-7K3QX", cleaned("Peter"), cleaned("Erika Musterfrau"), "P-7K3Q"];
        const result = [made, texts.map((text) => pattern.test(text))];
    """)
    assert [checked_pseudonym(each) for each in made] == made
    assert fits == [True] * 301 + [False] * 3
    assert not PATTERN.fullmatch("P-PETER")


# Whether a pseudonym is known --------------------------------------------------------------


COUNTED_SESSIONS = PLAYED_DOCUMENT + """
    const { SessionCard } = await import("./js/therapist/session.js");
    const asked = [], answers = {}, tick = () => new Promise((resolve) => setTimeout(resolve));
    const card = new SessionCard([{ name: "a", protocol: "a" }], (service, args) => {
      asked.push([service, args.patient]);
      return answers[args.patient] ?? Promise.resolve({ success: true, sessions: 0 });
    });
    const type = (text) => { card.patient.value = text; card.patient.oninput(); return tick(); };
    const told = () => card.counted.textContent;
"""


def test_beside_start_stands_whether_the_pseudonym_is_known(result_of):
    """A mistyped one silently became a new patient."""
    assert result_of(COUNTED_SESSIONS + """
        answers["P-7K3QX"] = Promise.resolve({ success: true, sessions: 3 });
        const result = [];
        for (const text of ["p7k3q", "p7k3qx", "P-7K3QY", "P-7K3"]) {
          await type(text);
          result.push(told());
        }
        result.push(asked);
    """) == ["", "session 4", "first session", "",
             [["session_recorder/count", "P-7K3QX"], ["session_recorder/count", "P-7K3QY"]]]


def test_an_answer_for_a_pseudonym_that_was_typed_over_is_not_shown(result_of):
    assert result_of(COUNTED_SESSIONS + """
        let late;
        answers["P-7K3QX"] = new Promise((resolve) => { late = resolve; });
        await type("P-7K3QX");
        await type("P-7K3QY");
        late({ success: true, sessions: 3 });
        await tick();
        const result = told();
    """) == "first session"


@pytest.mark.parametrize("answer", [
    "Promise.reject(new Error('nobody offers it'))", "Promise.resolve({ success: false })",
])  # fmt: skip
def test_without_a_count_nothing_is_claimed(result_of, answer):
    assert result_of(COUNTED_SESSIONS + f"""
        answers["P-7K3QX"] = {answer};
        await type("P-7K3QX");
        const result = told();
    """) == "sessions not known"


def test_a_new_pseudonym_and_that_of_before_are_counted_and_a_session_that_runs_is_not(result_of):
    assert result_of(COUNTED_SESSIONS + """
        answers["P-7K3QX"] = Promise.resolve({ success: true, sessions: 3 });
        const result = [];
        card.fresh(); await tick(); result.push(told());
        for (const state of [1, 3]) {
          card.show({ state, patient: "P-7K3QX", protocol: "a" });
          result.push(told());
        }
        card.sameAgain(); await tick(); result.push(told());
    """) == ["first session", "", "", "session 4"]


# The screen stays on -----------------------------------------------------------------------


AWAKE = """
const { Awake } = await import("./js/awake.js");
const heard = {}, held = [], tick = () => new Promise((resolve) => setTimeout(resolve));
globalThis.document = {
  visibilityState: "visible", addEventListener: (name, act) => { heard[name] = act; },
};
class Lock {
  constructor() { this.released = false; held.push(this); }
  async release() { this.released = true; }
}
Object.defineProperty(globalThis, "navigator", { configurable: true, value: {
  wakeLock: { request: async (kind) => { if (kind !== "screen") throw kind; return new Lock(); } },
} });
const told = [];
const awake = new Awake((isHeld) => told.push(isHeld));
function show(state) { document.visibilityState = state; heard.visibilitychange(); return tick(); }
const count = () => [held.length, held.filter(({ released }) => !released).length];
"""


def test_the_screen_stays_on_and_again_after_the_page_was_hidden(result_of):
    assert result_of(AWAKE + """
        const result = [];
        await awake.ask(); result.push(count());
        await awake.ask(); result.push(count());
        held[0].released = true; await show("hidden"); result.push(count());
        await show("visible"); result.push(count(), told);
    """) == [[1, 1], [1, 1], [1, 0], [2, 1], [True, True]]


@pytest.mark.parametrize("offered", ["{}", "{ wakeLock: { request: async () => { throw 1; } } }"])
def test_a_browser_without_a_wake_lock_or_that_refuses_it_says_so_and_goes_on(result_of, offered):
    assert result_of(AWAKE + f"""
        Object.defineProperty(globalThis, "navigator", {{ value: {offered} }});
        await awake.ask();
        await show("visible");
        const result = [told, awake.lock];
    """) == [[False, False], None]


WALK = """
const { jointsAt, machineAt, posesOf } = await import("./js/machine/kinematics.js");
const places = [];
for (const x of [-0.19, -0.05, 0, 0.12, 0.19])
  for (const y of [-0.22, 0, 0.1, 0.22])
    for (const z of [0, 0.11, 0.36]) places.push([x, y, z]);
const result = places.map((place) => {
  const joints = jointsAt(...place);
  return { place, joints, poses: posesOf(joints) };
});
"""


def test_over_the_workspace_the_picture_s_links_are_where_the_urdf_has_them(result_of):
    model = Model(robot_description())
    for each in result_of(WALK):
        x, y, z = each["place"]
        shoulder, elbow = inverse(x, y)
        wanted = {"shoulder": shoulder, "elbow": elbow - shoulder, "vertical": z}
        assert each["joints"] == pytest.approx(wanted, abs=1e-12)
        assert each["poses"].keys() == model.links.keys()
        for link, pose in each["poses"].items():
            pose_there = model.pose(link, wanted)
            assert pose["at"] == pytest.approx(pose_there[:3, 3], abs=1e-12), link
            assert np.array(pose["turn"]) == pytest.approx(pose_there[:3, :3], abs=1e-12), link
        assert each["poses"]["handle"]["at"] == pytest.approx([x, y, z], abs=1e-12)


def test_the_pictures_are_of_the_urdf_of_today():
    """`tools/run python tools/picture.py` makes them anew."""
    assert picture.PARTS.read_text("utf-8") == picture.parts_text(
        picture.machine_of(robot_description())
    )
    program = node_program()
    if program is None:
        pytest.skip("neither Playwright nor Node is installed: the drawing is not compared")
    assert picture.DRAWING.read_text("utf-8") == picture.drawing(program)


PAINTED = """
const { machineAt } = await import("./js/machine/kinematics.js");
const { camera, painted } = await import("./js/machine/picture.js");
const view = camera([-3, -1.5, 1.6], [0, 0, 0], 800, 500, 1.5);
const faces = painted(machineAt(0, 0, 0.2), view);
const result = { order: faces.map(({ far }) => far),
  points: faces.flatMap(({ points }) => points.map(([x, y]) => [x, y])) };
"""


def test_a_picture_is_painted_from_far_to_near(result_of):
    painted = result_of(PAINTED)
    assert len(painted["order"]) > 300
    assert painted["order"] == sorted(painted["order"], reverse=True)
    x, y = np.array(painted["points"]).T
    assert np.isfinite(x).all() and 0 < x.min() < x.max() < 800 and y.min() > 0


def test_the_demo_s_page_has_the_paths_and_draws_them_by_itself(tmp_path):
    """Its script is one module without an import; what it draws is inside the picture."""
    program = node_program()
    if program is None:
        pytest.skip("neither Playwright nor Node is installed")
    points = np.array([[0.0, 0.0, 0.1], [0.05, 0.02, 0.12], [0.1, 0.05, 0.2]])
    file = moving_picture([Path3D("5 observer", points)], [0.2], tmp_path / "machine.html")
    script = re.search(r"<script type=\"module\">(.*)</script>", file.read_text("utf-8"), re.S)[1]
    assert "import " not in script
    (tmp_path / "package.json").write_text('{"type": "module"}')
    (tmp_path / "page.js").write_text(f"{PLAYED_PAGE}{script}\n{SAYS}")
    ended = subprocess.run(
        [program, str(tmp_path / "page.js")],
        check=False, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stderr
    shown = json.loads(ended.stdout)
    assert shown["drawn"] > 300
    assert shown["says"] == [
        "Mode 5 observer, 0.0 s. Handle at x 0.0 cm, y 0.0 cm, z 10.0 cm.",
        "Mode 5 observer, 0.2 s. Handle at x 10.0 cm, y 5.0 cm, z 20.0 cm.",
    ]


PLAYED_PAGE = """
let drawn = 0;
const frames = [], elements = {};
const call = (name) => () => { drawn += name === "fill" ? 1 : 0; };
const context = new Proxy({}, { get: (_, name) => call(name), set: () => true });
globalThis.document = { getElementById: (id) => elements[id] ??= {
  clientWidth: 800, clientHeight: 500, value: "0", getContext: () => context } };
globalThis.window = {};
globalThis.performance = { now: () => 0 };
globalThis.requestAnimationFrame = (call) => frames.push(call);
"""
SAYS = """
const told = [];
for (const now of [0, 199]) {
  frames.pop()(now);
  told.push(elements.says.textContent);
}
console.log(JSON.stringify({ drawn, says: told }));
"""


@pytest.mark.parametrize(("side", "points"), [
    ("right", [[0.06, 0.1, 0.2], [0.1, 0, 0.2]]),
    ("left", [[-0.1, 0.1, 0.2], [-0.06, 0, 0.2]]),
])  # fmt: skip
def test_targets_stand_where_the_node_has_them_for_either_arm(result_of, side, points):
    """Centre at 0.08 m: the node mirrors the centre, and the layout round it stays."""
    found = result_of(f"""
        import {{ targetsOf }} from "./js/link.js";
        const protocol = {{ centre: [0.08, 0, 0.2], targets: [[0.06, 0.1, 0.2], [0.1, 0, 0.2]] }};
        const result = targetsOf(protocol, {{ block: "", side: "{side}" }});
    """)
    assert found == [pytest.approx(point) for point in points]


@pytest.mark.parametrize(("force", "height", "support", "space", "begins"), [
    (-20, 0.2, 0, "vertical", "The arm hangs"), (-20, 0.02, 0, "space", "The arm has sunk"),
    (-2, 0.2, 0, "vertical", ""), (-20, 0.2, 15, "vertical", ""), (-20, 0.2, 0, "plane", ""),
])  # fmt: skip
def test_why_an_arm_fails_is_said_only_where_nothing_carries_it(
    result_of, force, height, support, space, begins
):
    said = result_of(f"""
        import {{ hangsSentence }} from "./js/words.js";
        const endpoint = {{
          valid: [true, true, true], position: {{ z: {height} }}, force: {{ z: {force} }},
        }};
        const result = hangsSentence({{ state: 1, support: {support} }}, endpoint, "{space}");
    """)
    assert said.startswith(begins) and bool(said) is bool(begins)


def test_each_language_of_the_patients_screen_says_everything(result_of):
    """With as many arguments; nothing is left in the other language."""
    english, german = result_of("""
        import { LANGUAGES } from "./js/patient/languages.js";
        const shape = (value, path) => typeof value === "object"
          ? Object.entries(value).flatMap(([key, each]) => shape(each, `${path}.${key}`))
          : [[path, typeof value === "function" ? `${value.length} ${value(1, 2, 3)}` : value]];
        const result = ["en", "de"].map((name) => shape(LANGUAGES[name], ""));
    """)
    assert [key for key, _ in english] == [key for key, _ in german]
    same = {key for (key, one), (_, other) in zip(english, german, strict=True) if one == other}
    assert same == {".pause", ".seasons.3"}
