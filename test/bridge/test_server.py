# SPDX-License-Identifier: Apache-2.0
"""The real server attacked over real sockets; the robot behind it is a fake."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import re
import socket
import ssl
import subprocess
import threading
import weakref
from types import SimpleNamespace

import aiohttp
import pytest
from fake_gateway import CONFIG, TOKENS, Served, make_server

from screw_module_ros.bridge import listener
from screw_module_ros.bridge.client import Client
from screw_module_ros.bridge.pages import FOLDER
from screw_module_ros.bridge.server import Connection
from screw_module_ros.bridge.settings import Limits

PATIENT, THERAPIST = TOKENS["patient"], TOKENS["therapist"]
DEADLINE_S = 20.0
CLOSED = (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED, aiohttp.WSMsgType.ERROR)


@pytest.fixture
def said():
    """What the server has logged."""
    return []


@pytest.fixture
def server(gateway, said):
    made = make_server(gateway, limits=Limits(clients=4, patience=0.3), log=said.append)
    with Served(made) as server:
        yield server


@pytest.fixture
def run():
    """Return what runs a coroutine in the test's one event loop, DEADLINE_S at most."""
    loop = asyncio.new_event_loop()
    yield lambda coroutine: loop.run_until_complete(asyncio.wait_for(coroutine, DEADLINE_S))
    loop.close()


@pytest.fixture
def connect(run):
    """Return what opens a page of a server, and subscribes it to a topic."""
    sessions = []

    async def opened(server, token, topic, **options):
        sessions.append(aiohttp.ClientSession())
        page = await sessions[-1].ws_connect(f"{server.address}/ws?token={token}", **options)
        if topic:
            await page.send_json({"op": "subscribe", "topic": topic})
        return page

    yield lambda server, token=PATIENT, topic="", **more: run(opened(server, token, topic, **more))
    for session in sessions:
        run(session.close())


@pytest.fixture
def ask(run):
    """Return what asks a server for a path: status, text and headers of the answer."""

    async def asked(server, path, token=None, **headers):
        if token:
            headers["Authorization"] = f"Bearer {token}"
        async with aiohttp.ClientSession() as session:
            async with session.get(server.address + path, headers=headers) as response:
                return response.status, await response.text(), response.headers

    return lambda *given, **headers: run(asked(*given, **headers))


@pytest.fixture
def until(run):
    """Return what waits until a condition holds."""

    async def waited(condition):
        while not condition():
            await asyncio.sleep(0.01)

    return lambda condition: run(waited(condition))


async def answers(page, *texts):
    """Send texts; return what comes until the connection ends."""
    for text in texts:
        await page.send_str(text)
    return [message.data async for message in page]


# Who is let in -----------------------------------------------------------------------------


@pytest.mark.parametrize(("token", "headers"), [
    ("", {}),
    ("x" * 32, {}),
    (THERAPIST, {"Origin": "http://evil.example"}),
    (THERAPIST, {"Origin": "null"}),
    (THERAPIST, {"Host": "evil.example"}),
    (THERAPIST, {"Host": "evil.example:80", "Origin": "http://evil.example:80"}),
])  # fmt: skip
def test_strangers_are_refused(server, connect, token, headers):
    with pytest.raises(aiohttp.WSServerHandshakeError) as error:
        connect(server, token, headers=headers)
    assert (error.value.status, server.clients, server.refused) == (403, 0, 1)


@pytest.mark.parametrize("path", ["/", "/patient", "/therapist", "/static/js/link.js"])
def test_pages_come_with_the_headers_that_keep_them_apart(server, ask, path):
    status, _, headers = ask(server, path)
    assert status == 200
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Referrer-Policy"] == "no-referrer"
    assert headers["Connection"] == "close"


