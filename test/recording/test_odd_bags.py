# SPDX-License-Identifier: Apache-2.0
"""An odd bag gets a message and never prevents another recording."""

import contextlib
import errno
import json
import os
import shutil

import pytest
import yaml
from bag_damage import CHUNK, FILE, alter, old, place_of

from screw_module_ros.recording import BagError, BagWriter
from screw_module_ros.recording.recovery import recover_all
from screw_module_ros.session_command import main


def rewrite(folder, change):
    path = folder / "metadata.yaml"
    told = yaml.safe_load(path.read_text())
    change(told["rosbag2_bagfile_information"])
    path.write_text(yaml.safe_dump(told))


def odd_audit(values):
    def break_it(folder):
        def change(information):
            information["custom_data"]["screw_module_ros/audit"] = values

        rewrite(folder, change)

    return break_it


def replaced(name, make):
    def break_it(folder):
        (folder / name).unlink()
        make(folder / name)

    return break_it


def huge_length(offset):
    """Declare 2^64 - 1 bytes somewhere in the first chunk."""

    def change(data):
        place = place_of(data, CHUNK, 0) + offset
        data[place : place + 8] = b"\xff" * 8

    return lambda folder: alter(folder, change)


ODD = {
    "huge record": huge_length(1),
    "huge chunk": huge_length(45),
    "huge when uncompressed": huge_length(25),
    "audit of another version": odd_audit(json.dumps({"/screw/encoder": {"misst": 1}})),
    "audit that is none": odd_audit("[" * 5000),
    "topic without name": lambda folder: rewrite(
        folder, lambda told: told["topics_with_message_count"][0]["topic_metadata"].pop("name")
    ),
    "notes that nest": lambda folder: (folder / "metadata.yaml").write_text("- " * 9000),
    "notes with a number too long": lambda folder: (folder / "metadata.yaml").write_text(
        "rosbag2_bagfile_information: " + "9" * 9000
    ),
    "dangling link": replaced(FILE, lambda path: path.symlink_to("nowhere")),
    "link to a device": replaced(FILE, lambda path: path.symlink_to("/dev/zero")),
    "folder": replaced(FILE, lambda path: path.mkdir()),
    "FIFO": replaced(FILE, os.mkfifo),
    "notes that are a FIFO": replaced("metadata.yaml", os.mkfifo),
    "notes that are a folder": replaced("metadata.yaml", lambda path: path.mkdir()),
    "empty file": replaced(FILE, lambda path: path.touch()),
    "truncated within the first chunk": lambda folder: os.truncate(folder / FILE, 900),
    "truncated within the header": lambda folder: os.truncate(folder / FILE, 20),
}


@pytest.fixture(params=ODD)
def odd(bag, request):
    """A bag with something odd in it, and torn."""
    with contextlib.suppress(FileNotFoundError):
        os.truncate(bag / FILE, 60_000)
    ODD[request.param](bag)
    old(bag)
    return bag


@pytest.mark.timeout(60)
def test_a_sentence_for_every_odd_bag(odd, capsys):
    for command in ("verify", "info", "recover"):
        code = main([command, str(odd)])
        said = capsys.readouterr()
        assert code in (0, 1)
        assert code == 0 or command == "verify" or str(odd) in said.err
        assert len(said.err) < 1000


@pytest.mark.timeout(60)
def test_one_odd_bag_does_not_keep_the_others_from_being_recovered(odd):
    good = odd.parent / "zz"
    good.mkdir()
    writer = BagWriter(good / "bag")
    writer.close()
    shutil.move(good / "bag" / FILE, good / FILE)
    os.truncate(good / FILE, (good / FILE).stat().st_size - 10)
    old(good)
    found = recover_all(odd.parent)
    assert odd in found
    assert str(found[odd])
    assert not isinstance(found[good], BagError)


def test_another_users_file_is_warned_about(bag, monkeypatch):
    os.truncate(bag / FILE, 40_000)
    old(bag)
    real = os.open

    def denied(path, *arguments, **options):
        if str(path).endswith(FILE):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        return real(path, *arguments, **options)

    monkeypatch.setattr(os, "open", denied)
    assert "Permission denied" in str(recover_all(bag.parent)[bag])
