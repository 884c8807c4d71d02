# SPDX-License-Identifier: Apache-2.0
"""The real server attacked over real sockets; the robot behind it is a fake."""

from __future__ import annotations

import asyncio
import gc
import json
import socket
import ssl
import subprocess
import sys
import threading
import weakref

import aiohttp
import pytest
from fake_gateway import Served

from screw_module_ros.bridge import listener
from screw_module_ros.bridge.client import Client
from screw_module_ros.bridge.pages import FOLDER
from screw_module_ros.bridge.rights import Rights
from screw_module_ros.bridge.server import Connection, Server
from screw_module_ros.bridge.settings import Limits, Listening
from screw_module_ros.bridge.tokens import Tokens
from screw_module_ros.clock import WallClock

TOKENS = Tokens("p" * 32, "t" * 32)
PATIENT, THERAPIST = TOKENS
CONFIG = {"robots": ["/"], "protocols": []}
DEADLINE_S = 20.0


def make_server(gateway, limits=None, log=print, **listening):
    rights = Rights(["/"])
    return Server(
        Listening(port=0, **listening), limits or Limits(), TOKENS, rights, gateway, WallClock(),
        CONFIG, log,
    )  # fmt: skip


@pytest.fixture
def said():
    """What the server has logged."""
    return []


@pytest.fixture
def server(gateway, said):
    made = make_server(gateway, limits=Limits(clients=4, patience=0.3), log=said.append)
    with Served(made) as server:
        yield server


def run(coroutine):
    return asyncio.run(asyncio.wait_for(coroutine, DEADLINE_S))


async def answer(server, path, token=None, **headers):
    if token:
        headers["Authorization"] = f"Bearer {token}"
    async with aiohttp.ClientSession() as session:
        async with session.get(server.address + path, headers=headers) as response:
            return response.status, await response.text(), response.headers


async def refusal(server, query, **headers):
    """Return the status with which a websocket is refused."""
    async with aiohttp.ClientSession() as session:
        with pytest.raises(aiohttp.WSServerHandshakeError) as error:
            await session.ws_connect(f"{server.address}/ws{query}", headers=headers)
        return error.value.status


async def until(condition):
    """Wait until the condition holds."""
    while not condition():
        await asyncio.sleep(0.01)


# Who is let in -----------------------------------------------------------------------------


@pytest.mark.parametrize(("query", "headers"), [
    ("", {}),
    ("?token=", {}),
    ("?token=" + "x" * 32, {}),
    (f"?token={THERAPIST}", {"Origin": "http://evil.example"}),
    (f"?token={THERAPIST}", {"Origin": "null"}),
    (f"?token={THERAPIST}", {"Host": "evil.example"}),
    (f"?token={THERAPIST}", {"Host": "evil.example:80", "Origin": "http://evil.example:80"}),
])  # fmt: skip
def test_strangers_are_refused(server, query, headers):
    assert run(refusal(server, query, **headers)) == 403
    assert server.clients == 0
    assert server.refused == 1


def test_pages_come_with_the_headers_that_keep_them_apart(server):
    for path in ("/", "/patient", "/therapist", "/static/js/link.js"):
        status, _, headers = run(answer(server, path))
        assert status == 200, path
        assert "default-src 'none'" in headers["Content-Security-Policy"]
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert headers["Referrer-Policy"] == "no-referrer"
        assert headers["Connection"] == "close"
    assert run(answer(server, "/patient", Host="evil.example"))[0] == 403
    assert run(answer(server, "/patient", Origin="http://evil.example"))[0] == 403


@pytest.mark.parametrize("path", [
    "/static/../server.py", "/static/%2e%2e/%2e%2e/server.py", "/static//etc/passwd", "/static/",
    "/static/js", "/tokens.json",
])  # fmt: skip
def test_nothing_but_the_pages_is_served(server, path):
    status, text, _ = run(answer(server, path))
    assert status in (403, 404)
    assert "class Server" not in text and "root:" not in text


def test_the_configuration_needs_a_token(server):
    assert run(answer(server, "/config.json"))[0] == 403
    for token, role, wishes in ((PATIENT, "patient", False), (THERAPIST, "therapist", True)):
        status, text, _ = run(answer(server, "/config.json", token=token))
        assert status == 200
        assert json.loads(text) == {**CONFIG, "role": role, "wishes": wishes}
    server._rights.wishes = True
    assert json.loads(run(answer(server, "/config.json", token=PATIENT))[1])["wishes"]


