# SPDX-License-Identifier: Apache-2.0
"""Some damaged bags on every run; `make fuzz ARGS="--what bags"` damages as many as wanted."""

import random

import pytest
from bag_counts import by_library, by_scan
from fuzz_bags import Fuzzer, make_bag


@pytest.fixture(scope="module")
def fuzzer(tmp_path_factory):
    return Fuzzer(tmp_path_factory.mktemp("bags"))


@pytest.mark.parametrize("plain", [True, False])
@pytest.mark.parametrize("number", range(20))
def test_damaged_bags_lose_nothing_and_end_in_sentences(fuzzer, tmp_path, number, plain):
    fuzzer.damaged(random.Random(f"1 {number}"), tmp_path / "case", plain)


@pytest.mark.parametrize("compression", ["zstd", "none"])
def test_the_fuzzers_own_counts(tmp_path, compression):
    bag = make_bag(tmp_path / "bag", compression)
    content = (bag / "bag_0.mcap").read_bytes()
    assert by_library(content) == len(by_scan(content)) == 400
