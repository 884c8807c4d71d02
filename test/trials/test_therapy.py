# SPDX-License-Identifier: Apache-2.0
"""`make therapy`: the whole robot with pages, and an end in order."""

from __future__ import annotations

import re
import signal
import socket
import subprocess
import threading
import urllib.request

import pytest

from screw_module_ros.nodes.bringup import executable_path

pytestmark = [pytest.mark.graph, pytest.mark.long]
DEADLINE_S = 200.0


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_it_prints_two_addresses_and_ends_in_order(tmp_path, wait_until):
    port = free_port()
    command = [executable_path("therapy"), "--patient", "weak", "--trait", "carried=0.9",
               "--port", str(port), "--folder", str(tmp_path)]  # fmt: skip
    therapy = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL,
        text=True, start_new_session=True,
    )  # fmt: skip
    said = []
    reader = threading.Thread(target=lambda: said.extend(therapy.stdout), daemon=True)
    reader.start()

    def addresses():
        return re.findall(r"(patient|therapist)\s+(http://\S+)", "".join(said))

    try:
        wait_until(
            lambda: len(addresses()) == 2 or therapy.poll() is not None, DEADLINE_S, "".join(said)
        )
        found = dict(addresses())
        assert set(found) == {"patient", "therapist"}, "".join(said)
        for role, address in found.items():
            page, _, token = address.partition("#token=")
            assert page == f"http://127.0.0.1:{port}/{role}"
            request = urllib.request.Request(
                f"http://127.0.0.1:{port}/config.json", headers={"Authorization": f"Bearer {token}"}
            )
            with urllib.request.urlopen(request, timeout=20) as answer:
                assert f'"role": "{role}"' in answer.read().decode()
        assert len(set(found.values())) == 2
    finally:
        therapy.send_signal(signal.SIGINT)
        code = therapy.wait(DEADLINE_S)
        reader.join(10.0)
        therapy.stdout.close()
    assert code == 130
    assert "all nodes ended in order" in "".join(said)
    with socket.socket() as probe:
        assert probe.connect_ex(("127.0.0.1", port)) != 0
