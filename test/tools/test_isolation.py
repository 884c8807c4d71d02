# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import socket

import pytest

import isolation


def test_two_runs_at_once_get_two_domains() -> None:
    with isolation.own_domain() as first, isolation.own_domain() as second:
        assert first != second


def test_a_domain_can_be_had_again_after_a_run(monkeypatch: pytest.MonkeyPatch) -> None:
    with isolation.own_domain() as domain:
        pass
    monkeypatch.setattr(isolation, "DOMAINS", [domain])
    with isolation.own_domain() as again:
        assert again == domain


def test_a_domain_that_somebody_uses_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    with isolation.own_domain() as domain:
        pass
    monkeypatch.setattr(isolation, "DOMAINS", [domain])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as somebody:
        somebody.bind(("", 7400 + 250 * domain + 10))
        with pytest.raises(RuntimeError, match="in use"), isolation.own_domain():
            pass