def test_a_games_page_is_of_no_origin_and_reaches_nobody(gateway, run, ask, tmp_path):
    """It is shown within the patient's screen: of its origin, it could read the token there."""
    (tmp_path / "mine.html").write_text("<!doctype html>")
    config = CONFIG | {"protocols": [{"origin": "https://games.example"}, {"origin": ""}, {}]}
    with Served(make_server(gateway, config=config, games=tmp_path)) as server:
        status, _, headers = ask(server, "/games/mine.html")
        policy = headers["Content-Security-Policy"]
        assert status == 200 and policy.startswith("sandbox allow-scripts; default-src 'none'")
        assert "connect-src" not in policy and "allow-same-origin" not in policy
        _, _, headers = ask(server, "/patient")
        allowed = headers["Content-Security-Policy"]
        assert allowed.endswith("frame-src 'self' https://games.example")
        assert ask(server, "/games/../server.py")[0] == 404 and ask(server, "/games/")[0] == 403


@pytest.mark.parametrize(("path", "headers"), [
    ("/patient", {"Host": "evil.example"}), ("/patient", {"Origin": "http://evil.example"}),
    ("/config.json", {}), ("/ws", {}), ("/ws?token=", {}),
])  # fmt: skip
def test_strangers_get_no_page(server, ask, path, headers):
    assert ask(server, path, **headers)[0] == 403


@pytest.mark.parametrize("path", [
    "/static/../server.py", "/static/%2e%2e/%2e%2e/server.py", "/static//etc/passwd", "/static/",
    "/static/js", "/tokens.json",
])  # fmt: skip
def test_nothing_but_the_pages_is_served(server, ask, path):
    status, text, _ = ask(server, path)
    assert status in (403, 404)
    assert "class Server" not in text and "root:" not in text


@pytest.mark.parametrize(("token", "allowed", "role", "wishes"), [
    (PATIENT, False, "patient", False), (PATIENT, True, "patient", True),
    (THERAPIST, False, "therapist", True),
])  # fmt: skip
def test_the_configuration_is_told_to_a_token(server, ask, token, allowed, role, wishes):
    server._rights.wishes = allowed
    status, text, _ = ask(server, "/config.json", token)
    assert (status, json.loads(text)) == (200, {**CONFIG, "role": role, "wishes": wishes})


@pytest.mark.parametrize(("allowed", "patients"), [(1, 1), (2, 1), (3, 1), (4, 2)])
def test_one_patient_gets_in_however_few_are_allowed(gateway, allowed, patients):
    server = make_server(gateway, limits=Limits(clients=allowed))
    assert (server._room_for("patient"), server._room_for("therapist")) == (patients, allowed)


def test_no_more_clients_than_allowed_and_room_for_therapists(server, connect):
    pages = []
    for token in (PATIENT, THERAPIST):
        pages += [connect(server, token) for _ in range(2)]
        with pytest.raises(aiohttp.WSServerHandshakeError) as error:
            connect(server, token)
        assert error.value.status == 503
    assert [page.closed for page in pages] == [False] * 4


def test_it_listens_on_this_machine_alone(server):
    assert server.address.startswith("http://127.0.0.1:")
    port = int(server.address.rpartition(":")[2])
    with socket.socket() as probe:  # all of 127/8 is this machine; we listen on one address of it
        assert probe.connect_ex(("127.0.0.2", port)) != 0


@pytest.mark.parametrize(("listens_at", "shown"), [("", "127.0.0.1"), ("localhost", "localhost")])
def test_the_address_of_the_pages_is_one_that_a_browser_can_open(gateway, listens_at, shown):
    with Served(make_server(gateway, address=listens_at)) as server:
        assert server.address.startswith(f"http://{shown}:")


# What clients cost -------------------------------------------------------------------------


def test_a_subscription_brings_samples(server, gateway, run, connect):
    page = connect(server, topic="/endpoint_state")
    for number in range(3):
        gateway.tell("/endpoint_state", {"number": number})
        assert run(page.receive_json())["msg"]["number"] == number


def test_a_flooding_client_is_cut_off_with_a_sentence(server, gateway, run, connect):
    page = connect(server, THERAPIST)
    message = '{"op":"publish","topic":"/therapy/attendance","msg":{}}'
    told = run(answers(page, *[message] * 2000))
    assert "messages a second" in json.loads(told[-1])["msg"]
    assert page.close_code == 1008
    assert len(gateway.published) < 300


