# SPDX-License-Identifier: Apache-2.0
"""`recover` never gives less than the mcap library's own reader, wherever a file is damaged."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from mcap.reader import NonSeekingReader, SeekingReader
from mcap_features import FEATURES

from screw_module_ros.recording.bag import BagError
from screw_module_ros.recording.recover import recover

pytestmark = pytest.mark.long

TICKS = 600
LAYOUTS = ("zstd", "lz4", "chunked", "no index", "no summary", "not chunked", "mixed")
ANYWHERE = settings(
    max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None
)
PLACE = st.floats(0.0, 1.0, exclude_max=True)


def read(content: bytes) -> set[tuple[str, int, int, bytes]]:
    """Return what the library reads, by its index and from the beginning; checksums are judged.

    Without an index of chunks its seeking reader judges none.
    """
    found = set()
    for kind in (SeekingReader, NonSeekingReader):
        with contextlib.suppress(Exception):
            reader = kind(io.BytesIO(content), validate_crcs=True)
            if kind is SeekingReader and not reader.get_summary().chunk_indexes:
                continue
            for _, channel, message in reader.iter_messages(log_time_order=False):
                found.add((channel.topic, message.sequence, message.log_time, message.data))
    return found


@pytest.fixture(params=LAYOUTS)
def source(request, tmp_path, record) -> Path:
    """A file of encoder samples in one of the layouts."""
    bag = record(range(TICKS), chunk_size=3000)
    FEATURES[request.param](bag / "bag_0.mcap", tmp_path / "source.mcap")
    assert len(read((tmp_path / "source.mcap").read_bytes())) == TICKS
    return tmp_path / "source.mcap"


@pytest.fixture
def recovered(source, tmp_path, request):
    """Return what is recovered of the source with this content, and the messages it had."""
    whole = read(source.read_bytes())
    number = iter(range(10**6))

    def make(content: bytes) -> set[tuple[str, int, int, bytes]]:
        folder = tmp_path / str(next(number))
        folder.mkdir()
        (folder / "x.mcap").write_bytes(content)
        try:
            found = recover(folder / "x.mcap")
        except BagError:
            return set()
        copied = read((found.folder / "x_recovered_0.mcap").read_bytes())
        assert len(copied) == found.messages, "none twice"
        return copied

    make.whole, make.content = whole, source.read_bytes()
    make.has_checksums = request.node.callspec.params["source"] not in ("not chunked", "mixed")
    return make


def judged(recovered, content: bytes) -> None:
    found = recovered(content)
    assert read(content) & recovered.whole <= found
    if recovered.has_checksums:
        assert found <= recovered.whole, "nothing that was not recorded"


@ANYWHERE
@given(place=PLACE, bit=st.integers(0, 7))
@example(place=0.0, bit=3)
def test_a_flipped_bit(recovered, place, bit):
    content = bytearray(recovered.content)
    content[int(place * len(content))] ^= 1 << bit
    judged(recovered, bytes(content))


@ANYWHERE
@given(place=PLACE, more=st.binary(min_size=1, max_size=40))
@example(place=0.3, more=b"\x06" + bytes(30))
def test_inserted_bytes(recovered, place, more):
    at = int(place * len(recovered.content))
    judged(recovered, recovered.content[:at] + more + recovered.content[at:])


@ANYWHERE
@given(place=PLACE, count=st.integers(1, 400))
def test_deleted_bytes(recovered, place, count):
    at = int(place * len(recovered.content))
    judged(recovered, recovered.content[:at] + recovered.content[at + count :])


@ANYWHERE
@given(count=st.integers(1, 600))
def test_a_zeroed_header(recovered, count):
    judged(recovered, bytes(count) + recovered.content[count:])


@ANYWHERE
@given(share=PLACE)
def test_a_cut(recovered, share):
    judged(recovered, recovered.content[: int(share * len(recovered.content))])


@pytest.mark.parametrize("source", ["zstd", "lz4", "chunked"], indirect=True)
def test_a_flipped_bit_in_each_byte_of_a_chunks_head(recovered):
    """The library goes to a chunk by the index, whatever opcode, length and size it states."""
    content = recovered.content
    heads = [match.start() for match in re.finditer(rb"\x06.{2}\0{6}", content, re.DOTALL)]
    middle = next(place for place in heads if place > len(content) // 2)
    for place in range(middle, middle + 60):
        changed = bytearray(content)
        changed[place] ^= 1 << (place - middle) % 8
        judged(recovered, bytes(changed))


@pytest.mark.parametrize("source", ["zstd"], indirect=True)
@pytest.mark.parametrize("count", [8, 20, 60, 100, 300])
def test_of_a_zeroed_header_one_chunk_at_most_is_lost(recovered, count):
    """It was refused, though all other chunks were whole."""
    content = bytes(count) + recovered.content[count:]
    assert len(recovered(content)) >= TICKS - 60


@pytest.mark.parametrize("source", ["zstd"], indirect=True)
@pytest.mark.parametrize("change", [b"", b"x", b"xxxxx"])
def test_bytes_inserted_or_missing_in_the_middle_cost_one_chunk(recovered, change):
    """They cost all that came after them."""
    half = len(recovered.content) // 2
    content = recovered.content[:half] + change + recovered.content[half + 1 - len(change) // 5 :]
    assert len(recovered(content)) >= TICKS - 60


@pytest.mark.parametrize("source", ["not chunked"], indirect=True)
def test_a_broken_length_outside_of_chunks_costs_few_messages(recovered):
    content = bytearray(recovered.content)
    content[len(content) // 2 // 8 * 8 + 3] ^= 0xFF
    assert len(recovered(bytes(content)) & recovered.whole) >= TICKS - 3
