# SPDX-License-Identifier: Apache-2.0
"""What the commands have in common: a place of their own, options, exit codes."""

import os
import socket
import time
from datetime import datetime, timezone
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from bench import FiniteRange, bench
from screw_module_ros.locks import AlreadyRunning
from screw_module_ros.operator.robot import RobotError
from screw_module_ros.recording.bag import BagError
from screw_module_ros.recording.pseudonym import NAMED_DATE
from screw_module_ros.terminal import Console
from screw_module_ros.trials import runner
from screw_module_ros.trials.runner import Interrupted, command, new_folder
from soak import soak


@pytest.fixture
def places(monkeypatch):
    """Collect places, to release them at the end, before the environment is what it was."""
    taken = []
    yield taken
    for place in reversed(taken):
        place.release()


@pytest.mark.parametrize(("words", "opened"), [([], None), (["--network"], "1")])
def test_each_command_of_the_graph_can_be_opened_to_other_machines(monkeypatch, words, opened):
    monkeypatch.delenv("SCREW_MODULE_NETWORK", raising=False)
    found = []

    @command("mine")
    def mine(console):
        found.append(os.environ.get("SCREW_MODULE_NETWORK"))

    assert CliRunner(env={"SCREW_MODULE_NETWORK": None}).invoke(mine, words).exit_code == 0
    assert found == [opened]


def test_a_domain_that_is_set_is_kept(places, ros_domain_id):
    places.append(runner.own_place())
    assert places[0].domain == ros_domain_id


def test_without_one_a_free_domain_is_taken_and_set(places, monkeypatch):
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    places.append(runner.own_place())
    assert 1 <= places[0].domain <= 100
    assert os.environ["ROS_DOMAIN_ID"] == str(places[0].domain)


def test_nodes_keep_what_they_keep_for_this_run_alone(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    place = runner.own_place()
    folder = Path(os.environ["XDG_STATE_HOME"])
    assert folder.is_dir() and not list(folder.iterdir())
    place.release()
    assert os.environ["XDG_STATE_HOME"] == str(tmp_path) and not folder.exists()


def test_discovery_stays_on_this_machine(places, monkeypatch):
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE", raising=False)
    places.append(runner.own_place())
    assert os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"


def test_two_runs_do_not_share_a_domain(places, monkeypatch):
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    places.append(runner.own_place())
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    monkeypatch.setattr(runner, "_DOMAINS", range(places[0].domain, places[0].domain + 1))
    with pytest.raises(AlreadyRunning, match="every ROS domain"):
        runner.own_place()


def test_a_released_domain_is_free_again(places, monkeypatch):
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    first = runner.own_place()
    first.release()
    assert "ROS_DOMAIN_ID" not in os.environ
    monkeypatch.setattr(runner, "_DOMAINS", range(first.domain, first.domain + 1))
    places.append(runner.own_place())
    assert places[0].domain == first.domain


def test_a_domain_somebody_listens_in_is_left_alone(places, monkeypatch):
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    place = runner.own_place()
    place.release()
    monkeypatch.setattr(runner, "_DOMAINS", range(place.domain, place.domain + 1))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        other.bind(("", 7400 + 250 * place.domain + 10))
        with pytest.raises(AlreadyRunning, match="every ROS domain"):
            runner.own_place()


def carried_out(work, *options):
    """The result of a command that does this."""
    tried = command("tried")(click.option("--strict", is_flag=True)(work))
    return CliRunner().invoke(tried, options)


@pytest.mark.parametrize(
    ("outcome", "code", "said"),
    [
        (RobotError("amplifier is silent"), 1, "tried failed: amplifier is silent"),
        (BagError("no topic"), 1, "tried failed: no topic"),
        (OSError("the disk is full"), 1, "tried failed: the disk is full"),
        (ValueError("-3"), 1, "tried failed: -3"),
        (AlreadyRunning("every domain"), 1, "tried failed: every domain"),
        (Interrupted(), 130, "stopped; all nodes ended in order"),
        (KeyboardInterrupt(), 130, "stopped; all nodes ended in order"),
    ],
)
def test_what_goes_wrong_is_one_sentence_and_an_exit_code(outcome, code, said):
    def work(console, strict):
        raise outcome

    result = carried_out(work)
    assert (result.exit_code, result.output.strip()) == (code, said)


def test_a_missed_figure_counts_only_when_it_is_asked_for():
    for reached, strict, code in ((False, True, 3), (False, False, 0), (True, True, 0)):
        result = carried_out(lambda console, strict, r=reached: r, *["--strict"] * strict)
        assert result.exit_code == code


def test_a_defect_is_no_sentence():
    def work(console, strict):
        raise TypeError("a defect")

    assert isinstance(carried_out(work).exception, TypeError)


def test_a_failure_names_the_folder_of_its_output(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_LOG_DIR", "")

    def work(console, strict):
        new_folder(tmp_path, console)
        raise RobotError("it ended")

    result = carried_out(work)
    (folder,) = tmp_path.iterdir()
    assert str(folder) in result.output.replace("\n", "")
    assert os.environ["ROS_LOG_DIR"] == str(folder / "log")


def test_the_folder_of_a_run_is_named_by_utc_as_a_bag_is(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_LOG_DIR", "")
    before = datetime.now(timezone.utc).replace(microsecond=0)
    monkeypatch.setenv("TZ", "Asia/Kolkata")
    time.tzset()
    folder = new_folder(tmp_path, Console(quiet=True))
    monkeypatch.undo()
    time.tzset()
    named = datetime.strptime(folder.name, f"{NAMED_DATE}%z")
    assert before <= named <= datetime.now(timezone.utc) and folder.name.endswith("Z")


@pytest.mark.parametrize(
    ("tried", "option"),
    [(soak, "--minutes"), (soak, "--every"), (soak, "--change"), (bench, "--seconds")],
)
@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e400"])
def test_what_is_no_finite_number_is_refused_by_name(tried, option, value, monkeypatch):
    monkeypatch.setattr(tried, "callback", lambda **given: pytest.fail(f"{given}"))
    result = CliRunner().invoke(tried, [option, value])
    assert result.exit_code == 2
    assert option in result.output


def test_a_number_in_its_range_is_taken():
    assert FiniteRange(0.1, 6000.0).convert("2.5", None, None) == 2.5


def test_a_file_that_cannot_be_written_is_refused_before_the_work(tmp_path, monkeypatch):
    """Else the figures of many minutes would be lost at the end."""
    taken = []
    monkeypatch.setattr(bench, "callback", lambda **given: taken.append(given))
    monkeypatch.chdir(tmp_path)
    for file in (tmp_path / "none" / "x.json", tmp_path):
        result = CliRunner().invoke(bench, ["--json", str(file)])
        assert result.exit_code == 2
        assert "--json" in result.output and str(file) in result.output
    assert not taken
    for file in ("x.json", str(tmp_path / "y.json")):
        assert CliRunner().invoke(bench, ["--json", file]).exit_code == 0
    assert len(taken) == 2 and not list(tmp_path.iterdir())