@pytest.mark.parametrize("payload", ["x" * 20_000, "[" * 20_000])
def test_a_message_too_large_ends_the_connection(server, said, run, connect, until, payload):
    page = connect(server, THERAPIST)
    run(answers(page, payload))
    assert page.close_code == 1009
    until(lambda: said)
    assert said == [
        "cut off a therapist's page: a message had more than the 16384 bytes that are allowed"
    ]


def test_binary_messages_are_refused(server, run, connect):
    page = connect(server, THERAPIST)
    run(page.send_bytes(b"\0"))
    assert "JSON texts are wanted" in run(page.receive_json())["msg"]


def slow_client(address, topic):
    """Return a socket that has subscribed and reads nothing more."""
    host, _, port = address.removeprefix("http://").rpartition(":")
    sleeper = socket.socket()
    sleeper.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    sleeper.connect((host, int(port)))
    sleeper.sendall((
        f"GET /ws?token={PATIENT} HTTP/1.1\r\nHost: {host}:{port}\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
        "Sec-WebSocket-Version: 13\r\n\r\n"
    ).encode())  # fmt: skip
    assert b"101" in sleeper.recv(64)
    payload = json.dumps({"op": "subscribe", "topic": topic}).encode()
    sleeper.sendall(bytes([0x81, 0x80 | len(payload), 0, 0, 0, 0]) + payload)  # mask of zeros
    return sleeper


def test_a_slow_client_holds_nobody_up_and_is_cut_off(server, gateway, run, connect):
    sleeper = slow_client(server.address, "/endpoint_state")
    page = connect(server, topic="/endpoint_state")
    large = "x" * 100_000

    async def play():
        got = 0
        while server.clients > 1:
            gateway.tell("/endpoint_state", {"large": large})
            with contextlib.suppress(asyncio.TimeoutError):
                await page.receive(timeout=0.05)
                got += 1
        return got

    assert run(play()) > 10  # the other one went on meanwhile
    assert server.cut_off == 1
    sleeper.close()


def test_an_error_while_sending_closes_the_page(server, gateway, said, run, connect):
    """Without news a page would show a robot at rest."""
    gateway.after = lambda topic, number: 1 / 0
    page = connect(server, topic="/endpoint_state")
    assert run(page.receive()).type in CLOSED
    assert said == ["cut off a patient's page: ZeroDivisionError: division by zero"]


def test_an_error_of_asyncio_is_told_without_its_text(server, gateway, said, until):
    """The text may quote a request, and so hold a token. Each turn polls the robots."""
    def poll():
        if not said:
            context = {"message": "Task failed", "exception": ValueError(THERAPIST)}
            asyncio.get_running_loop().call_exception_handler(context)

    gateway.poll = poll
    until(lambda: said)
    assert said == ["Task failed: ValueError"]


def test_nothing_is_left_of_clients_that_came_and_went(
    server, gateway, run, connect, until, monkeypatch
):
    made = weakref.WeakSet()
    original = Client.__init__

    def init(self, *args, **kwargs):
        original(self, *args, **kwargs)
        made.add(self)

    monkeypatch.setattr(Client, "__init__", init)
    for _ in range(60):
        page = connect(server, THERAPIST, "/endpoint_state")
        run(page.send_json({"op": "call_service", "service": "/supervisor/estop"}))
        gateway.tell("/endpoint_state", {})
        run(page.receive_json())
        page._response.connection.transport.abort()  # a tab that is gone
    until(lambda: server.clients == 0)
    assert len(gateway.calls) == 60, "a stop is carried out, also if its page has gone"
    for *_, answer in gateway.calls:  # the robot has answered, or given up
        answer.get_loop().call_soon_threadsafe(answer.set_result, {"success": True})
    until(lambda: all(answer.done() for *_, answer in gateway.calls))
    gateway.calls.clear()
    for _ in range(3):
        gc.collect()
    assert len(made) == 0
    assert sum(type(each) is Connection for each in gc.get_objects()) == 0