@pytest.mark.parametrize(("allowed", "patients"), [(1, 1), (2, 1), (3, 1), (4, 2)])
def test_one_patient_gets_in_however_few_are_allowed(gateway, allowed, patients):
    server = make_server(gateway, limits=Limits(clients=allowed))
    assert (server._room_for("patient"), server._room_for("therapist")) == (patients, allowed)


def test_no_more_clients_than_allowed_and_room_for_therapists(server):
    async def crowd():
        async with aiohttp.ClientSession() as session:
            address = f"{server.address}/ws?token={PATIENT}"
            pages = [await session.ws_connect(address) for _ in range(2)]
            refused = [await refusal(server, f"?token={PATIENT}")]
            address = f"{server.address}/ws?token={THERAPIST}"
            pages += [await session.ws_connect(address) for _ in range(2)]
            refused.append(await refusal(server, f"?token={THERAPIST}"))
            return refused, [page.closed for page in pages]

    assert run(crowd()) == ([503, 503], [False] * 4)


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


def test_a_subscription_brings_samples(server, gateway):
    async def play():
        async with aiohttp.ClientSession() as session:
            page = await session.ws_connect(f"{server.address}/ws?token={PATIENT}")
            await page.send_json({"op": "subscribe", "topic": "/endpoint_state"})
            numbers = []
            for number in range(3):
                gateway.tell("/endpoint_state", {"number": number})
                while number not in numbers:
                    try:
                        message = await page.receive_json(timeout=0.05)
                    except asyncio.TimeoutError:
                        continue
                    numbers.append(message["msg"]["number"])
            return numbers

    assert run(play()) == [0, 1, 2]


def test_a_flooding_client_is_cut_off_with_a_sentence(server, gateway):
    async def flood():
        async with aiohttp.ClientSession() as session:
            page = await session.ws_connect(f"{server.address}/ws?token={THERAPIST}")
            for _ in range(400):
                await page.send_str('{"op":"publish","topic":"/therapy/attendance","msg":{}}')
            told = [message async for message in page]
            return told, page.close_code

    told, code = run(flood())
    assert "messages a second" in told[-1].json()["msg"]
    assert code == 1008
    assert len(gateway.published) < 300


@pytest.mark.parametrize("payload", ["x" * 20_000, "[" * 20_000])
def test_a_message_too_large_ends_the_connection(server, said, payload):
    async def send():
        async with aiohttp.ClientSession() as session:
            page = await session.ws_connect(f"{server.address}/ws?token={THERAPIST}")
            await page.send_str(payload)
            async for _ in page:
                pass
            return page.close_code

    assert run(send()) == 1009
    run(until(lambda: said))
    assert said == [
        "cut off a therapist's page: a message had more than the 16384 bytes that are allowed"
    ]


def test_binary_messages_are_refused(server):
    async def send():
        async with aiohttp.ClientSession() as session:
            page = await session.ws_connect(f"{server.address}/ws?token={THERAPIST}")
            await page.send_bytes(b"\0")
            return (await page.receive_json(timeout=5))["msg"]

    assert "JSON texts are wanted" in run(send())


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


def test_a_slow_client_holds_nobody_up_and_is_cut_off(server, gateway):
    sleeper = slow_client(server.address, "/endpoint_state")
    large = "x" * 100_000

    async def play():
        async with aiohttp.ClientSession() as session:
            page = await session.ws_connect(f"{server.address}/ws?token={PATIENT}")
            await page.send_json({"op": "subscribe", "topic": "/endpoint_state"})
            got = 0
            while server.clients > 1:
                gateway.tell("/endpoint_state", {"large": large})
                try:
                    await page.receive(timeout=0.05)
                    got += 1
                except asyncio.TimeoutError:
                    pass
            return got

    assert run(play()) > 10  # the other one went on meanwhile
    assert server.cut_off == 1
    sleeper.close()


def test_an_error_while_sending_closes_the_page(server, gateway, said):
    """Without news a page would show a robot at rest."""
    gateway.after = lambda topic, number: 1 / 0

    async def play():
        async with aiohttp.ClientSession() as session:
            page = await session.ws_connect(f"{server.address}/ws?token={PATIENT}")
            await page.send_json({"op": "subscribe", "topic": "/endpoint_state"})
            return (await page.receive(timeout=5)).type

    kind = run(play())
    assert kind in (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED, aiohttp.WSMsgType.ERROR)
    assert said == ["cut off a patient's page: ZeroDivisionError: division by zero"]


