# SPDX-License-Identifier: Apache-2.0
"""Who is let in: Host, Origin and token, and the file of tokens."""

from __future__ import annotations

import json
import stat

import pytest

from screw_module_ros.bridge.door import Door, Refused, is_loopback, names_of, token_in
from screw_module_ros.bridge.tokens import TokenError, role_of, tokens_in
from screw_module_ros.session_command import main

TOKENS = {"therapist:T7": "7" * 32, "therapist": "t" * 32, "patient": "p" * 32}


def door(origins=(), scheme="http", port=8090, hosts=(), address="127.0.0.1"):
    return Door(names_of(address, hosts), port, scheme, tuple(origins), lambda: TOKENS)


@pytest.mark.parametrize("host", ["127.0.0.1:8090", "localhost:8090", "LOCALHOST:8090",
                                  "[::1]:8090"])  # fmt: skip
def test_own_names_are_known(host):
    assert door().check_host(host) is None


@pytest.mark.parametrize("host", [
    None, "", "evil.example", "evil.example:8090", "127.0.0.1", "127.0.0.1:8091",
    "127.0.0.1.evil.example:8090", "localhost:8090/x", "user@localhost:8090", "localhost:99999",
    "[::1", "0.0.0.0:8090",
])  # fmt: skip
def test_other_names_are_refused(host):
    with pytest.raises(Refused):
        door().check_host(host)


def test_names_may_be_added_and_the_usual_port_left_out():
    given = door(scheme="https", port=443, hosts=("robot.example", ""), address="0.0.0.0")
    given.check_host("robot.example")
    given.check_origin("https://robot.example")
    with pytest.raises(Refused):
        given.check_origin("http://robot.example")


@pytest.mark.parametrize("origin", [
    "null", "http://evil.example", "http://127.0.0.1", "https://127.0.0.1:8090",
    "http://127.0.0.1:8090.evil.example", "http://evil.example#http://127.0.0.1:8090", "",
    "file://",
])  # fmt: skip
def test_foreign_pages_are_refused(origin):
    with pytest.raises(Refused):
        door().check_origin(origin)


@pytest.mark.parametrize(("origin", "named"), [
    ("http://127.0.0.1:8090", ()), (None, ()), ("null", ("null",)),
    ("https://games.example", ("null", "https://games.example")),
])  # fmt: skip
def test_own_pages_programs_and_named_pages_come_in(origin, named):
    assert door(named).check_origin(origin) is None


def test_a_token_tells_whose_it_is_and_so_the_role():
    whose = [door().whose(token) for token in TOKENS.values()]
    assert whose == ["therapist:T7", "therapist", "patient"]
    assert [role_of(who) for who in whose] == ["therapist", "therapist", "patient"]


@pytest.mark.parametrize("token", [
    None, "", "p" * 31, "q" * 32, "ü" * 32, "\udcff" * 32, "\ud800", "guessed",
])  # fmt: skip
def test_a_missing_token_is_told_from_a_wrong_one(token):
    told = "wrong token" if token else "no token"
    with pytest.raises(Refused, match=f"^{told}: open the address that the bridge pr") as error:
        door().whose(token)
    assert not token or token not in str(error.value)


@pytest.mark.parametrize(("query", "headers", "token"), [
    ({"token": "a"}, {}, "a"), ({"token": "a"}, {"Authorization": "Bearer b"}, "b"),
    ({}, {"Authorization": "Basic b"}, None),
])  # fmt: skip
def test_where_a_token_may_stand(query, headers, token):
    assert token_in(query, headers) == token


@pytest.mark.parametrize(("address", "local"), [
    ("127.0.0.1", True), ("127.3.2.1", True), ("::1", True), ("localhost", True),
    ("0.0.0.0", False), ("::", False), ("192.168.0.5", False), ("robot.example", False),
    ("", False),
])  # fmt: skip
def test_what_others_reach_is_known(address, local):
    assert is_loopback(address) is local


# The file ----------------------------------------------------------------------------------


