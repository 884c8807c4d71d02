# SPDX-License-Identifier: Apache-2.0
"""Some damaged bags on every run; `fuzz_bags.py` by itself runs as many as wanted."""


import pytest
from bag_counts import by_library, by_scan
from fuzz_bags import Fuzzer, make_bag


@pytest.mark.parametrize("plain", [True, False])
def test_damaged_bags_lose_nothing_and_end_in_sentences(tmp_path, plain):
    fuzzer = Fuzzer(tmp_path, seed=1)
    fuzzer.run(range(20), plain)
    assert not fuzzer.failures, fuzzer.failures[0]
    assert fuzzer.counts["cases"] == 20


@pytest.mark.parametrize("compression", ["zstd", "none"])
def test_the_fuzzers_own_counts(tmp_path, compression):
    bag = make_bag(tmp_path / "bag", compression)
    content = (bag / "bag_0.mcap").read_bytes()
    assert by_library(content) == len(by_scan(content)) == 400
