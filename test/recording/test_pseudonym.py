# SPDX-License-Identifier: Apache-2.0
"""Pseudonyms: random, unmistakable, nothing else accepted; files for the owner alone."""

import stat

import pytest
from hypothesis import given
from hypothesis import strategies as st

from screw_module_ros.files import replace
from screw_module_ros.recording.pseudonym import (
    ALPHABET,
    PseudonymError,
    checked_pseudonym,
    new_pseudonym,
    patient_folder,
)


def mode(path):
    return stat.S_IMODE(path.stat().st_mode)


def test_format_and_alphabet():
    drawn = {new_pseudonym() for _ in range(500)}
    assert len(drawn) > 490
    assert all(checked_pseudonym(each) == each for each in drawn)
    assert checked_pseudonym("P-7K3QX") == "P-7K3QX"
    assert not set("0O1ILU") & set(ALPHABET)
    assert set("".join(each[2:] for each in drawn)) == set(ALPHABET)


@given(st.text())
def test_free_text_is_refused_and_not_repeated(text):
    if text.startswith("P-") and len(text) == 7 and set(text[2:]) <= set(ALPHABET):
        return
    with pytest.raises(PseudonymError) as caught:
        checked_pseudonym(text)
    if len(text) > 12:
        assert text not in str(caught.value), "the text may be a name"


@pytest.mark.parametrize(
    "text",
    ["", "Erika Musterfrau", "P-7K3Q", "P-7K3QXX", "p-7k3qx", "P-7K3O1", "P-7K3QX\n", "../P-7K3QX",
     " P-7K3QX", None, 7, "P-PETER", "P-SARAH"],
)  # fmt: skip
def test_near_misses_are_refused(text):
    with pytest.raises(PseudonymError):
        checked_pseudonym(text)


def test_folders_and_files_are_the_owners_alone(tmp_path):
    (tmp_path / "sessions").mkdir()
    (tmp_path / "sessions" / "P-7K3QX").mkdir(mode=0o755)  # one that was open is closed
    folder = patient_folder(tmp_path / "sessions", "P-7K3QX")
    replace(folder / "trials.csv", "one", private=True)
    replace(folder / "trials.csv", "two", private=True)
    assert mode(folder) == mode(patient_folder(tmp_path / "new", "P-7K3QX")) == 0o700
    assert mode(tmp_path / "new") == 0o700 and mode(folder / "trials.csv") == 0o600
    assert (folder / "trials.csv").read_bytes() == b"two"
    assert [each.name for each in folder.iterdir()] == ["trials.csv"]
