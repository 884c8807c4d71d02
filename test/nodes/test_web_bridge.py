# SPDX-License-Identifier: Apache-2.0
"""Pages at the running graph: by websocket and, where there is Chromium, in a real browser."""

from __future__ import annotations

import asyncio
import contextlib
import math

import pytest
from bridge_stage import MOVEMENTS, PATIENT, PROTOCOL, Page, Stage, stopped
from browser_pages import DEADLINE_MS, opened, start_on
from screw_module_msgs.msg import TherapyState

pytestmark = [pytest.mark.graph, pytest.mark.long]

IDLE, RUNNING, PAUSED = TherapyState.IDLE, TherapyState.RUNNING, TherapyState.PAUSED
SILENT = "the therapist's page has been silent for 2 s"
BOUNDS = {"x": (-0.15, 0.15), "y": (-0.15, 0.15), "z": (0.03, 0.33)}


@pytest.fixture(scope="module")
def stage(tmp_path_factory):
    with Stage(tmp_path_factory.mktemp("therapy")) as stage:
        yield stage


def run(coroutine):
    return asyncio.run(asyncio.wait_for(coroutine, DEADLINE_MS * 1e-3))


@pytest.fixture
def nobody_plays(stage):
    """The patient rests: each movement lasts until it is given up, so no session ends by itself."""
    stage.play(False)
    yield
    stage.play(True)


@contextlib.asynccontextmanager
async def attending(page):
    """Attend a session, as the therapist's page does twice a second."""
    async def go_on():
        while True:
            await page.attend()
            await asyncio.sleep(0.3)

    task = asyncio.create_task(go_on())
    try:
        yield
    finally:
        task.cancel()


@contextlib.asynccontextmanager
async def reading(page):
    """Read what comes, as a browser does: the server's pings are answered in between."""
    task = asyncio.create_task(page.until(lambda message: False))
    try:
        yield
    finally:
        task.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await task


async def state_of(stage, page, *wanted):
    """Wait until the session says so."""
    async with reading(page):
        await elsewhere(stage.wait_for_state, *wanted)


async def elsewhere(function, *given):
    """Call what blocks without keeping the page from attending."""
    return await asyncio.get_running_loop().run_in_executor(None, function, *given)


def therapist(stage):
    return Page(stage.address, stage.tokens["therapist"])


def start(page):
    return page.call(
        "/therapy_session/start", protocol=PROTOCOL, patient=PATIENT, record=False
    )


async def resume(page):
    """Resume, as soon as a bridge that was just started has found the session."""
    while True:
        answer = await page.call("/therapy_session/resume")
        if answer["result"]:
            assert answer["values"]["success"], answer
            return
        assert "nobody offers" in answer["values"]


@pytest.mark.usefixtures("nobody_plays")
def test_the_hand_is_seen_and_a_wish_is_bounded(stage):
    async def play():
        async with Page(stage.address, stage.tokens["patient"]) as page:
            await page.send(op="subscribe", topic="/endpoint_state", throttle_rate=50)
            seen = await page.until(lambda m: m["op"] == "publish" and all(m["msg"]["valid"]))
            await page.send(op="publish", topic="/setpoint", msg={"position": {"x": 0.1}})
            refused = await page.until(lambda message: message["op"] == "status")
            wish = {"position": {"x": 5.0, "y": -5.0, "z": 5.0}}
            # The session may hear of the hand after the page; until then it asks for no point.
            while not (stage.setpoints and math.isfinite(stage.setpoints[-1].position.x)):
                await page.send(op="publish", topic="/therapy/wish", msg=wish)
                await asyncio.sleep(0.02)
            stage.setpoints.clear()
            while len(stage.setpoints) < 20:
                await page.send(op="publish", topic="/therapy/wish", msg=wish)
                await asyncio.sleep(0.02)
            return seen["msg"], refused["msg"]

    endpoint, refused = run(play())
    wished = stage.setpoints[-1].position
    stage.ask(lambda robot: robot.wait_until(
        lambda: abs(stage.setpoints[-1].position.x - wished.x) > 1e-3, 20.0,
        "nobody lets the hand go once the game is silent"))  # fmt: skip
    assert 0.1 < endpoint["position"]["z"] < 0.3
    assert "nobody publishes set points" in refused
    *asked, released = stage.setpoints
    assert abs(released.position.x) < 0.15  # where the hand is: the spring pulls no more
    for setpoint in asked:
        for axis, (low, high) in BOUNDS.items():
            assert low <= getattr(setpoint.position, axis) <= high
    steps = [abs(b.position.x - a.position.x)
             for a, b in zip(asked, asked[1:], strict=False)]  # fmt: skip
    assert max(steps) <= 0.3 * 0.2 + 1e-9  # the speed allowed, over the longest time that counts


