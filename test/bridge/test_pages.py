# SPDX-License-Identifier: Apache-2.0
"""The pages in a real browser, against the real server and a robot that is played here."""

from __future__ import annotations

import itertools
import math
import re
import shutil
from pathlib import Path

import pytest
import yaml
from browser_pages import opened
from fake_gateway import TOKENS, FakeGateway, Served, make_server

from screw_module_ros.nodes.web_bridge import measures_for_screens
from screw_module_ros.therapy.protocol_file import expected, load_protocol, protocols_for_screens

pytestmark = pytest.mark.long

DEADLINE_MS = 60_000
PAUSED, RUNNING, FINISHED, REACHED = 2, 1, 3, 5
RANGES = {"assistance.stiffness": 800.0, "wish.half_width": 0.1905, "wish.half_depth": 0.2286,
          "wish.low": 0.36, "wish.high": 0.36, "wish.speed": 0.6}  # fmt: skip
VALUES = {"assistance.stiffness": 800.0, "wish.half_width": 0.15, "wish.half_depth": 0.15,
          "wish.low": 0.03, "wish.high": 0.33, "wish.speed": 0.3}  # fmt: skip


class PlayedRobot(FakeGateway):
    """Robots that tell what a test sets, and answer like the session's node."""

    def __init__(self, robots):
        super().__init__()
        self.values = {robot: dict(VALUES) for robot in robots}
        self.robots, self.at, self.hand = robots, 0, None
        self.off = False
        self.axis = {"support": 0.0, "support_limit": 25.0, "hand_off": False}
        self.brakes = True
        self.refuses = self.refuses_support = False
        self.why, self.reasons = "", []

    async def call(self, service, arguments):
        self.calls.append((service, arguments))
        robot, _, name = service.rpartition("/therapy_session/")
        values = self.values.get(robot or "/", {})
        if name == "describe_parameters":
            return {"descriptors": [{
                "name": each, "description": f"{each} [{'N/m' if 'stiff' in each else 'm'}].",
                "floating_point_range": [{"from_value": 0.0, "to_value": RANGES[each]}],
            } for each in arguments["names"]]}  # fmt: skip
        if name == "get_parameters":
            found = [{"type": 3, "double_value": values[each]} for each in arguments["names"]]
            return {"values": found}
        if name == "set_parameters":
            (parameter,) = arguments["parameters"]
            value = parameter["value"]
            if parameter["name"] == "support.force" and self.refuses_support:
                why = "more than 2 N over its weight"
                return {"results": [{"successful": False, "reason": why}]}
            values[parameter["name"]] = value.get("double_value", value.get("bool_value"))
            return {"results": [{"successful": True, "reason": ""}]}
        return {"success": not self.refuses, "message": self.why, "sessions": 0}

    def move(self, **state):
        """Tell a moment of all topics of all robots; state: fields of therapy/state."""
        self.at += 1
        angle = 0.1 * self.at
        across, away = math.sin(angle), math.cos(angle)
        hand = self.hand or {"x": 0.1 * across, "y": 0.1 * away, "z": 0.18 + 0.05 * across}
        stamp = {"stamp": {"sec": self.at // 20, "nanosec": self.at % 20 * 50_000_000}}
        for robot in self.robots:
            above = robot.rstrip("/")
            self.tell(f"{above}/endpoint_state", {
                "header": stamp, "position": hand, "velocity": hand,
                "force": {"x": 8 * away, "y": -6 * across, "z": 2.0},
                "valid": [True] * 3, "enabled": [not self.off] * 2, "safety": 0,
            })  # fmt: skip
            level = 2 if self.reasons else 0
            self.tell(f"{above}/safety_state", {"level": level, "reasons": self.reasons})
            self.tell(f"{above}/screw/controller_state", self.axis)
            self.tell(f"{above}/screw/amplifier_state", {"brakes": self.brakes})
            self.tell(f"{above}/therapy/state", {
                "header": stamp,
                "state": 0, "reason": "", "patient": "P-7K3QX", "protocol": "", "trial": 0,
                "trials": 0, "circuit": 1, "block": "", "kind": "reach", "assisted": True,
                "phase": 0, "start": {"x": 0, "y": 0, "z": 0.18},
                "target": {"x": 0, "y": 0.14, "z": 0.18}, "hit_radius": 0.01, "since": None,
                "duration": 1.4, "side_stiffness": 100.0, "side": "", "arm": "",
                "support": self.values[robot].get("support.force", 0.0),
                "arm_weight": None, "arm_spread": 0.0, "asks": 0, "pain": None, "tired": None,
                "goes_on": 0, "rest": None, "sound": False, **state,
            })  # fmt: skip

    def finish(self, trial):
        """Tell the result of a movement of all robots."""
        for robot in self.robots:
            self.tell(f"{robot.rstrip('/')}/therapy/trial", {
                "patient": "P-7K3QX", "protocol": "elevator", "trial": trial, "block": 1,
                "circuit": 1, "reached": trial % 5 != 0, "duration": 1.2, "peak_speed": 0.21,
                "path_error": 0.0031, "sparc": -1.52, "robot_share": None,
            })  # fmt: skip


class Serving:
    """The server with robots that move on with each look."""

    def __init__(self, robots=("/",), own=None):
        self.robot, self.own = PlayedRobot(robots), own
        self.state = {}
        self._make(0)

    def _make(self, port):
        config = {"robots": list(self.robot.robots), "protocols": protocols_for_screens(self.own),
                  "measures": measures_for_screens()}  # fmt: skip
        games = self.own and self.own / "games"
        made = make_server(self.robot, config=config, wishes=True, port=port, games=games)
        self.served = Served(made)
        self.server = self.served.__enter__()

    def restart(self):
        """End the server, and start another one on its port."""
        port = int(self.server.address.rpartition(":")[2])
        self.close()
        return lambda: self._make(port)

    def close(self):
        self.served.__exit__()

    def look(self):
        self.robot.move(**self.state)

    def until(self, page, script, act=lambda: None):
        """Let robots and pages go on until a script in the page gives true; act: each time."""
        for _ in range(DEADLINE_MS // 20):
            act()
            self.look()
            if page.evaluate(script):
                return
            page.wait_for_timeout(20)
        pytest.fail(f"{script} did not come true; the page shows {page.inner_text('body')[:600]}")

    def until_text(self, page, text, **state):
        """Tell more of the session's state, and wait until the page shows the text."""
        self.state = {**self.state, **state}
        self.until(page, f"document.body.innerText.includes({text!r})")

    def until_shown(self, page, what, value, **state):
        """The same for what the page notes of itself."""
        self.state = {**self.state, **state}
        self.until(page, f"document.body.dataset.{what} === '{value}'")


@pytest.fixture
def serving():
    made = []

    def serve(*robots, own=None):
        made.append(Serving(robots or ("/",), own))
        return made[-1]

    yield serve
    for each in made:
        each.close()


@pytest.fixture
def open_page(browser):
    pages, errors = [], []

    def make(serving, role, query="", size=(820, 700)):
        address = f"{serving.server.address}/{role}{query}#token={TOKENS[role]}"
        pages.append(opened(browser, address, errors, size))
        return pages[-1]

    yield make
    for page in pages:
        page.close()
    assert errors == []


@pytest.fixture
def therapist(serving, open_page):
    """Return what opens the therapist's page of robots: these and the page."""

    def make(*robots, **size):
        given = serving(*robots)
        page = open_page(given, "therapist", **size)
        given.until_text(page, "The robot is ready")
        return given, page

    return make


@pytest.fixture
def patient(serving, open_page):
    """The patient's screen: a robot and the screen."""
    given = serving()
    return given, open_page(given, "patient")


RUNS = {"state": RUNNING, "protocol": "elevator", "phase": 3, "trial": 1, "trials": 16}
SCENES = [
    ("clock_adaptive", {"x": 0, "y": 0.14, "z": 0.18}, "plane", "Move the blue hand to the orange"),
    ("elevator", {"x": 0, "y": 0, "z": 0.32}, "vertical", "Lift the elevator to the person"),
    ("reach_3d", {"x": 0.1, "y": 0.1, "z": 0.26}, "space", "Move the blue hand to the orange"),
]


@pytest.mark.parametrize(("protocol", "target", "scene", "task"), SCENES)
def test_each_protocol_has_its_picture(patient, protocol, target, scene, task):
    given, page = patient
    given.until_shown(page, "shown", scene, **RUNS | {"protocol": protocol, "target": target})
    given.until_text(page, task, since=0.4)
    given.until_text(
        page, "The therapist goes on in a moment", state=PAUSED, reason="the therapist paused it"
    )
    assert page.locator("#sign").is_visible()


def test_a_screen_that_came_late_counts_no_targets(patient):
    """What it has not seen it cannot count: `0 of 16 targets reached` would be wrong."""
    given, page = patient
    given.until_shown(page, "trial", 7, **RUNS | {"trial": 7})
    given.until_text(page, "Finished. Thank you!", state=FINISHED, trial=16, phase=0)
    assert "targets reached" not in page.inner_text("#veil")
    given.until_shown(page, "trial", 1, **RUNS)
    given.until_text(page, "Well done", phase=REACHED)
    given.until_text(page, "1 of 16 targets reached", state=FINISHED, trial=16, phase=0)


def test_a_session_that_follows_another_at_once_has_its_own_picture(patient):
    """The screen may miss every state between two sessions: it gets the newest alone."""
    given, page = patient
    given.until_shown(page, "shown", "plane", **RUNS | {"protocol": "clock_adaptive"})
    given.until_text(page, "Well done", phase=REACHED)
    given.until_shown(page, "shown", "vertical", protocol="elevator", trial=2, trials=9, phase=3)
    given.until_text(page, "Finished. Thank you!", state=FINISHED, trial=9, phase=0)
    assert "targets reached" not in page.inner_text("#veil")


@pytest.mark.parametrize("motion", ["reduce", "no-preference"])
def test_a_flower_opens_unless_little_motion_is_wanted(patient, motion):
    given, page = patient
    page.emulate_media(reduced_motion=motion)
    given.robot.hand = {"x": 0, "y": 0.14, "z": 0.18}
    given.until_text(page, "Move the blue hand", **RUNS | {"protocol": "clock_adaptive"})
    page.evaluate("""async () => {
        const canvas = document.querySelector("#picture"), shown = new Set();
        const next = () => new Promise((resolve) => requestAnimationFrame(resolve));
        window.shown = (async () => {
            while (!document.body.innerText.includes("Well done")) await next();
            for (let i = 0; i < 45; i++, await next()) shown.add(canvas.toDataURL());
            window.pictures = shown.size;
        })();
        return null;
    }""")
    given.state = {**given.state, "phase": REACHED}
    given.until(page, "window.pictures")
    assert (page.evaluate("window.pictures") == 1) == (motion == "reduce")


def test_the_screen_shows_the_hand_that_was_chosen(patient, open_page):
    given, page = patient
    given.until_text(page, "Pick fruit")
    right = page.evaluate("document.querySelector('#free canvas').toDataURL()")
    page.get_by_role("button", name="Hand: right").click()
    page.get_by_role("button", name="Hand: left").wait_for()
    assert page.evaluate("document.querySelector('#free canvas').toDataURL()") != right
    page.reload()
    page.get_by_role("button", name="Hand: left").wait_for()
    other = open_page(given, "patient")  # the next patient's
    other.get_by_role("button", name="Hand: right").wait_for()


def test_the_game_is_played_with_the_hand_and_can_be_left(patient):
    given, page = patient
    given.until_text(page, "Pick fruit")
    page.get_by_role("button", name="Pick fruit").click()

    def follow():  # the hand goes where the game wishes it
        wishes = [told["position"] for topic, told in given.robot.published if "wish" in topic]
        given.robot.hand = wishes[-1] if wishes else None

    for score in (1, 2, 3):
        given.until(page, f"Number(document.body.dataset.score) >= {score}", follow)
    page.get_by_role("button", name="Sound: off").click()
    page.get_by_role("button", name="Sound: on").wait_for()
    page.get_by_role("button", name="Back").click()
    given.until_text(page, "What shall we do?")
    page.get_by_role("button", name="Move freely").click()
    given.until_text(page, "Move the blue hand wherever you like")


PLAYS = {"state": RUNNING, "phase": 3, "kind": "game", "trial": 1, "trials": 3}
EXAMPLES = Path(__file__).parents[2] / "examples" / "games"


def scores(given):
    return [told["data"] for topic, told in given.robot.published if topic == "/therapy/score"]


def test_a_session_plays_the_fruit_and_tells_how_well(patient):
    given, page = patient
    seconds = itertools.count()

    def follow():
        wishes = [told["position"] for topic, told in given.robot.published if "wish" in topic]
        given.robot.hand = wishes[-1] if wishes else None
        given.state["since"] = 0.02 * next(seconds)

    given.state = PLAYS | {"protocol": "fruit", "block": "near"}
    given.until(page, "Number(document.body.dataset.score) >= 2", follow)
    given.until(page, "true", follow)
    assert not page.get_by_role("button", name="Back").is_visible()
    assert page.get_by_role("button", name="Please stop").is_visible()
    given.until(page, "document.body.dataset.shown === 'play'", lambda: scores(given)[-1] > 0.0)
    assert all(0.0 <= score <= 1.0 for score in scores(given))
    told = {"state": PAUSED, "reason": "the patient asked"}
    given.until_text(page, "As you asked", **told)
    count = len(given.robot.published)
    for _ in range(50):
        given.until(page, "true")
        page.wait_for_timeout(20)
    assert len(given.robot.published) == count, "a pause is none to the game"
    given.until_text(page, "Finished. Thank you!", state=FINISHED, reason="", trial=3, phase=0)
    assert "targets" not in page.inner_text("#veil")


def test_a_game_in_a_frame_pulls_and_scores_without_a_token_and_takes_no_key(
    serving, open_page, tmp_path, wait_until
):  # fmt: skip
    shutil.copytree(EXAMPLES, tmp_path / "games")
    (tmp_path / "games" / "thief.html").write_text("""<script>
        const told = {};
        for (const what of ["sessionStorage", "document"])
          try { told[what] = String(parent[what]); } catch (error) { told[what] = error.name; }
        try { told.own = String(sessionStorage); } catch (error) { told.own = error.name; }
        fetch("/config.json").catch((error) => { told.fetch = error.name; });
        window.onmessage = ({ data }) => {
          told.asked = location.href + document.referrer;
          if (data.hand) parent.postMessage({ wish: [0.01, "x", Infinity], score: 2, told }, "*");
        };</script>""")
    mine = yaml.safe_load((EXAMPLES / "butterfly.yaml").read_text())
    stolen = mine | {"name": "thief", "page": "thief.html"}
    (tmp_path / "games" / "thief.yaml").write_text(yaml.safe_dump(stolen))
    given = serving(own=tmp_path)
    page = open_page(given, "patient")
    page.evaluate("""() => addEventListener("message", ({ data }) => {
        if (data.told?.fetch) window.told = data.told;
    })""")

    def follow():
        wishes = [told["position"] for topic, told in given.robot.published if "wish" in topic]
        given.robot.hand = wishes[-1] | {"z": 0.18} if wishes else None

    given.state = PLAYS | {"protocol": "butterfly", "block": "quick", "since": 4.0}
    given.until(page, "document.body.dataset.shown === 'play'")
    wait_until(lambda: follow() or given.look() or scores(given) and scores(given)[-1] > 0.0)
    page.mouse.click(400, 300)
    page.keyboard.press("Space")
    wait_until(lambda: given.robot.calls == [("/therapy_session/pause_by_patient", {})])
    given.robot.published.clear()
    given.state = {**given.state, "protocol": "thief"}
    given.until(page, "window.told")
    told = page.evaluate("window.told")
    assert [told[each] for each in ("sessionStorage", "document", "own")] == ["SecurityError"] * 3
    assert told["fetch"] == "TypeError" and TOKENS["patient"] not in told["asked"]
    wish = ("/therapy/wish", {"position": {"x": 0.01, "y": None, "z": None}})
    wait_until(lambda: given.look() or wish in given.robot.published)
    assert scores(given) == []
    given.until_text(page, "The exercise has ended", state=4)
    assert page.locator("#game").count() == 0


def test_the_therapist_chooses_a_game_its_level_and_its_minutes(therapist, wait_until):
    given, page = therapist()
    page.get_by_role("button", name="New").click()
    page.get_by_label("Arm", exact=True).select_option("right")
    tick(page)
    level = page.get_by_label("Level", exact=True)
    assert not level.is_visible()
    page.get_by_label("Protocol", exact=True).select_option("fruit")
    level.select_option("far")
    page.get_by_label("Minutes", exact=True).fill("12")
    page.get_by_role("button", name="Start").click()
    wait_until(lambda: given.robot.calls[-1][0].endswith("/start"))
    asked = given.robot.calls[-1][1]
    chosen = [asked[each] for each in ("protocol", "level", "minutes")]
    assert chosen == ["fruit", "far", 12]
    runs = PLAYS | {"protocol": "fruit", "block": "near", "trials": 5}
    given.until_text(page, "Pick fruit. Running, near, minute 1 of 5: the patient plays", **runs)
    given.until(page, "document.querySelector('.minutes').value === '5'")
    assert level.input_value() == "near" and level.is_disabled()
    given.until_text(page, "minute 3 of 5", trial=3)
    for trial, score in ((1, 0.42), (2, None)):
        given.robot.tell("/therapy/trial", {
            "patient": "P-7K3QX", "protocol": "fruit", "trial": trial, "block": 1, "circuit": trial,
            "kind": "game", "reached": False, "duration": 58.0, "score": score,
        })  # fmt: skip
    given.until_text(page, "P-7K3QX: 2 min of play, score 42 %")


def test_a_plan_proposes_the_next_and_tells_the_minutes_left_and_ends_with_its_patient(therapist):
    given, page = therapist()
    protocol, field = page.get_by_label("Protocol", exact=True), page.get_by_label("Pseudonym of")
    field.fill("P-7K3QX")
    for name in ("elevator", "fruit"):
        protocol.select_option(name)
        if name == "fruit":
            page.get_by_label("Level", exact=True).select_option("far")
            page.get_by_label("Minutes", exact=True).fill("10")
        page.get_by_role("button", name="Add to the plan").click()
    assert protocol.input_value() == "elevator", "the first is proposed"
    minutes = round(expected(load_protocol("elevator")) / 60.0)
    planned = [each.split("\n")[0] for each in page.locator(".plan li").all_inner_texts()]
    assert planned == [
        f"Lifting and lowering, assisted as needed: {minutes} min", "Pick fruit, far: 10 min"
    ]  # fmt: skip
    given.until_text(page, f"About {minutes} min left, {minutes + 10} min with the plan.",
                     **RUNS | {"trials": 688})  # fmt: skip
    for trial in range(1, 6):  # each takes about 3 s: a state tells 50 ms
        given.state["trial"] = trial
        for _ in range(60):
            given.look()
            page.wait_for_timeout(20)
    told = re.search(r"About (\d+) min left, (\d+) min with", page.inner_text(".left"))
    assert 30 <= int(told[1]) <= 45 and int(told[2]) == int(told[1]) + 10
    given.until_text(page, "Finished", state=FINISHED)
    assert field.input_value() == "P-", "the next patient never starts under the last pseudonym"
    page.get_by_role("button", name="P-7K3QX, next: Pick fruit").click()
    assert (field.input_value(), protocol.input_value()) == ("P-7K3QX", "fruit")
    assert page.get_by_label("Level", exact=True).input_value() == "far"
    assert page.get_by_label("Minutes", exact=True).input_value() == "10"
    plays = PLAYS | {"protocol": "fruit", "trials": 10, "trial": 4, "since": 30.0}
    given.until_text(page, "About 7 min left.", **plays)
    page.get_by_role("button", name="Software stop")
    given.until_text(page, "Ended before its time", state=4)
    page.get_by_role("button", name="P-7K3QX again").wait_for()
    assert page.locator(".plan li").count() == 0
    page.get_by_role("button", name="Add to the plan").click()
    assert page.locator(".plan li").count() == 1
    page.get_by_role("button", name="Take Pick fruit out of the plan").click()
    assert page.locator(".plan li").count() == 0
    page.get_by_role("button", name="Add to the plan").click()
    page.reload()
    given.until_text(page, "The robot is ready")
    field.fill("P-7K3QX")
    assert page.locator(".plan li").count() == 1, "a page that was lost has not lost the plan"
    field.fill("P-22222")
    assert page.locator(".plan li").count() == 0, "a plan is one patient's"
    page.reload()
    assert page.locator(".plan li").count() == 0


OVERLAPS = """[...document.querySelectorAll('.plan li')].filter((each) => {
  const words = document.createRange();
  words.selectNodeContents(each.firstChild);
  const [text, button] = [words, each.lastChild].map((part) => part.getBoundingClientRect());
  return text.right > button.left || button.bottom > each.getBoundingClientRect().bottom + 1;
}).length"""


@pytest.mark.parametrize("size", [(1280, 720), (800, 1280), (1280, 800)])
def test_what_is_planned_stands_beside_its_buttons(therapist, size):
    _, page = therapist(size=size)
    for name in ("lift", "reach_3d", "fruit"):
        page.get_by_label("Protocol", exact=True).select_option(name)
        page.get_by_role("button", name="Add to the plan").click()
    assert page.evaluate(OVERLAPS) == 0
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


ABOUT = {
    "patient": "P-7K3QX", "side": "left", "sessions": 3, "protocol": "elevator", "level": "",
    "trials": 688, "support": 11.04, "duration": 1.2, "stiffness": 140.0,
}  # fmt: skip


@pytest.mark.parametrize("is_refused", [False, True])
def test_as_last_time_is_set_by_a_button_and_begins_with_start(therapist, wait_until, is_refused):
    given, page = therapist()
    page.route("**/record/P-7K3QX/patient", lambda route: route.fulfill(json={"about": ABOUT}))
    page.get_by_label("Pseudonym of the patient").fill("P-7K3QX")
    button = page.get_by_role("button", name="As last time")
    button.click()
    page.get_by_text("From Start on as last time: left arm, Lifting and lowering").wait_for()
    assert page.get_by_label("Arm", exact=True).input_value() == "left"
    protocol = page.get_by_label("Protocol", exact=True)
    assert protocol.input_value() == "elevator"
    tick(page)

    def called():
        names = ("start", "set_parameters")
        return [(name.rpartition("/")[2], asked) for name, asked in given.robot.calls
                if name.endswith(names)]  # fmt: skip

    assert called() == [], "nothing is started, and nothing pulls, before Start"
    given.robot.refuses_support = is_refused
    page.get_by_role("button", name="Start").click()
    wait_until(lambda: called()[-1:] and called()[-1][0] == ("start", "set_parameters")[is_refused])
    (name, asked), *more = called()
    value = {"type": 3, "double_value": 11.0}
    assert (name, asked["parameters"]) == (
        "set_parameters", [{"name": "support.force", "value": value}],
    )  # fmt: skip
    if is_refused:
        given.until_text(page, "more than 2 N over its weight")
        assert more == []
        return
    (_, started), = more
    assert (started["duration"], started["side_stiffness"]) == (1.2, 140.0)
    given.until_text(page, "Running", **RUNS)
    assert not button.is_visible()
    given.until_text(page, "Finished:", state=FINISHED)
    page.get_by_role("button", name="P-7K3QX again").click()
    page.get_by_text("Last time: left arm").wait_for()
    button.click()
    protocol.select_option("lift")
    page.get_by_label("Arm", exact=True).select_option("left")
    tick(page)
    page.get_by_role("button", name="Start").click()
    wait_until(lambda: len(called()) == 3)
    assert "duration" not in called()[-1][1], "time and walls are those of another protocol"


def test_a_free_text_does_not_get_into_the_field(therapist, wait_until):
    given, page = therapist()

    def starts():
        return [told for service, told in given.robot.calls if service.endswith("/start")]

    field = page.get_by_label("Pseudonym of the patient")
    field.fill("Erika Musterfrau")
    assert field.input_value() == "P-ERKAM"  # what a name leaves is no name
    field.fill("")
    start = page.get_by_role("button", name="Start")
    given.until_text(page, "A pseudonym like P-7K3QX is wanted")
    assert start.is_disabled()
    page.get_by_role("button", name="New").click()
    page.get_by_label("Arm", exact=True).select_option("right")
    tick(page)
    given.until(page, "!document.querySelector('.primary').disabled")
    start.click()
    wait_until(starts)
    (asked,) = starts()
    assert (asked["patient"], asked["record"]) == (field.input_value(), True)


def tick(page):
    """Tick all that is asked for before a session."""
    for box in page.locator(".checks input").all():
        box.check()


def test_start_stays_grey_with_what_is_missing_first(therapist, wait_until):
    given, page = therapist()
    start = page.get_by_role("button", name="Start")

    def lacks(words):
        given.until(page, f"document.querySelector('.missing').innerText.includes({words!r})")
        assert start.is_disabled()

    lacks("A pseudonym like P-7K3QX is wanted")
    page.get_by_role("button", name="New").click()
    lacks("Which arm is it?")
    page.get_by_label("Arm", exact=True).select_option("left")
    for box in ("Strap closed", "Emergency stop", "Arm rest", "Chair and handle", "Arm weighed"):
        lacks(f"To be ticked: {box}")
        page.get_by_label(box).check()
    given.until(page, "document.querySelector('.missing').innerText === ''")
    assert start.is_enabled()
    given.robot.axis["mode"] = 0
    assert start.is_enabled(), "of the plane"
    page.get_by_label("Protocol").last.select_option("elevator")
    lacks("Mode 0 gives no vertical force")
    given.robot.axis["mode"] = 3
    given.robot.off = True
    lacks("The robot is not ready")
    given.robot.off = False
    given.state = {"kind": "weigh", "phase": 2}
    lacks("An arm is being weighed")
    given.state = {}
    given.until(page, "document.querySelector('.missing').innerText === ''")
    start.click()
    wait_until(lambda: given.robot.calls[-1][0].endswith("/start"))
    asked = given.robot.calls[-1][1]
    assert (asked["checks"], asked["side"], asked["protocol"]) == (63, "left", "elevator")
    given.until_text(page, "Running", **RUNS)
    assert not page.locator(".checks").is_visible()
    given.until_text(page, "Finished", state=FINISHED)
    lacks("A pseudonym like P-7K3QX is wanted")
    assert not any(box.is_checked() for box in page.locator(".checks input").all())


@pytest.mark.parametrize("way", ["touch", "key"])
def test_the_patient_stops_by_touch_or_by_any_key(patient, wait_until, way):
    given, page = patient
    given.until_text(page, "Pick fruit")
    stop = page.get_by_role("button", name="Please stop")
    assert not stop.is_visible()
    page.keyboard.press("a")
    given.until_shown(page, "trial", 1, **RUNS)
    size = stop.bounding_box()
    assert size["width"] >= 150 and size["height"] >= 80
    if way == "touch":
        stop.click()
    else:
        page.keyboard.press("Space")
    wait_until(lambda: given.robot.calls)
    assert given.robot.calls == [("/therapy_session/pause_by_patient", {})]
    given.until_text(page, "As you asked", state=PAUSED, reason="the patient asked")
    assert not stop.is_visible()
    page.keyboard.press("a")
    assert len(given.robot.calls) == 1, "what is paused is not paused again"


def test_a_stop_that_nobody_hears_is_told_to_the_patient(patient):
    given, page = patient
    given.until_shown(page, "trial", 1, **RUNS)
    given.robot.refuses = True
    page.get_by_role("button", name="Please stop").click()
    given.until_text(page, "The robot does not hear it: tell your therapist")


def test_when_it_paused_is_told_in_local_time_with_its_zone(serving, browser):
    """A page that was opened later does not know when, and says nothing of it."""
    given = serving()
    pages = [browser.new_page(timezone_id="Asia/Kolkata")]
    pages[0].clock.install(time="2026-03-03T08:35:00Z")
    pages[0].goto(f"{given.server.address}/therapist#token={TOKENS['therapist']}")
    given.until_text(pages[0], "Running", **RUNS)
    pause = {"state": PAUSED, "reason": "the patient asked"}
    given.until_text(pages[0], "the patient asked, at 14:05 GMT+5:30.", **pause)
    pages.append(browser.new_page())
    pages[1].goto(f"{given.server.address}/therapist#token={TOKENS['therapist']}")
    given.until_text(pages[1], "the patient asked. It is")
    for page in pages:
        page.close()


def test_the_patients_screen_speaks_german(patient):
    given, page = patient
    given.until_text(page, "Pick fruit")
    page.get_by_role("button", name="Deutsch").click()
    given.until_text(page, "Obst pflücken")
    assert page.evaluate("document.documentElement.lang") == "de"
    page.reload()
    above = {"x": 0, "y": 0, "z": 0.3}
    given.until_text(page, "Den Aufzug hinauf zur Person", **RUNS, target=above)
    assert page.get_by_role("button", name="Bitte anhalten").is_visible()
    given.until_text(page, "Wie stark sind Ihre Schmerzen jetzt?", asks=1)
    given.until_text(page, "Weiter in 12 s", asks=0, state=PAUSED, rest=11.2)
    given.until_text(page, "Geschafft", state=FINISHED, rest=None)
    given.until_text(page, "Was machen wir?", state=0)
    page.get_by_role("button", name="English").click()
    given.until_text(page, "Pick fruit")


@pytest.mark.parametrize("size", [(1280, 720), (800, 1280), (1280, 800)])
def test_the_therapists_page_speaks_german_and_keeps_it(therapist, size):
    given, page = therapist(size=size)
    page.get_by_role("button", name="Deutsch").click()
    page.get_by_role("button", name="English").wait_for()  # it is loaded anew
    given.until_text(page, "Der Roboter ist bereit, das Drehmoment ist an.")
    assert page.evaluate("document.documentElement.lang") == "de"
    page.reload()
    given.until_text(page, "Drücken Sie Neu für ein Pseudonym")
    start = page.get_by_role("button", name="Start", exact=True)
    assert start.is_disabled() and "Ein Pseudonym wie P-7K3QX fehlt" in page.inner_text(".missing")
    if size[0] >= 1200:
        assert page.evaluate("document.documentElement.scrollHeight") == size[1]
    assert page.locator(".top").bounding_box()["height"] <= 170, "its sentence has its place"
    runs = "P-7K3QX: Heben und Senken, Hilfe nach Bedarf. Läuft, Bewegung 1 von"
    given.until_text(page, runs, **RUNS)
    given.until_text(page, "der Patient wollte es", state=PAUSED, reason="the patient asked")
    wide = page.evaluate("[document.body.scrollWidth, window.innerWidth]")
    assert wide[0] <= wide[1], "no sentence makes the page wider than the screen"
    page.get_by_role("button", name="English").click()
    page.get_by_role("button", name="Deutsch").wait_for()
    given.until_text(page, "The robot is ready, the torque is on.")


def test_a_german_therapist_reads_refusals_pauses_and_the_weighing_in_german(therapist):
    given, page = therapist()
    page.get_by_role("button", name="Deutsch").click()
    page.get_by_role("button", name="English").wait_for()  # it is loaded anew
    given.until_text(page, "Der Roboter ist bereit, das Drehmoment ist an.")
    given.robot.refuses = True
    given.robot.why = "an arm is being weighed: wait, or end that"
    page.get_by_role("button", name="Neu").click()
    page.get_by_label("Arm", exact=True).select_option("right")
    tick(page)
    given.look()
    page.get_by_role("button", name="Start", exact=True).click()
    given.until_text(page, "ein Arm wird gewogen: warten Sie, oder beenden Sie das")
    arm = "let it hang: near, 1 of 3"
    given.until_text(page, "Hängen lassen: nah, 1 von 3.", kind="weigh", phase=3, arm=arm)
    why = "the hand is 31 mm from the start of trial 4 after 8 s: free it, then resume"
    paused = {**RUNS, "state": PAUSED, "kind": "reach", "arm": "", "reason": why}
    given.until_text(page, "die Hand ist nach 8 s noch 31 mm vom Anfang der Bewegung 4", **paused)
    given.robot.reasons = ["encoder: no sample for 7.1 ms", "drive node 5 sent an emergency"]
    given.until_text(page, "Encoder: seit 7.1 ms keine Messung; drive node 5 sent an emergency.")


def test_the_page_says_why_an_arm_that_nothing_carries_fails(therapist):
    given, page = therapist()
    given.robot.hand = {"x": 0, "y": 0, "z": 0.021}
    sunk = "The arm has sunk to the bottom, and nothing carries it: pause, weigh the arm"
    given.until_text(page, sunk, **RUNS)
    given.until_text(page, "The robot is ready", support=12.0)
    given.until_text(page, sunk, support=0.0)
    given.until_text(page, "The robot is ready", protocol="clock_adaptive")


STARTING = 5


@pytest.mark.parametrize("size", [(1280, 720), (1024, 768), (390, 844)])
def test_the_patient_is_asked_and_answers_by_touch(patient, wait_until, size):
    given, page = patient
    page.set_viewport_size({"width": size[0], "height": size[1]})
    given.until_text(page, "How much pain do you feel now?", state=STARTING, asks=1)
    numbers = page.locator("#numbers button")
    assert numbers.all_inner_texts() == [str(value) for value in range(11)]
    for box in [each.bounding_box() for each in [*numbers.all(), page.locator("#stop")]]:
        assert box["width"] >= 40 and box["height"] >= 40
        assert 0 <= box["x"] and box["x"] + box["width"] <= size[0]
        assert 0 <= box["y"] and box["y"] + box["height"] <= size[1]
    page.get_by_role("button", name="7", exact=True).click()
    wait_until(lambda: given.robot.published)
    given.until(page, "document.querySelector('#numbers button').disabled")
    given.until_text(page, "How tired are you now?", asks=2)
    page.get_by_role("button", name="10", exact=True).click()
    wait_until(lambda: len(given.robot.published) == 2)
    assert given.robot.published == [
        ("/therapy/answer", {"data": 16 + 7}), ("/therapy/answer", {"data": 32 + 10}),
    ]  # fmt: skip
    given.until_shown(page, "trial", 1, **RUNS, asks=0)
    assert not page.locator("#ask").is_visible()


def test_the_therapist_is_asked_whether_to_go_on(therapist, wait_until):
    given, page = therapist()
    given.until_text(page, "The patient is asked for pain on his screen", state=STARTING, asks=1)
    resume = page.get_by_role("button", name="Resume")
    assert resume.is_enabled(), "who cannot answer is not waited for"
    told = "He tells pain 7 of 10, tiredness 2 of 10. Go on? Resume is yes, End session is no."
    given.until_text(page, told, asks=0, pain=7, tired=2, goes_on=1)
    resume.click()
    wait_until(lambda: ("/therapy_session/resume", {}) in given.robot.calls)
    given.until_text(page, "Running", **RUNS, goes_on=2)
    assert "Go on?" not in page.inner_text(".session")


def test_a_rest_counts_down_on_both_pages(therapist, open_page, wait_until):
    given, page = therapist()
    screen = open_page(given, "patient")
    given.until_text(page, "Running", **RUNS)
    page.get_by_role("button", name="Rest 1 min").click()
    wait_until(lambda: ("/therapy_session/rest", {}) in given.robot.calls)
    rests = {"state": PAUSED, "reason": "a rest"}
    for left in (60.0, 41.2):
        given.until_text(page, f"a rest, {math.ceil(left)} s left", **rests, rest=left)
        given.until_text(screen, f"It goes on in {math.ceil(left)} s")
    page.get_by_role("button", name="Pause").click()  # then it waits
    screen.get_by_role("button", name="Please stop").click()
    asked = {f"/therapy_session/{name}" for name in ("pause", "pause_by_patient")}
    wait_until(lambda: asked <= {service for service, _ in given.robot.calls})
    given.until_text(page, "the patient asked", reason="the patient asked", rest=None)
    assert page.get_by_role("button", name="Pause").is_disabled()


def test_the_therapist_hears_and_reads_in_the_tab_that_it_paused(therapist):
    given, page = therapist()
    page.evaluate("""() => { window.tones = 0;
      const make = AudioContext.prototype.createOscillator;
      AudioContext.prototype.createOscillator = function () {
        window.tones++;
        return make.call(this);
      };
    }""")
    page.get_by_text("Therapist's page").click()  # a browser sounds for whom it was touched by
    given.until(page, "document.title.includes('Running')", lambda: given.state.update(RUNS))
    own = "the therapist paused it"
    given.until_text(page, own, state=PAUSED, reason=own)
    assert page.evaluate("window.tones") == 0, "who has paused it knows it"
    given.until_text(page, "the arm pulls hard", reason="the arm pulls hard")
    given.until(page, "window.tones === 2 && document.title.includes('Paused')")
    page.get_by_role("button", name="Tones: on").click()
    given.until_text(page, "the patient asked", reason="the patient asked")
    given.until(page, "document.title.includes('Paused')")
    assert page.evaluate("window.tones") == 2


def test_the_patients_sound_is_switched_by_the_therapist(therapist, open_page, wait_until):
    given, page = therapist()
    screen = open_page(given, "patient")
    page.get_by_role("button", name="Patient's sound: off").click()
    wait_until(lambda: given.robot.values["/"].get("patient_sound") is True)
    given.until_text(screen, "Sound: on", sound=True)
    given.until_text(page, "Patient's sound: on")
    screen.get_by_role("button", name="Sound: on").click()
    given.until_text(screen, "Sound: off")


def test_a_screen_that_may_dim_says_so(serving, browser):
    given = serving()
    page = browser.new_page()
    page.add_init_script("delete Navigator.prototype.wakeLock")
    page.goto(f"{given.server.address}/therapist#token={TOKENS['therapist']}")
    given.until_text(page, "This screen may dim")
    page.close()


@pytest.mark.parametrize(("phase", "asked"), [
    (0, "Hands off the handle"), (2, "Your arm is strapped in"), (3, "Let your arm hang"),
])  # fmt: skip
def test_who_is_weighed_sees_what_is_asked_of_him(patient, phase, asked):
    given, page = patient
    given.until_text(page, "Pick fruit")
    given.until_text(page, asked, kind="weigh", phase=phase)
    assert not page.get_by_role("button", name="Pick fruit").is_visible()


def test_the_form_shows_the_session_that_runs(therapist):
    """A page that is opened in its midst must not offer another patient's pseudonym."""
    given, page = therapist()
    given.until_text(page, "A pseudonym like P-7K3QX is wanted")
    runs = {"protocol": "reach_3d", "patient": "P-ABCDE", "trial": 2, "trials": 9}
    given.until_text(page, "movement 2 of 9", **RUNS | runs)
    assert "is wanted" not in page.inner_text(".session")
    field, protocol = page.get_by_label("Pseudonym of the patient"), page.get_by_label("Protocol")
    assert (field.input_value(), protocol.last.input_value()) == ("P-ABCDE", "reach_3d")
    assert field.is_disabled() and protocol.last.is_disabled()
    given.until_text(page, "Finished:", state=FINISHED)
    assert field.is_enabled() and field.input_value() == "P-"  # the next patient's is wanted
    page.get_by_role("button", name="P-ABCDE again").click()
    assert field.input_value() == "P-ABCDE"


def test_a_stop_that_is_told_after_the_pause_takes_the_resume_away(therapist):
    """The topics come in any order; a button that contradicts the sentence is pressed in vain."""
    given, page = therapist()
    given.until_text(page, "Paused, movement", state=PAUSED, reason="the therapist paused it")
    resume = page.get_by_role("button", name="Resume")
    assert resume.is_enabled()
    given.robot.tell("/safety_state", {"level": 2, "reasons": ["emergency stop"]})
    page.get_by_text("The robot has stopped").wait_for()
    assert resume.is_disabled()


def test_two_robots_on_one_page(therapist, open_page, wait_until):
    given, page = therapist("/left", "/right", size=(1400, 900))
    given.until_text(page, "Robot right", **RUNS)
    right = page.locator("#robot-right")
    right.get_by_role("button", name="Software stop").click()
    right.get_by_role("button", name="Pause").click()

    def asked():
        return [service for service, *_ in given.robot.calls if "parameters" not in service]

    wait_until(lambda: len(asked()) >= 2)
    assert asked() == ["/right/supervisor/estop", "/right/therapy_session/pause"]
    attended = {"/left/therapy/attendance", "/right/therapy/attendance"}
    wait_until(lambda: {topic for topic, _ in given.robot.published} == attended)
    screen = open_page(given, "patient", "?robot=/right")
    given.until_shown(screen, "shown", "vertical")


def test_the_arm_is_weighed_supported_and_lowered(therapist):
    given, page = therapist()
    page.get_by_label("Pseudonym of the patient").fill("P-7K3QX")
    page.get_by_label("Arm", exact=True).select_option("left")
    page.get_by_role("button", name="Weigh the arm").click()
    weighing = {"kind": "weigh", "arm": "strap the arm in and lay it down"}
    given.until_text(page, "Strap the arm in", **weighing, phase=2)
    assert page.get_by_role("button", name="Strapped in: go on").is_visible()
    given.until_text(page, "End the weighing", phase=3)
    given.until_text(page, "at most 15.0 N: the arm is not weighed")
    given.robot.axis = {"support": 9.2, "support_limit": 25.0, "hand_off": False}
    given.until_text(
        page, "In use 9.2 N, at most 20.4 N", kind="", arm="", arm_weight=18.4, arm_spread=1.2
    )
    slider = page.get_by_label("Support of the arm")
    slider.fill("11.04")
    given.until(page, "document.body.innerText.includes('11.0 N, 60 %')")
    page.get_by_role("button", name="Lower the arm").click()
    calls = given.robot.calls
    given.until(page, "true", lambda: calls[-1][0].endswith("lower") or page.wait_for_timeout(50))
    asked = {"patient": "P-7K3QX", "side": "left"}
    assert [call for call in calls if "weigh" in call[0]] == [("/therapy_session/weigh", asked)]
    assert given.robot.values["/"]["support.force"] == pytest.approx(11.04)
    assert ("/therapy_session/lower", {}) in calls


def test_a_slider_taken_again_stays_in_the_hand_when_the_last_answer_comes(therapist):
    given, page = therapist()
    given.until_text(page, "In use 0.0 N", arm_weight=18.4, arm_spread=1.2)
    given.robot.refuses_support = True
    page.get_by_label("Support of the arm").evaluate("""slider => {
      const to = (value, ...events) => {
        slider.value = value;
        events.forEach((name) => slider.dispatchEvent(new Event(name)));
      };
      to("9.2", "input", "change");
      to("12.88", "input");
    }""")
    given.until_text(page, "more than 2 N over its weight")
    given.robot.axis["support"] = 0.1
    given.until_text(page, "In use 0.1 N")
    assert float(page.get_by_label("Support of the arm").input_value()) == pytest.approx(12.88)


@pytest.mark.parametrize(("brakes", "told"), [
    (True, "the arm sinks, then falls"), (False, "the arm falls"),
])  # fmt: skip
def test_each_button_says_what_happens_to_the_arm(therapist, brakes, told):
    given, page = therapist()
    given.robot.brakes = brakes
    given.until_text(page, f"torque off: {told}", **RUNS)
    pause = page.get_by_role("button", name="Pause")
    assert "walls go, the arm stays carried" in pause.inner_text()
    lower = page.get_by_role("button", name="Lower the arm")
    assert "slowly down, then let go" in lower.inner_text()


def test_limits_are_set_within_the_nodes_bounds(therapist):
    given, page = therapist()
    slider = page.get_by_label("Workspace, greatest height")
    given.until(page, "document.querySelectorAll('.limits .limit').length === 6")
    assert slider.get_attribute("max") == "0.36"
    slider.fill("0.252")
    given.until_text(page, "Workspace, greatest height: set.")
    assert given.robot.values["/"]["wish.high"] == pytest.approx(0.252)


def test_pages_connect_again_by_themselves(therapist, open_page):
    given, page = therapist()
    screen = open_page(given, "patient")
    given.until_text(screen, "Pick fruit")
    start_again = given.restart()
    page.get_by_text("The connection is lost").wait_for()
    screen.get_by_role("heading", name="One moment").wait_for()
    start_again()
    given.until_shown(page, "open", "true")
    given.until_text(page, "The robot is ready")
    given.until_text(screen, "Pick fruit")


def test_results_come_into_the_table(therapist):
    given, page = therapist()
    given.until_text(page, "No movement yet.")
    for trial in range(1, 6):
        given.robot.finish(trial)
        given.until(page, f"document.querySelectorAll('.results tbody tr').length === {trial}")
    given.until_text(page, "P-7K3QX: 4 of 5 targets reached")
    titles = page.locator(".results th").all_inner_texts()
    assert titles == [
        "#", "Reached", "Duration [s]", "Peak speed [mm/s]", "Path error [mm]", "SPARC",
        "Robot's share of the work [%]",
    ]  # fmt: skip
    cells = page.locator(".results tbody tr").first.locator("td").all_inner_texts()
    assert cells == ["5", "– no", "1.20", "210", "3.1", "-1.52", "–"]
    page.reload()
    given.until_text(page, "P-7K3QX: 4 of 5 targets reached")
    given.robot.finish(6)
    given.until_text(page, "P-7K3QX: 5 of 6 targets reached")


LIVE = {**RUNS, "trial": 41, "trials": 1024}


@pytest.mark.parametrize(("state", "safety", "word"), [
    (LIVE, 0, "Running"),
    ({**LIVE, "state": PAUSED, "reason": "the therapist paused it"}, 0, "Paused"),
    ({**LIVE, "state": PAUSED, "reason": "the vertical torque is off"}, 2, "Stopped"),
    ({**LIVE, "state": FINISHED, "trial": 1024}, 0, "Finished"),
], ids=["live", "paused", "stopped", "finished"])  # fmt: skip
def test_a_session_is_seen_on_one_screen(therapist, state, safety, word):
    given, page = therapist(size=(1280, 720))
    for trial in range(1, 42):
        given.robot.finish(trial)
    why = "less time, as the hand led (metric +0.100); softer side walls, as it kept to the line"
    given.robot.tell("/therapy/assistance", {
        "block": 1, "circuit": 1, "duration": 1.35, "side_stiffness": 90.0, "reason": why,
    })  # fmt: skip
    given.until_text(page, why, **state)
    given.robot.tell("/safety_state", {"level": safety, "reasons": ["emergency stop"]})
    page.get_by_text(word, exact=False).and_(page.locator(".badge")).wait_for()
    last = ".results tbody tr >> nth=9"
    for seen in (".stop", ".session", ".hand", ".traces", last, ".changes li"):
        box = page.locator(seen).first.bounding_box()
        assert box["y"] >= 0 and box["y"] + box["height"] <= 720, seen
    assert page.evaluate("document.documentElement.scrollHeight") == 720
    now = "Now: 1.40 s a movement, side walls 100 N/m"
    assert (now in page.inner_text(".results")) == (word != "Finished")


def test_traces_are_told_apart_without_colour(therapist):
    given, page = therapist()
    given.until_text(page, "Position [cm]")
    given.until_text(page, "Force of the patient on the robot [N]")
    keys = page.evaluate(
        "[...document.querySelectorAll('.keys span')].map((each) =>"
        " [each.innerText, getComputedStyle(each, '::before').borderTopStyle])"
    )
    assert keys == [["x right", "solid"], ["y away", "dashed"], ["z up", "dotted"]]


@pytest.mark.parametrize("size", [(390, 844), (1180, 820), (1920, 1080), (3840, 2160)])
@pytest.mark.parametrize("robots", [("/",), ("/left", "/right")], ids=["one", "two"])
def test_every_column_of_the_movements_is_seen(therapist, size, robots):
    given, page = therapist(*robots, size=size)
    given.robot.finish(1000)
    given.until(page, f"document.querySelectorAll('.results tbody tr').length === {len(robots)}")
    hidden = "[...document.querySelectorAll('.scroll')].map((e) => e.scrollWidth - e.clientWidth)"
    assert page.evaluate(hidden) == [0] * len(robots)


@pytest.mark.parametrize("size", [(390, 844), (820, 1180), (3840, 2160)])
def test_nothing_sticks_out_of_the_screen(therapist, open_page, size):
    given, page = therapist(size=size)
    screen = open_page(given, "patient", size=size)
    given.until_text(screen, "Pick fruit")
    for each in (page, screen):
        assert each.evaluate("document.documentElement.scrollWidth <= innerWidth")
        small = each.evaluate(
            "[...document.querySelectorAll('button')].filter((b) => b.offsetParent)"
            ".filter((b) => b.offsetHeight < 40 || b.offsetWidth < 40).map((b) => b.innerText)"
        )
        assert small == []
    stop = page.get_by_role("button", name="Software stop")
    assert stop.is_visible()
    page.mouse.wheel(0, 5000)
    box = stop.bounding_box()
    assert 0 <= box["y"] and box["y"] + box["height"] <= size[1]  # wherever one has scrolled to


DRAWN = """(() => {
  const canvas = document.querySelector('.machine canvas');
  const { data } = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height);
  return [canvas.clientHeight, data.filter((value, i) => i % 4 === 3 && value > 0).length];
})()"""


@pytest.mark.parametrize("size", [(820, 1180), (1920, 1080)])
def test_the_robot_is_drawn_and_moves_with_the_hand(therapist, size):
    """Its card keeps its size while it is drawn, and stays away where movements need the place."""
    given, page = therapist(size=size)
    given.until(page, f"{DRAWN}[1] > 2000")
    height, _ = page.evaluate(DRAWN)
    page.evaluate("window.first = document.querySelector('.machine canvas').toDataURL()")
    given.until(page, "document.querySelector('.machine canvas').toDataURL() !== window.first")
    assert page.evaluate(DRAWN)[0] == height
    page.set_viewport_size({"width": 1280, "height": 720})
    assert not page.locator(".machine").is_visible()
