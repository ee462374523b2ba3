"""Recorded episodes: as Parquet files in the layout of Minari, as datasets of Minari, and back.

`record` needs nothing else; the Parquet files need pyarrow (the extra `datasets`), datasets of Minari
the extra `minari`.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode

from ._setup import Flags, Floats, action_space
from .vector import VectorEnv

_MINARI_LAYOUT = "0.5.4"
"""Version of the Minari layout of the files."""


@dataclass(frozen=True)
class Episode:
    """One episode of n steps."""

    observations: Floats
    """n + 1 rows; the last one is the final observation."""
    actions: Floats
    rewards: Floats
    terminations: Flags
    truncations: Flags
    outcome: str
    """How it ended: reached, fell, burnt, drowned, no_progress or lost."""

    def __len__(self) -> int:
        return len(self.rewards)


def record(
    envs: VectorEnv,
    act: Callable[[Floats, Flags], npt.ArrayLike],
    episodes: int,
    *,
    seed: int | None = None,
) -> list[Episode]:
    """Runs `envs` until this many episodes have ended, and returns these in the order in which they ended.

    `act` gets the observations, and which environments have just begun an episode, and returns actions. The
    environments must reset by themselves. If too many end in the last step, the surplus is left out: long episodes are
    rarer in the result than among all that begin, unless `episodes` is far more than the number of environments.
    """
    if envs.autoreset_mode is AutoresetMode.DISABLED:
        raise ValueError("record needs environments that reset by themselves: use SAME_STEP or NEXT_STEP")
    if episodes < 1:
        raise ValueError(f"episodes is {episodes}, but must be 1 or more")
    begun: list[list[tuple[Any, ...]]] = [[] for _ in range(envs.num_envs)]
    done: list[Episode] = []
    current = envs.reset(seed=seed)[0].copy()
    ended = np.ones(envs.num_envs, np.bool_)
    skips = np.zeros(envs.num_envs, np.bool_)
    while len(done) < episodes:
        actions = np.clip(np.asarray(act(current, ended), np.float32), -1.0, 1.0)
        observations, rewards, terminated, truncated, infos = envs.step(actions)
        ended = terminated | truncated
        is_same_step = envs.autoreset_mode is AutoresetMode.SAME_STEP
        for index in np.flatnonzero(~skips):
            steps = begun[index]
            steps.append((current[index], actions[index], rewards[index], terminated[index], truncated[index]))
            if ended[index]:
                last = infos["final_obs"][index] if is_same_step else observations[index]
                told = infos["final_info"] if is_same_step else infos
                done.append(_episode(steps, last, str(told["outcome"][index])))
                begun[index] = []
        # With next-step autoreset, the step after an end only resets.
        skips = np.zeros_like(ended) if is_same_step else ended
        current = observations.copy()
    return done[:episodes]


def _episode(steps: Sequence[tuple[Any, ...]], last: Floats, outcome: str) -> Episode:
    observations, actions, rewards, terminations, truncations = zip(*steps, strict=True)
    return Episode(
        np.stack([*observations, last]).astype(np.float32),
        np.stack(actions).astype(np.float32),
        np.asarray(rewards, np.float32),
        np.asarray(terminations, np.bool_),
        np.asarray(truncations, np.bool_),
        outcome,
    )


def _observation_space(episodes: Sequence[Episode]) -> Box:
    lengths = {episode.observations.shape[1] for episode in episodes}
    if len(lengths) != 1:
        raise ValueError("there are no episodes, or their observations differ in length")
    return Box(-np.inf, np.inf, (lengths.pop(),), np.float32)


def _space_text(space: Box) -> str:
    """A space as Minari writes it."""
    return json.dumps(
        {
            "type": "Box",
            "dtype": str(space.dtype),
            "shape": list(space.shape),
            "low": space.low.tolist(),
            "high": space.high.tolist(),
        }
    )


def save_parquet(
    episodes: Sequence[Episode], folder: str | os.PathLike[str], *, dataset_id: str = "surefoot/point-goal-v0"
) -> None:
    """Writes episodes as Parquet files, which `minari.MinariDataset(folder)` also reads: a file and metadata per episode.

    Raises FileExistsError if the folder holds something already.
    """
    pa, parquet = _pyarrow()
    observations = _observation_space(episodes)
    home = Path(folder)
    home.mkdir(parents=True, exist_ok=True)
    if any(home.iterdir()):
        raise FileExistsError(f"{home} is not empty: choose another folder")

    def rows(values: Floats, pad: int) -> Any:
        values = np.ascontiguousarray(np.pad(values, ((0, pad), (0, 0))), np.float32)
        return pa.FixedSizeListArray.from_arrays(pa.array(values.reshape(-1)), values.shape[1])

    for index, episode in enumerate(episodes):
        table = pa.table(
            {
                "observations": rows(episode.observations, 0),
                "actions": rows(episode.actions, 1),
                "rewards": np.pad(episode.rewards, (0, 1)),
                "terminations": np.pad(episode.terminations, (0, 1)),
                "truncations": np.pad(episode.truncations, (0, 1)),
            }
        )
        own = home / str(index)
        own.mkdir()
        parquet.write_table(table, own / "part-0.parquet")
        about = {"id": index, "total_steps": len(episode), "outcome": episode.outcome}
        (own / "metadata.json").write_text(json.dumps(about))
    size = sum(file.stat().st_size for file in home.rglob("*") if file.is_file())
    about = {
        "dataset_id": dataset_id,
        "data_format": "parquet",
        "minari_version": _MINARI_LAYOUT,
        "total_episodes": len(episodes),
        "total_steps": sum(map(len, episodes)),
        "observation_space": _space_text(observations),
        "action_space": _space_text(action_space()),
        "dataset_size": round(size / 1e6, 1),
    }
    # Written last, so that a folder without it is incomplete.
    (home / "metadata.json").write_text(json.dumps(about))


def load_parquet(folder: str | os.PathLike[str]) -> list[Episode]:
    """Reads what `save_parquet` wrote."""
    pa, parquet = _pyarrow()
    home = Path(folder)
    about = home / "metadata.json"
    if not about.exists():
        raise FileNotFoundError(f"{about} does not exist: this is not a dataset, or it is incomplete")
    try:
        count = int(json.loads(about.read_text())["total_episodes"])
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{about} is damaged: {error}") from None
    return [_read(parquet, pa, home / str(index)) for index in range(count)]


def _read(parquet: Any, pa: Any, own: Path) -> Episode:
    try:
        outcome = str(json.loads((own / "metadata.json").read_text())["outcome"])
        table = parquet.read_table(own / "part-0.parquet").combine_chunks()

        def rows(name: str) -> Any:
            column = table.column(name).combine_chunks()
            return column.flatten().to_numpy(zero_copy_only=False).reshape(len(table), -1).astype(np.float32)

        def values(name: str) -> Any:
            return table.column(name).to_numpy()[:-1]

        return Episode(
            rows("observations"),
            rows("actions")[:-1],
            values("rewards").astype(np.float32),
            values("terminations").astype(np.bool_),
            values("truncations").astype(np.bool_),
            outcome,
        )
    except FileNotFoundError:
        raise
    except (ValueError, KeyError, TypeError, OSError, pa.ArrowException) as error:
        raise ValueError(f"{own} is damaged: {error}") from None


def _pyarrow() -> tuple[Any, Any]:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise ImportError('this needs pyarrow: pip install pyarrow') from error
    return pyarrow, pyarrow.parquet


def to_minari(episodes: Sequence[Episode], dataset_id: str, **about: Any) -> Any:
    """Creates a Minari dataset and returns it. `about` goes to `create_dataset_from_buffers`."""
    minari = _minari()
    from minari.data_collector.episode_buffer import EpisodeBuffer

    buffers = [
        EpisodeBuffer(
            id=index,
            observations=episode.observations,
            actions=episode.actions,
            rewards=list(episode.rewards),
            terminations=list(episode.terminations),
            truncations=list(episode.truncations),
        )
        for index, episode in enumerate(episodes)
    ]
    dataset = minari.create_dataset_from_buffers(
        dataset_id,
        buffers,
        observation_space=_observation_space(episodes),
        action_space=action_space(),
        **about,
    )
    dataset.storage.update_episode_metadata([{"outcome": episode.outcome} for episode in episodes])
    return dataset


def from_minari(dataset: Any) -> list[Episode]:
    """The episodes of a dataset of Minari that `to_minari` made."""
    indices = [int(index) for index in dataset.episode_indices]
    told: Iterable[dict[str, Any]] = dataset.storage.get_episode_metadata(indices)
    return [
        Episode(
            np.asarray(episode.observations, np.float32),
            np.asarray(episode.actions, np.float32),
            np.asarray(episode.rewards, np.float32),
            np.asarray(episode.terminations, np.bool_),
            np.asarray(episode.truncations, np.bool_),
            _text(about.get("outcome", "")),
        )
        for episode, about in zip(dataset.iterate_episodes(), told, strict=True)
    ]


def _text(value: Any) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)


def _minari() -> Any:
    try:
        import minari
    except ImportError as error:
        raise ImportError('this needs Minari: pip install minari') from error
    return minari
