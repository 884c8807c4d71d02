# SPDX-License-Identifier: Apache-2.0
"""The environments: gymnasium's own checks, seeds, and that a movement is a session's."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from screw_module_ros.gym.course import Carried, Course
from screw_module_ros.gym.environment import (
    ACTIONS,
    OBSERVATIONS,
    TASKS,
    TherapyEnv,
)
from screw_module_ros.gym.loop import PERIOD
from screw_module_ros.plant.settings import arm_of, load_world
from screw_module_ros.therapy.adaptation import Assistance
from screw_module_ros.therapy.hand import HandSample
from screw_module_ros.therapy.protocol import REACH, TrialPlan
from screw_module_ros.therapy.trial import TrialCourse

pytestmark = pytest.mark.long  # compiles, seconds for each space
PAGE = Path(__file__).parents[2] / "docs/gym.md"
USUAL = np.array([0.0, 100.0, 1.4])


def episode(env, seed, actions=(USUAL,) * 2):
    """Return observations, rewards and samples of an episode's first movements."""
    seen = [env.reset(seed=seed)[0]]
    rewards, rows = [], []
    for action in actions:
        observation, reward, *_ = env.step(action)
        seen.append(observation)
        rewards.append(reward)
        rows.append(env.unwrapped.course.rows)
    return np.array(seen), rewards, np.concatenate(rows)


@pytest.mark.parametrize("task", TASKS)
def test_gymnasium_finds_nothing_to_say(task):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", ".*symmetric and normalized")  # ours has units
        env = gymnasium.make(f"screw_module_ros.gym:screw_module_ros/{task}-v0").unwrapped
        check_env(env, skip_render_check=True)


@pytest.mark.parametrize("task", ["height", "space"])
def test_the_same_seed_is_the_same_episode_bit_for_bit(task):
    env = TherapyEnv(task, patients=("weak", "spastic", "tremor"), spread=0.3, rigs=True)
    first, again, other = (episode(env, seed) for seed in (5, 5, 6))
    for one, two in zip(first, again, strict=True):
        assert np.array_equal(one, two)
    assert not np.array_equal(first[0], other[0])


def test_an_episode_ends_after_the_blocks_last_movement():
    env = TherapyEnv("lift", patients=("healthy",), circuits=1)
    env.reset(seed=1)
    ends = [env.step(np.array([20.0, 100.0, 1.4]))[2:4] for _ in range(8)]
    assert ends == [(False, False)] * 7 + [(True, False)]


def test_a_hand_that_comes_to_no_start_ends_the_episode_as_it_pauses_a_session():
    """All of an arm of 60 N hangs on the handle, and nothing carries it."""
    env = TherapyEnv("height", patients=("flaccid",), traits={"weight": 60.0})
    env.reset(seed=1)
    assert env.step(USUAL)[1:4] == (0.0, False, True)


def test_actions_beyond_the_ranges_count_as_their_ends():
    env = TherapyEnv("reach", patients=("weak",), traits={"weight": 6.0})
    env.reset(seed=1)
    told = env.step(np.array([25.0, 9000.0, -1.0]))[4]
    assert (told["support"], told["side_stiffness"], told["duration"]) == (8.0, 300.0, 0.7)
    assert env.course.rows[:, 13].max() == pytest.approx(8.0)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"task": "dance"}, "task = 'dance': one of height"),
        ({"patients": ("nobody",)}, "patient = 'nobody'"),
        ({"traits": {"charm": 1.0}}, "trait 'charm' is unknown"),
    ],
)
def test_what_is_unknown_is_told(wrong, told):
    with pytest.raises(ValueError, match=told):
        TherapyEnv(**wrong)


def test_a_vector_of_environments_is_each_of_them():
    both = gymnasium.make_vec(
        "screw_module_ros.gym:screw_module_ros/height-v0", 2, vectorization_mode="sync"
    )
    both.reset(seed=[3, 4])
    seen = both.step(np.array([USUAL, USUAL]))[0]
    env = TherapyEnv("height")
    for number, seed in enumerate((3, 4)):
        assert np.array_equal(episode(env, seed, (USUAL,))[0][-1], seen[number])


# The session's course -----------------------------------------------------------------------------


def hand(row):
    now_ns = round(row[0] / PERIOD) * 1_000_000
    return HandSample(now_ns // 1_000_000, now_ns, *row[1:10].tolist(), support=row[13])


@pytest.mark.parametrize(
    ("task", "patient", "by"),
    [
        ("height", "weak", Carried(0.7, 100.0, 0.0)),
        ("reach", "healthy", Carried(3.0, 50.0, 0.0)),
        ("reach", "severe", Carried(0.7, 100.0, 0.0)),
        ("space", "spastic", Carried(1.0, 300.0, 5.0)),
        ("circle", "weak", Carried(1.4, 100.0, 0.0)),
        ("lift", "synergy", Carried(1.4, 100.0, 10.0)),
    ],
)
def test_a_sessions_own_course_ends_in_the_same_sample_with_the_same_measures(task, patient, by):
    env = TherapyEnv(task, patients=(patient,))
    env.reset(seed=2)
    protocol, number = env.protocol, TASKS[task][1]
    course = Course(protocol, env.block, arm_of(patient), load_world(), 2, env.course.law)
    start, target = protocol.centre, (0.0, 0.14, 0.18)
    if task != "reach":
        (start, target), *_ = env.ways
    found = course.move(start, target, by)
    assistance = Assistance(by.duration, by.side_stiffness)
    theirs = TrialCourse(protocol, TrialPlan(1, number, 1, start, target), assistance)
    samples = [hand(row) for row in course.rows]
    settle_ns = round(protocol.rules.settle_time * 1e9)
    theirs.take(samples[0]._replace(time_ns=samples[0].time_ns - settle_ns))
    for sample in samples:
        assert theirs.result is None, "theirs ended earlier"
        theirs.take(sample)
    assert theirs.result is not None, "theirs has not ended"
    assert theirs.result["reached"] == found["reached"]
    same = ("pm2a", "pm2b", "pm3", "pm4", "effort") if env.block.kind == REACH else ()
    for name in same:
        assert found[name] == pytest.approx(theirs.result[name], rel=1e-6, abs=1e-12), name


# What is documented -------------------------------------------------------------------------------


def test_the_page_names_every_number_with_its_unit_and_range():
    page = PAGE.read_text("utf-8")
    rows = re.findall(r"^\| `(\w+)` \| (\S*) \| (-?[\d.]+) to (-?[\d.]+) \|", page, re.MULTILINE)
    told = {name: (unit, float(low), float(high)) for name, unit, low, high in rows}
    wanted = {**ACTIONS, **OBSERVATIONS}
    assert told == {name: (s.unit, s.low, s.high) for name, s in wanted.items()}
    assert all(f"`{task}`" in page for task in TASKS)