@pytest.fixture
def file(tmp_path):
    """A file with tokens."""
    file = tmp_path / "state" / "bridge" / "tokens.json"
    tokens_in(file)
    return file


def test_tokens_are_made_once_for_the_owner_alone(file, tmp_path):
    tokens = tokens_in(file)
    modes = [stat.S_IMODE(each.stat().st_mode) for each in (file, file.parent)]
    assert modes == [0o600, 0o700]
    assert tokens_in(file) == tokens
    assert {*tokens} == {"patient", "therapist"}
    assert [len(each) for each in {*tokens.values()}] == [32, 32]  # 192 bits in base 64
    assert tokens_in(tmp_path / "other" / "tokens.json") != tokens


@pytest.mark.parametrize(("mode", "folder"), [(0o640, 0o700), (0o604, 0o700), (0o600, 0o755)])
def test_a_file_that_others_reach_is_refused(file, mode, folder):
    file.chmod(mode)
    file.parent.chmod(folder)
    with pytest.raises(TokenError, match="chmod"):
        tokens_in(file)


def test_no_tokens_are_made_where_others_reach_them(tmp_path):
    (tmp_path / "open").mkdir(mode=0o755)
    with pytest.raises(TokenError, match="chmod 700"):
        tokens_in(tmp_path / "open" / "tokens.json")


@pytest.mark.parametrize("content", [
    b"", b"{}", b"[]", b'{"patient": "", "therapist": ""}', b"\xff",
    json.dumps({"patient": "a" * 32, "therapist": "a" * 32}).encode(),
    json.dumps({"patient": "a" * 32, "therapist": "b" * 32, "admin": "c" * 32}).encode(),
    json.dumps({"patient": 5, "therapist": "b" * 32}).encode(),
    json.dumps({"patient": "a" * 32, "therapist:Erika": "b" * 32}).encode(),
    json.dumps({"therapist": "b" * 32}).encode(),
])  # fmt: skip
def test_a_file_without_tokens_is_refused(file, content):
    file.write_bytes(content)
    with pytest.raises(TokenError, match="remove it"):
        tokens_in(file)


def test_a_place_where_nothing_can_be_kept_is_told(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(TokenError, match="cannot be kept"):
        tokens_in(tmp_path / "file" / "tokens.json")


def test_a_file_of_before_is_a_table(file):
    """It had one line, and a patient's token and a therapist's without a code."""
    before = {"patient": "a" * 32, "therapist": "b" * 32}
    file.write_text(json.dumps(before))
    assert tokens_in(file) == before


def command(file, *words):
    return main(["token", *words, "--file", str(file)])


def test_a_therapist_gets_a_token_of_their_own_and_loses_it(file, capsys):
    before = tokens_in(file)
    assert command(file, "T7") == 0 and command(file, "T12") == 0
    printed = [line.partition("=")[2] for line in capsys.readouterr().out.splitlines()]
    assert tokens_in(file) == {**before, "therapist:T7": printed[0], "therapist:T12": printed[1]}
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert command(file, "T7") == 0
    assert tokens_in(file)["therapist:T7"] != printed[0], "a lost one is replaced"
    assert command(file, "T7", "--remove") == 0 and command(file, "T7", "--remove") == 1
    assert tokens_in(file) == {**before, "therapist:T12": printed[1]}


def test_any_line_but_the_patients_can_be_removed_by_hand(file):
    command(file, "T7"), command(file, "T8")
    whole = tokens_in(file)
    lines = file.read_text().splitlines(keepends=True)
    for number in range(1, len(lines) - 2):
        file.write_text("".join(lines[:number] + lines[number + 1 :]))
        assert len(tokens_in(file)) == len(whole) - 1


@pytest.mark.parametrize("code", ["Erika", "T", "T1234", "t7", "T7:x", ""])
def test_a_token_is_of_a_code_not_a_name(file, code):
    with pytest.raises(SystemExit):
        command(file, code)


def test_who_only_reads_makes_no_file(tmp_path):
    with pytest.raises(TokenError):
        tokens_in(tmp_path / "tokens.json", makes=False)
    assert not (tmp_path / "tokens.json").exists()