def test_an_error_of_asyncio_is_told_without_its_text(server, gateway, said):
    """The text may quote a request, and so hold a token. Each turn polls the robots."""
    def poll():
        if not said:
            context = {"message": "Task failed", "exception": ValueError(THERAPIST)}
            asyncio.get_running_loop().call_exception_handler(context)

    gateway.poll = poll
    run(until(lambda: said))
    assert said == ["Task failed: ValueError"]


def test_nothing_is_left_of_clients_that_came_and_went(server, gateway):
    made = weakref.WeakSet()
    original = Client.__init__

    def init(self, *args, **kwargs):
        original(self, *args, **kwargs)
        made.add(self)

    async def come_and_go():
        async with aiohttp.ClientSession() as session:
            for _ in range(60):
                page = await session.ws_connect(f"{server.address}/ws?token={THERAPIST}")
                await page.send_json({"op": "subscribe", "topic": "/endpoint_state"})
                await page.send_json({"op": "call_service", "service": "/supervisor/estop"})
                gateway.tell("/endpoint_state", {})
                await page.receive_json(timeout=5)
                page._response.connection.transport.abort()  # a tab that is gone
            await until(lambda: server.clients == 0)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Client, "__init__", init)
        run(come_and_go())
    assert len(gateway.calls) == 60, "a stop is carried out, also if its page has gone"
    for *_, answer in gateway.calls:  # the robot has answered, or given up
        answer.get_loop().call_soon_threadsafe(answer.set_result, {})
    run(until(lambda: all(answer.done() for *_, answer in gateway.calls)))
    gateway.calls.clear()
    for _ in range(3):
        gc.collect()
    assert len(made) == 0
    assert sum(type(each) is Connection for each in gc.get_objects()) == 0


def test_closing_ends_connections(gateway):
    served = Served(make_server(gateway))

    async def play(server):
        async with aiohttp.ClientSession() as session:
            page = await session.ws_connect(f"{server.address}/ws?token={PATIENT}")
            await until(lambda: server.clients == 1)
            await asyncio.get_running_loop().run_in_executor(None, served.__exit__)
            return (await page.receive(timeout=5)).type

    kind = run(play(served.__enter__()))
    assert kind in (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED, aiohttp.WSMsgType.ERROR)
    assert not [thread for thread in threading.enumerate() if thread.name == "bridge"]


# Who makes no request ----------------------------------------------------------------------


def half_open(server, sends=b"GET / HTTP/1.1\r\nHost: "):
    """Return a socket that has sent the beginning of a request."""
    host, _, port = server.address.partition("://")[2].rpartition(":")
    opened = socket.create_connection((host, int(port)), timeout=DEADLINE_S)
    opened.sendall(sends)
    return opened


def is_closed(opened):
    """Wait until the server has closed it."""
    try:
        return opened.recv(64) == b""
    except ConnectionError:
        return True


def test_half_a_request_is_given_up_in_time(server, said, monkeypatch):
    monkeypatch.setattr(listener, "_OPENING_S", 0.05)
    for sends in (b"", b"GET", b"GET / HTTP/1.1\r\nHost: x\r\n", b"\0" * 100):
        with half_open(server, sends) as opened:
            while not is_closed(opened):  # an answer to what is no HTTP comes first
                pass
    run(until(lambda: server.unfinished == 3))
    assert len(said) == 1 and "no request" in said[0], "one line for all of them"


def test_half_open_requests_keep_no_page_out(server, said, monkeypatch):
    """At 1024 handles 1018 of them did; they needed no token."""
    monkeypatch.setattr(listener, "_MOST_OPENING", 8)
    monkeypatch.setattr(listener, "_OPENING_S", 10 * DEADLINE_S)  # not by time
    waiting = [half_open(server) for _ in range(40)]
    try:
        assert run(answer(server, "/config.json", token=THERAPIST))[0] == 200
        assert all(is_closed(opened) for opened in waiting[:32]), "the oldest go"
        run(until(lambda: server.unfinished >= 32))
        assert len(said) == 1
    finally:
        for opened in waiting:
            opened.close()


def test_a_connection_ends_with_its_response(server, monkeypatch):
    monkeypatch.setattr(listener, "_OPENING_S", 10 * DEADLINE_S)
    host = server.address.partition("://")[2]
    with half_open(server, f"GET /patient HTTP/1.1\r\nHost: {host}\r\n\r\n".encode()) as opened:
        while not is_closed(opened):
            pass


