"""The environments of Gymnasium."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
from functools import partial
from threading import Thread
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import surefoot


def actions(count: int, steps: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1, 1, (steps, count, 4)).astype(np.float32)


def play(envs: surefoot.VectorEnv, steps: int, seed: int = 5) -> list[Any]:
    observations, _ = envs.reset(seed=seed)
    trace: list[Any] = [observations]
    for action in actions(envs.num_envs, steps):
        trace.append(envs.step(action))
    return trace


def assert_same(one: list[Any], other: list[Any]) -> None:
    np.testing.assert_array_equal(one[0], other[0])
    for mine, theirs in zip(one[1:], other[1:], strict=True):
        for left, right in zip(mine[:4], theirs[:4], strict=True):
            np.testing.assert_array_equal(left, right)


def test_gymnasium_accepts_a_single_environment() -> None:
    env = gymnasium.make("surefoot/PointGoal-v0", level={"seed": 7, "size": 60})
    check_env(env.unwrapped)
    env.close()


def test_a_process_that_does_not_import_the_package_makes_an_environment_by_a_name_that_does() -> None:
    code = "import gymnasium; print(gymnasium.make('surefoot:surefoot/PointGoal-v0', level=7).observation_space.shape)"
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", code], capture_output=True, check=True, text=True)
    assert done.stdout.strip() == "(369,)"


def test_spawned_processes_know_the_environments(level: surefoot.Level) -> None:
    # Nothing that is sent to these processes imports the package, except the name.
    by_name = partial(gymnasium.make, "surefoot:surefoot/PointGoal-v0", level={"seed": 7, "size": 60})
    alone = surefoot.PointGoalEnv(level)
    first = np.stack([alone.reset(seed=seed)[0] for seed in (1, 2)])
    for envs in (
        gymnasium.vector.AsyncVectorEnv([by_name] * 2, context="spawn"),
        gymnasium.make_vec(
            "surefoot/PointGoal-v0", 2, "async", vector_kwargs={"context": "spawn"}, level={"seed": 7, "size": 60}
        ),
    ):
        np.testing.assert_array_equal(envs.reset(seed=[1, 2])[0], first)
        envs.close()


@pytest.mark.parametrize("use", ["generate", "pickle", "draw", "step", "build"])
def test_forked_processes_can_do_what_their_parent_did(use: str, level: surefoot.Level) -> None:
    envs = surefoot.VectorEnv(128, level)
    run = {
        "generate": lambda: surefoot.Level.generate(8, size=60),
        "pickle": lambda: pickle.loads(pickle.dumps(level)),
        "draw": lambda: level.png(),
        "step": lambda: (envs.reset(), envs.step(np.zeros((128, 4)))),
        "build": lambda: surefoot.Graph.build(level, vertices=10),
    }[use]
    run()
    child = os.fork()
    if child == 0:
        signal.alarm(60)
        try:
            run()
            os._exit(0)
        finally:
            os._exit(1)
    assert os.waitpid(child, 0)[1] == 0


def test_make_vec_uses_the_vector_environment(level: surefoot.Level) -> None:
    envs = gymnasium.make_vec("surefoot/PointGoal-v0", num_envs=6, level=level)
    assert isinstance(envs, surefoot.VectorEnv)
    assert envs.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    observations, infos = envs.reset(seed=1)
    assert observations in envs.observation_space and infos == {}
    observations, rewards, terminated, truncated, _ = envs.step(envs.action_space.sample())
    assert observations in envs.observation_space
    assert rewards.shape == terminated.shape == truncated.shape == (6,)
    assert terminated.dtype == truncated.dtype == np.bool_


def test_gymnasiums_own_vector_environments_hold_single_ones(level: surefoot.Level) -> None:
    envs = gymnasium.make_vec("surefoot/PointGoal-v0", num_envs=2, vectorization_mode="sync", level=level)
    observations, _ = envs.reset(seed=1)
    assert observations in envs.observation_space


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_the_same_seed_gives_the_same_bits_on_any_number_of_threads(mode: AutoresetMode, islands: surefoot.Level) -> None:
    def make(threads: int) -> surefoot.VectorEnv:
        return surefoot.VectorEnv(
            22, islands, worlds=4, threads=threads, autoreset_mode=mode, goal_distance=(2, 8), others=True
        )

    steps = 1 if mode is AutoresetMode.DISABLED else 150
    assert_same(play(make(1), steps), play(make(1), steps))
    assert_same(play(make(1), steps), play(make(3), steps))


@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("movers", ["none", "all,crates=2"])
def test_one_world_gives_the_same_bits_on_any_number_of_threads(mode: AutoresetMode, movers: str) -> None:
    level = surefoot.Level.generate(3, size=60, kind="islands", movers=movers)
    made = [
        surefoot.VectorEnv(100, level, threads=threads, autoreset_mode=mode, goal_distance=(2, 8))
        for threads in (1, 3, None)
    ]
    traces = [play(envs, 1 if mode is AutoresetMode.DISABLED else 60) for envs in made]
    assert_same(traces[0], traces[1])
    assert_same(traces[0], traces[2])
    mask = np.arange(100) % 3 == 0
    for change in (
        lambda envs: envs.reset(options={"reset_mask": mask})[0],
        lambda envs: envs.redirect(70, envs.goals()[:2], start=envs.positions()[3]),
        lambda envs: envs.positions(),
        lambda envs: envs.goals(),
    ):
        alone, *others = (change(envs) for envs in made)
        for other in others:
            np.testing.assert_array_equal(other, alone)


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="there is one core")
def test_by_default_one_world_uses_several_cores(level: surefoot.Level) -> None:
    def threads_in_a_step(**arguments: Any) -> int:
        envs = surefoot.VectorEnv(1024, level, **arguments)
        envs.reset(seed=1)
        steps = Thread(target=lambda: [envs.step(action) for action in actions(1024, 10)])
        before = len(os.listdir("/proc/self/task"))
        steps.start()
        most = 0
        while steps.is_alive():
            most = max(most, len(os.listdir("/proc/self/task")) - before)
        return most

    # The thread that Python started is one of them.
    assert threads_in_a_step(threads=1) == 1
    assert threads_in_a_step() > 1


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_an_environment_with_its_own_seed_has_the_episodes_that_it_has_alone(
    mode: AutoresetMode, islands: surefoot.Level
) -> None:
    def make(count: int) -> surefoot.VectorEnv:
        return surefoot.VectorEnv(count, islands, goal_distance=(2, 8), autoreset_mode=mode)

    seeds = [11, 5, 11]
    together, alone = make(3), [make(1) for _ in seeds]
    first = together.reset(seed=seeds)[0]
    for row, env, seed in zip(first, alone, seeds, strict=True):
        np.testing.assert_array_equal(row, env.reset(seed=seed)[0][0])
    np.testing.assert_array_equal(first[0], first[2])
    ends = 0
    for action in actions(3, 150):
        step = together.step(action)
        ends += int((step[2] | step[3]).sum())
        for index, env in enumerate(alone):
            for mine, theirs in zip(step[:4], env.step(action[index : index + 1])[:4], strict=True):
                np.testing.assert_array_equal(mine[index], theirs[0])
    assert ends > 3, "episodes end"
    np.testing.assert_array_equal(together.reset()[0][1], alone[1].reset()[0][0])
    with_none = make(2).reset(seed=[5, None])[0]
    np.testing.assert_array_equal(with_none[0], first[1])
    assert not np.array_equal(with_none[1], first[1])


def test_other_seeds_give_other_episodes(level: surefoot.Level) -> None:
    envs = surefoot.VectorEnv(4, level)
    first, second = envs.reset(seed=1)[0], envs.reset(seed=2)[0]
    assert not np.array_equal(first, second)
    np.testing.assert_array_equal(envs.reset(seed=1)[0], first)
    assert not np.array_equal(envs.reset()[0], first)


def test_next_step_shows_the_last_observation_and_then_the_first_of_the_next_episode(islands: surefoot.Level) -> None:
    envs = surefoot.VectorEnv(16, islands, goal_distance=(2, 8))
    same = surefoot.VectorEnv(16, islands, goal_distance=(2, 8), autoreset_mode=AutoresetMode.SAME_STEP)
    envs.reset(seed=3)
    same.reset(seed=3)
    ended = np.zeros(16, np.bool_)
    count = 0
    for action in actions(16, 120):
        observations, rewards, terminated, truncated, infos = envs.step(action)
        assert not (terminated & truncated).any()
        assert (rewards[ended] == 0).all(), "a reset earns nothing"
        assert not (terminated | truncated)[ended].any(), "the action of a reset is ignored"
        for index in np.flatnonzero(ended):
            goal = envs.goals()[index] - envs.positions()[index]
            assert np.linalg.norm(goal) > 1.0, "a new episode begins away from its goal"
        ended = terminated | truncated
        assert ("outcome" in infos) == ended.any()
        if infos:
            np.testing.assert_array_equal(infos["_outcome"], ended)
            outcomes = set(infos["outcome"][truncated])
            assert outcomes <= {"no_progress"}
        count += int(ended.sum())
    assert count > 10, "episodes end"
    first_ends = None
    for action in actions(16, 120):
        *_, infos = same.step(action)
        if infos and first_ends is None:
            first_ends = infos
    assert first_ends is not None
    mask = first_ends["_final_obs"]
    assert all(observation.shape == (369,) for observation in first_ends["final_obs"][mask])
    assert set(first_ends["final_info"]["outcome"][mask]) <= {"reached", "fell", "burnt", "drowned", "no_progress"}


def test_next_step_and_same_step_agree_until_the_first_end(islands: surefoot.Level) -> None:
    traces = [
        play(surefoot.VectorEnv(8, islands, autoreset_mode=mode), 40)
        for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP)
    ]
    for mine, theirs in zip(traces[0][1:], traces[1][1:], strict=True):
        np.testing.assert_array_equal(mine[1], theirs[1])
        np.testing.assert_array_equal(mine[2], theirs[2])
        ended = mine[2] | mine[3]
        np.testing.assert_array_equal(mine[0][~ended], theirs[0][~ended])
        if ended.any():
            for index in np.flatnonzero(ended):
                np.testing.assert_array_equal(mine[0][index], theirs[4]["final_obs"][index])
            return
    pytest.fail("no episode ended")


def test_disabled_environments_wait_for_their_reset(islands: surefoot.Level) -> None:
    envs = surefoot.VectorEnv(8, islands, goal_distance=(2, 6), autoreset_mode=AutoresetMode.DISABLED)
    envs.reset(seed=2)
    for action in actions(8, 200):
        observations, _, terminated, truncated, _ = envs.step(action)
        ended = terminated | truncated
        if ended.any():
            break
    with pytest.raises(ResetNeeded, match="has ended"):
        envs.step(action)
    after, _ = envs.reset(options={"reset_mask": ended})
    np.testing.assert_array_equal(after[~ended], observations[~ended])
    assert not np.array_equal(after[ended], observations[ended])
    envs.step(action)


def test_without_progress_an_episode_is_truncated_and_not_terminated(level: surefoot.Level) -> None:
    envs = surefoot.VectorEnv(3, level)
    envs.reset(seed=1)
    for step in range(1, 301):
        _, _, terminated, truncated, infos = envs.step(np.zeros((3, 4), np.float32))
        if truncated.any():
            break
    assert step == 300
    assert truncated.all() and not terminated.any()
    assert list(infos["outcome"]) == ["no_progress"] * 3


def test_bodies_levels_and_worlds_can_be_chosen(level: surefoot.Level, islands: surefoot.Level) -> None:
    envs = surefoot.VectorEnv(5, [level, islands, 3], body={"height": 1.2, "forward_speed": 6.0}, worlds=4)
    assert envs.reset(seed=0)[0].shape == (5, 369)
    assert surefoot.VectorEnv(2, level, body="unity", others=True).reset()[0].shape == (2, 461)
    assert "climber" in surefoot.body_names()


def test_movers_kinds_and_features_are_part_of_a_level() -> None:
    level = surefoot.Level.generate(4, size=(80, 60, 70), kind="interior", features={"pads": 2}, movers={"doors": 2})
    assert level.size == (80, 60, 70) and level.kind == "interior" and level.seed == 4
    assert level.features["movers"] > 0
    assert surefoot.VectorEnv(2, level).reset()[0].shape == (2, 369)


def test_copies_are_kept_and_buffers_are_reused(level: surefoot.Level) -> None:
    copying, reusing = surefoot.VectorEnv(2, level), surefoot.VectorEnv(2, level, copy=False)
    first = copying.reset(seed=1)[0]
    kept = first.copy()
    copying.step(np.ones((2, 4), np.float32))
    np.testing.assert_array_equal(first, kept)
    assert reusing.reset(seed=1)[0] is reusing.step(np.ones((2, 4), np.float32))[0]


def test_a_route_leads_through_its_places(level: surefoot.Level) -> None:
    envs = surefoot.VectorEnv(2, level, autoreset_mode=AutoresetMode.DISABLED)
    envs.reset(seed=1)
    goals = envs.goals()
    way = [goals[1], goals[0]]
    observation = envs.redirect(0, way, start=envs.positions()[0])
    assert observation.shape == (369,)
    np.testing.assert_array_equal(envs.goals()[0], goals[0])


def test_levels_survive_files_bytes_and_pickles(level: surefoot.Level, tmp_path: Any) -> None:
    level.save(tmp_path / "level.sfmap")
    for other in (
        surefoot.Level.load(tmp_path / "level.sfmap"),
        surefoot.Level.from_bytes(level.to_bytes()),
        pickle.loads(pickle.dumps(level)),
        surefoot.Level.generate(7, size=60),
    ):
        assert other == level and hash(other) == hash(level) and other.hash == level.hash
    assert level._repr_png_().startswith(b"\x89PNG")
    assert level.png(pixels_per_m=1.0, view="iso").startswith(b"\x89PNG")