@pytest.mark.usefixtures("nobody_plays")
def test_a_lost_bridge_pauses_the_session_and_so_does_a_silent_page(stage, kill_9):
    async def before():
        async with therapist(stage) as page, attending(page):
            answer = await start(page)
            assert answer["values"] == {"success": True, "message": ""}, answer
            await state_of(stage, page, RUNNING)
            await elsewhere(kill_9, stage.bridge.pid)

    with contextlib.suppress(ConnectionError):
        run(before())
    stage.wait_for_state(PAUSED, SILENT)
    tokens = stage.tokens
    stage.restart_bridge()
    assert stage.tokens == tokens

    async def after():
        async with therapist(stage) as page:
            async with attending(page):
                await resume(page)
                await state_of(stage, page, RUNNING)
            await state_of(stage, page, PAUSED, SILENT)  # the connection is still there
            return await page.call("/therapy_session/abort")

    assert run(after())["values"]["success"]


@pytest.mark.usefixtures("nobody_plays")
def test_who_starts_a_session_from_a_page_attends_it(stage):
    """Lost before its first attendance, such a page was never missed."""
    async def play():
        async with therapist(stage) as page:
            answer = await start(page)
            assert answer["values"] == {"success": True, "message": ""}, answer
            await state_of(stage, page, PAUSED, SILENT)
            return await page.call("/therapy_session/abort")

    assert run(play())["values"]["success"]


def test_names_are_refused_and_limits_are_the_nodes(stage):
    async def ask():
        async with therapist(stage) as page:
            name = await page.call("/therapy_session/start", protocol=PROTOCOL, patient="Erika M.")
            parameters = [{"name": "wish.high", "value": {"type": 3, "double_value": 0.9}}]
            high = await page.call("/therapy_session/set_parameters", parameters=parameters)
            parameters[0]["value"]["double_value"] = 0.30
            good = await page.call("/therapy_session/set_parameters", parameters=parameters)
            parameters[0]["value"]["double_value"] = 0.33
            await page.call("/therapy_session/set_parameters", parameters=parameters)
            return name["values"], high["values"]["results"][0], good["values"]["results"][0]

    name, high, good = run(ask())
    assert not name["success"] and "not a pseudonym" in name["message"]
    assert "Erika" not in name["message"]
    assert not high["successful"] and "wish.high" in high["reason"]
    assert good["successful"]


# In a real browser -------------------------------------------------------------------------


def open_page(browser, stage, role, errors):
    return opened(
        browser, stage.page_of(role), errors, (640, 480), lambda said: said.type == "error"
    )


def test_a_therapist_and_a_patient_in_their_browsers(stage, browser):
    errors = []
    page = open_page(browser, stage, "therapist", errors)
    page.get_by_text("The robot is ready, the torque is on.").wait_for()
    assert page.evaluate("location.hash") == ""  # the token stands in no address bar
    start_on(page, PROTOCOL)

    # A reload in the midst of the movements: the session goes on, no result is lost.
    rows = page.locator(".results tbody tr")
    rows.nth(2).wait_for()
    page.reload()
    rows.nth(MOVEMENTS - 4).wait_for()
    screen = open_page(browser, stage, "patient", errors)
    screen.get_by_role("heading", name="Finished. Thank you!").wait_for()
    page.get_by_text(f"Finished: Quick clock, {MOVEMENTS} movements.").wait_for()
    cells = page.locator(".results tbody td:first-child").all_inner_texts()
    assert [int(text) for text in cells] == list(range(MOVEMENTS, 0, -1))
    assert page.get_by_text(f"of {MOVEMENTS} targets reached").count() == 1

    # The software stop stops.
    start_on(page, PROTOCOL)
    page.get_by_text(f"movement 1 of {MOVEMENTS}").wait_for()
    page.get_by_role("button", name="Software stop (not the emergency stop)").click()
    stage.ask(lambda robot: robot.wait_until(lambda: stopped(robot), 10.0, "nothing stops"))
    page.get_by_text("Paused, movement").wait_for()
    page.get_by_text("The robot has stopped: the software stop was asked for").wait_for()
    assert page.get_by_role("button", name="Resume").is_disabled()  # only an operator resets
    screen.get_by_role("heading", name="The robot has stopped").wait_for()
    stage.switch_on()
    page.get_by_role("button", name="Resume").click()
    page.get_by_text("Running, movement").wait_for()

    # A tab that is closed pauses the session.
    page.close()
    stage.wait_for_state(PAUSED, SILENT)
    page = open_page(browser, stage, "therapist", errors)
    page.get_by_role("button", name="End session").click()
    page.get_by_text("Ended before its time").wait_for()
    assert errors == []
    page.close()
    screen.close()


def test_a_page_with_the_wrong_token_says_so(stage, browser):
    page = browser.new_page()
    page.goto(f"{stage.address}/therapist#token=wrong")
    page.get_by_text("Not let in: wrong token").wait_for(timeout=DEADLINE_MS)
    page.goto(f"{stage.address}/therapist#token={stage.tokens['patient']}")
    page.reload()
    said = page.get_by_text("This token is the patient's")
    said.wait_for(timeout=DEADLINE_MS)
    assert said.is_visible()
    page.close()