def test_a_client_stays_as_long_as_it_likes(server, gateway, monkeypatch):
    monkeypatch.setattr(listener, "_OPENING_S", 0.02)
    monkeypatch.setattr(listener, "_MOST_OPENING", 1)

    async def play():
        async with aiohttp.ClientSession() as session:
            page = await session.ws_connect(f"{server.address}/ws?token={PATIENT}")
            with half_open(server) as first, half_open(server) as second:
                loop = asyncio.get_running_loop()
                for opened in (first, second):
                    await loop.run_in_executor(None, is_closed, opened)
            await page.send_json({"op": "subscribe", "topic": "/endpoint_state"})
            gateway.tell("/endpoint_state", {})
            return await page.receive_json(timeout=5)

    assert run(play())["op"] == "publish"


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
        while not is_closed(opened):
            pass
    logged = "".join([*said, caplog.text, *capfd.readouterr()])
    assert THERAPIST not in logged


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


def test_with_a_certificate_it_speaks_tls_alone(gateway, certificate):
    made = make_server(gateway, certificate=str(certificate[0]), key=str(certificate[1]))
    with Served(made) as server:
        assert server.address.startswith("https://")
        trusted = ssl.create_default_context(cafile=str(certificate[0]))

        async def play():
            connector = aiohttp.TCPConnector(ssl=trusted)
            async with aiohttp.ClientSession(connector=connector) as session:
                address = f"{server.address}/ws?token={PATIENT}"
                page = await session.ws_connect(address, origin=server.address)
                await page.send_json({"op": "subscribe", "topic": "/setpoint"})
                told = (await page.receive_json(timeout=5))["msg"]
            plain = server.address.replace("https", "http")
            async with aiohttp.ClientSession() as session:
                with pytest.raises(aiohttp.ClientError):
                    await session.get(plain)
            return told

        assert "may not subscribe" in run(play())


def test_half_a_handshake_is_given_up_in_time(gateway, certificate, monkeypatch):
    monkeypatch.setattr(listener, "_OPENING_S", 0.05)
    made = make_server(gateway, certificate=str(certificate[0]), key=str(certificate[1]))
    with Served(made) as server, half_open(server, b"") as opened:
        assert is_closed(opened)
        run(until(lambda: server.unfinished == 1))


def test_half_open_handshakes_keep_no_page_out(gateway, certificate, said, monkeypatch):
    monkeypatch.setattr(listener, "_MOST_OPENING", 8)
    monkeypatch.setattr(listener, "_OPENING_S", 10 * DEADLINE_S)  # not by time
    files = {"certificate": str(certificate[0]), "key": str(certificate[1])}
    with Served(make_server(gateway, log=said.append, **files)) as server:
        waiting = [half_open(server, b"") for _ in range(40)]
        assert all(is_closed(opened) for opened in waiting[:32]), "the oldest go"
        run(until(lambda: server.unfinished >= 32))
        assert len(said) == 1
        for opened in waiting:
            opened.close()


def test_a_key_that_does_not_fit_is_told(gateway, certificate, tmp_path):
    (tmp_path / "key.pem").write_text("no key")
    server = make_server(gateway, certificate=str(certificate[0]), key=str(tmp_path / "key.pem"))
    with pytest.raises((ssl.SSLError, OSError)), Served(server):
        pass


# The pages ---------------------------------------------------------------------------------


def test_the_pages_load_nothing_from_elsewhere():
    files = [file for file in FOLDER.rglob("*.*") if "vendor" not in file.parts]
    assert len(files) > 15
    for file in files:
        text = file.read_text("utf-8")
        for word in ("http://", "https://", "//cdn", "@import", "eval(", "innerHTML", " style="):
            assert word not in text, f"{file.name}: {word}"
        if file.suffix == ".html":
            assert "<script>" not in text


def test_every_module_that_is_imported_is_there():
    for file in FOLDER.rglob("*.js"):
        if "vendor" in file.parts:
            continue
        for line in file.read_text("utf-8").splitlines():
            if " from \"" in line:
                name = line.split(" from \"")[1].split('"')[0]
                assert (file.parent / name).resolve().is_file(), f"{file.name}: {name}"


def test_the_foreign_library_comes_with_its_licence():
    assert "MIT License" in (FOLDER / "vendor/uplot/LICENSE").read_text("utf-8")


def test_nothing_here_needs_ros():
    code = "import sys, screw_module_ros.bridge.server; print('rclpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
