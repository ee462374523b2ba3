"""Recorded episodes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import surefoot
from surefoot import datasets
from surefoot.datasets import Episode


def assert_equal(ones: list[Episode], others: list[Episode]) -> None:
    assert len(ones) == len(others)
    for one, other in zip(ones, others, strict=True):
        assert one.outcome == other.outcome
        for name in ("observations", "actions", "rewards", "terminations", "truncations"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name), name)


@pytest.fixture(scope="module")
def episodes(islands: surefoot.Level) -> list[Episode]:
    envs = surefoot.VectorEnv(6, islands, goal_distance=(2, 8), autoreset_mode=AutoresetMode.SAME_STEP)
    policy = surefoot.Policy.load()
    return datasets.record(envs, lambda observations, begun: policy.act(observations, reset=begun), 20, seed=1)


@pytest.mark.parametrize("mode", [AutoresetMode.SAME_STEP, AutoresetMode.NEXT_STEP])
def test_episodes_are_whole(mode: AutoresetMode, islands: surefoot.Level) -> None:
    envs = surefoot.VectorEnv(6, islands, goal_distance=(2, 8), autoreset_mode=mode)
    rng = np.random.default_rng(0)
    recorded = datasets.record(envs, lambda observations, _: rng.uniform(-1, 1, (6, 4)), 15, seed=1)
    assert len(recorded) == 15
    for episode in recorded:
        assert len(episode.observations) == len(episode) + 1 and len(episode.actions) == len(episode)
        ends = episode.terminations | episode.truncations
        assert ends[-1] and not ends[:-1].any()
        assert episode.truncations[-1] == (episode.outcome == "no_progress")
        # The observation tells what the last action was.
        np.testing.assert_allclose(episode.observations[1:, 332:336], episode.actions, atol=1e-6)


def test_parquet_files_give_back_what_was_recorded(episodes: list[Episode], tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    datasets.save_parquet(episodes, tmp_path / "runs")
    assert_equal(datasets.load_parquet(tmp_path / "runs"), episodes)
    with pytest.raises(FileExistsError, match="is not empty"):
        datasets.save_parquet(episodes, tmp_path / "runs")


def test_minari_reads_the_parquet_files(episodes: list[Episode], tmp_path: Path) -> None:
    minari = pytest.importorskip("minari")
    pytest.importorskip("pyarrow")
    datasets.save_parquet(episodes, tmp_path / "runs")
    dataset = minari.MinariDataset(tmp_path / "runs")
    assert dataset.total_steps == sum(map(len, episodes))
    assert_equal(datasets.from_minari(dataset), episodes)


def test_minari_keeps_datasets(episodes: list[Episode], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    minari = pytest.importorskip("minari")
    pytest.importorskip("h5py")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    datasets.to_minari(episodes, "surefoot/test-v0")
    assert_equal(datasets.from_minari(minari.load_dataset("surefoot/test-v0")), episodes)


def test_damaged_files_are_told_from_sound_ones(episodes: list[Episode], tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    with pytest.raises(FileNotFoundError, match="this is not a dataset"):
        datasets.load_parquet(tmp_path)
    datasets.save_parquet(episodes, tmp_path / "runs")
    file = tmp_path / "runs/3/part-0.parquet"
    file.write_bytes(file.read_bytes()[:-40])
    with pytest.raises(ValueError, match="3 is damaged"):
        datasets.load_parquet(tmp_path / "runs")


def test_environments_that_wait_cannot_be_recorded(islands: surefoot.Level) -> None:
    envs = surefoot.VectorEnv(1, islands, autoreset_mode=AutoresetMode.DISABLED)
    with pytest.raises(ValueError, match="reset by themselves"):
        datasets.record(envs, lambda observations, _: np.zeros((1, 4)), 1)
