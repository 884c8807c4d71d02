# SPDX-License-Identifier: Apache-2.0
import os
import socket
from pathlib import Path

import pytest

from screw_module_ros.nodes.support.place import AlreadyRunning
from screw_module_ros.trials import isolation


@pytest.fixture
def places():
    """Collect places, to release them at the end."""
    taken = []
    yield taken
    for place in reversed(taken):
        place.release()


def test_a_domain_that_is_set_is_kept(places, ros_domain_id):
    places.append(isolation.own_place())
    assert places[0].domain == ros_domain_id


def test_without_one_a_free_domain_is_taken_and_set(places, monkeypatch):
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    places.append(isolation.own_place())
    assert 1 <= places[0].domain <= 100
    assert os.environ["ROS_DOMAIN_ID"] == str(places[0].domain)


def test_nodes_keep_what_they_keep_for_this_run_alone(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    place = isolation.own_place()
    folder = Path(os.environ["XDG_STATE_HOME"])
    assert folder.is_dir() and not list(folder.iterdir())
    place.release()
    assert os.environ["XDG_STATE_HOME"] == str(tmp_path) and not folder.exists()


def test_discovery_stays_on_this_machine(places, monkeypatch):
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE", raising=False)
    places.append(isolation.own_place())
    assert os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"


def test_two_runs_do_not_share_a_domain(places, monkeypatch):
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    places.append(isolation.own_place())
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    monkeypatch.setattr(isolation, "_DOMAINS", range(places[0].domain, places[0].domain + 1))
    with pytest.raises(AlreadyRunning, match="every ROS domain"):
        isolation.own_place()


def test_a_released_domain_is_free_again(places, monkeypatch):
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    first = isolation.own_place()
    first.release()
    assert "ROS_DOMAIN_ID" not in os.environ
    monkeypatch.setattr(isolation, "_DOMAINS", range(first.domain, first.domain + 1))
    places.append(isolation.own_place())
    assert places[0].domain == first.domain


def test_a_domain_somebody_listens_in_is_left_alone(places, monkeypatch):
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    place = isolation.own_place()
    place.release()
    monkeypatch.setattr(isolation, "_DOMAINS", range(place.domain, place.domain + 1))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        other.bind(("", 7400 + 250 * place.domain + 10))
        with pytest.raises(AlreadyRunning, match="every ROS domain"):
            isolation.own_place()