def test_closing_ends_connections(gateway, run, connect, until):
    served = Served(make_server(gateway))
    with served as server:
        page = connect(server)
        until(lambda: server.clients == 1)
        run(asyncio.to_thread(served.__exit__))
        assert run(page.receive()).type in CLOSED
    assert not [thread for thread in threading.enumerate() if thread.name == "bridge"]


# Who makes no request ----------------------------------------------------------------------


def half_open(server, sends=b"GET / HTTP/1.1\r\nHost: "):
    """Return a socket that has sent the beginning of a request."""
    host, _, port = server.address.partition("://")[2].rpartition(":")
    opened = socket.create_connection((host, int(port)), timeout=DEADLINE_S)
    opened.sendall(sends)
    return opened


def until_closed(opened):
    """Read what comes until the server has closed it."""
    with contextlib.suppress(ConnectionError):
        while opened.recv(64):
            pass


@pytest.fixture
def crowded(until, said, monkeypatch):
    """Return what opens 40 connections where 8 are allowed; the oldest go, not by time."""
    monkeypatch.setattr(listener, "_MOST_OPENING", 8)
    monkeypatch.setattr(listener, "_OPENING_S", 10 * DEADLINE_S)
    waiting = []

    def crowd(server, *sends):
        waiting.extend(half_open(server, *sends) for _ in range(40))
        for opened in waiting[:32]:
            until_closed(opened)
        until(lambda: server.unfinished >= 32)
        assert len(said) == 1

    yield crowd
    for opened in waiting:
        opened.close()


@pytest.mark.parametrize("sends", [b"", b"GET", b"GET / HTTP/1.1\r\nHost: x\r\n"])
def test_half_a_request_is_given_up_in_time(server, said, until, monkeypatch, sends):
    monkeypatch.setattr(listener, "_OPENING_S", 0.05)
    for _ in range(2):
        with half_open(server, sends) as opened:
            until_closed(opened)
    until(lambda: server.unfinished == 2)
    assert len(said) == 1 and "no request" in said[0], "one line for all of them"


def test_what_is_no_http_is_no_half_a_request(server, said):
    with half_open(server, b"\0" * 100) as opened:
        until_closed(opened)
    assert server.unfinished == 0


def test_half_open_requests_keep_no_page_out(server, ask, crowded):
    """At 1024 handles 1018 of them did; they needed no token."""
    crowded(server)
    assert ask(server, "/config.json", THERAPIST)[0] == 200


def test_a_connection_ends_with_its_response(server, monkeypatch):
    monkeypatch.setattr(listener, "_OPENING_S", 10 * DEADLINE_S)
    host = server.address.partition("://")[2]
    with half_open(server, f"GET /patient HTTP/1.1\r\nHost: {host}\r\n\r\n".encode()) as opened:
        until_closed(opened)


def test_a_client_stays_as_long_as_it_likes(server, gateway, run, connect, monkeypatch):
    monkeypatch.setattr(listener, "_OPENING_S", 0.02)
    monkeypatch.setattr(listener, "_MOST_OPENING", 1)
    page = connect(server)
    with half_open(server) as first, half_open(server) as second:
        for opened in (first, second):
            until_closed(opened)
    run(page.send_json({"op": "subscribe", "topic": "/endpoint_state"}))
    gateway.tell("/endpoint_state", {})
    assert run(page.receive_json())["op"] == "publish"


@pytest.mark.parametrize("request_", [
    "GET /ws?token={} HTTP/9.9",
    "GE\0T /ws?token={} HTTP/1.1",
    "GET /ws?token={}",
    "GET /ws?token={} HTTP/1.1\r\nHost: {host}",  # no websocket
    "GET /ws?token={} HTTP/1.1\r\nHost: {host}\r\nNo colon",
    "GET / HTTP/1.1\r\nHost: {host}\r\nAuthorization\0: Bearer {}",
    "GET / HTTP/1.1\r\nHost: {host}\r\nAuthorization: Bearer {}\0",
    "GET /%zz?token={} HTTP/1.1\r\nHost: {host}",
    "GET http://[/ws?token={} HTTP/1.1\r\nHost: {host}",
    "POST /config.json?token={} HTTP/1.1\r\nHost: {host}\r\nContent-Length: x",
    "POST / HTTP/1.1\r\nHost: {host}\r\nTransfer-Encoding: chunked\r\n\r\n{}",
])  # fmt: skip
def test_no_token_reaches_a_log(server, said, caplog, capfd, request_):
    host = server.address.partition("://")[2]
    text = request_.replace("{host}", host).replace("{}", THERAPIST) + "\r\n\r\n"
    with half_open(server, text.encode()) as opened:
        opened.shutdown(socket.SHUT_WR)
        until_closed(opened)
    assert THERAPIST not in "".join([*said, caplog.text, *capfd.readouterr()])


# TLS ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def certificate(tmp_path_factory):
    """Return the files of a certificate for 127.0.0.1 and its key."""
    folder = tmp_path_factory.mktemp("tls")
    files = folder / "certificate.pem", folder / "key.pem"
    command = [
        "openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1",
        "-nodes", "-keyout", str(files[1]), "-out", str(files[0]), "-days", "2",
        "-subj", "/CN=robot", "-addext", "subjectAltName=IP:127.0.0.1",
    ]  # fmt: skip
    try:
        subprocess.run(command, check=True, capture_output=True)
    except FileNotFoundError:
        pytest.skip("openssl is not installed: apt install openssl")
    return files


@pytest.fixture
def encrypted(gateway, certificate, said):
    file, key = map(str, certificate)
    with Served(make_server(gateway, log=said.append, certificate=file, key=key)) as server:
        yield server


def test_with_a_certificate_it_speaks_tls_alone(encrypted, certificate, run, connect, ask):
    assert encrypted.address.startswith("https://")
    trusted = ssl.create_default_context(cafile=str(certificate[0]))
    page = connect(encrypted, topic="/setpoint", ssl=trusted, origin=encrypted.address)
    assert "may not subscribe" in run(page.receive_json())["msg"]
    with pytest.raises(aiohttp.ClientError):
        ask(SimpleNamespace(address=encrypted.address.replace("https", "http")), "/")


def test_half_a_handshake_is_given_up_in_time(encrypted, until, monkeypatch):
    monkeypatch.setattr(listener, "_OPENING_S", 0.05)
    with half_open(encrypted, b"") as opened:
        until_closed(opened)
    until(lambda: encrypted.unfinished == 1)


def test_half_open_handshakes_keep_no_page_out(encrypted, crowded):
    crowded(encrypted, b"")


def test_a_key_that_does_not_fit_is_told(gateway, certificate, tmp_path):
    (tmp_path / "key.pem").write_text("no key")
    server = make_server(gateway, certificate=str(certificate[0]), key=str(tmp_path / "key.pem"))
    with pytest.raises((ssl.SSLError, OSError)), Served(server):
        pass


# The pages ---------------------------------------------------------------------------------


PAGES = [file for file in FOLDER.rglob("*.*") if "vendor" not in file.parts]
ELSEWHERE = ("http://", "https://", "//cdn", "@import", "eval(", "innerHTML", " style=")


def test_the_pages_load_nothing_from_elsewhere():
    assert len(PAGES) > 15
    for file in PAGES:
        text = file.read_text("utf-8")
        assert not [word for word in ELSEWHERE if word in text], file.name
        assert file.suffix != ".html" or "<script>" not in text


def test_every_module_that_is_imported_is_there():
    for file in PAGES:
        for name in re.findall(r' from "([^"]*)"', file.read_text("utf-8")):
            assert (file.parent / name).resolve().is_file(), f"{file.name}: {name}"


def test_the_foreign_library_comes_with_its_licence():
    assert "MIT License" in (FOLDER / "vendor/uplot/LICENSE").read_text("utf-8")
