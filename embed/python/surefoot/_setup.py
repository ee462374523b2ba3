"""Arguments that all kinds of environments share, and the worlds that they describe."""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box

from ._native import ACTION_LEN, OBSERVATION_LEN, OBSERVATION_WITH_OTHERS_LEN, Level, Server, Worlds, connect

Floats: TypeAlias = npt.NDArray[np.float32]
Flags: TypeAlias = npt.NDArray[np.bool_]
LevelLike: TypeAlias = "Level | int | str | os.PathLike[str] | Mapping[str, Any]"
"""A level, the seed of a generated map, a level's file, or the arguments of `Level.generate` as a dict."""
BodyLike: TypeAlias = str | Mapping[str, float | int | bool]
"""The name of a body, or the fields of its profile that differ from the default."""


def level_of(level: LevelLike) -> Level:
    """The level that `level` describes."""
    if isinstance(level, Level):
        return level
    if isinstance(level, bool):
        raise TypeError("level is a bool: give a seed, a file or a Level")
    if isinstance(level, (int, np.integer)):
        return Level.generate(int(level))
    if isinstance(level, Mapping):
        arguments = dict(level)
        if "seed" not in arguments:
            raise ValueError("level has no seed: give {'seed': 0, ...}, the arguments of Level.generate")
        return Level.generate(arguments.pop("seed"), **arguments)
    return Level.load(level)


def levels_of(level: LevelLike | Sequence[LevelLike]) -> list[Level]:
    """All levels that `level` describes."""
    if isinstance(level, (list, tuple)):
        return [level_of(each) for each in level]
    return [level_of(level)]  # type: ignore[arg-type]


def body_text(body: BodyLike) -> str:
    """A body as the native module reads it."""
    return body if isinstance(body, str) else json.dumps(dict(body))


def server_of(server: Server | str | None) -> Server | None:
    """The server that `server` names."""
    return connect(server) if isinstance(server, str) else server


def fresh_seed() -> int:
    """A random seed."""
    return secrets.randbits(63)


def checked_seed(seed: int) -> int:
    """A seed in range."""
    if not isinstance(seed, (int, np.integer)) or not 0 <= seed < 2**64:
        raise ValueError(f"seed is {seed!r}, but must be a whole number, 0 to 2**64 - 1")
    return int(seed)


def observation_space(others: bool) -> Box:
    """Space of an observation: 369 values, or 461 with other bodies. Nearly all are in [-1, 1]."""
    length = OBSERVATION_WITH_OTHERS_LEN if others else OBSERVATION_LEN
    return Box(-np.inf, np.inf, (length,), np.float32)


def action_space() -> Box:
    """Space of an action: forward, strafe, turn, jump."""
    return Box(-1.0, 1.0, (ACTION_LEN,), np.float32)


@dataclass(frozen=True)
class Setup:
    """Arguments of environments, checked by the native module."""

    levels: tuple[Level, ...]
    body: str
    others: bool
    num_envs: int
    worlds: int
    goal_distance: tuple[float, float]
    autoreset: str
    threads: int | None
    server: Server | None = None

    def level_of(self, env: int) -> Level:
        """The level of an environment."""
        each, more = divmod(self.num_envs, self.worlds)
        world = env // (each + 1) if env < more * (each + 1) else (env - more) // each
        return self.levels[world % len(self.levels)]

    def open(self, seed: int) -> Worlds:
        """Opens the worlds, here or on the server."""
        seed = checked_seed(seed)
        if self.server is not None and self.threads is not None:
            raise ValueError("threads applies to environments of this process: a server has its own threads")
        return Worlds(
            self.levels,
            self.body,
            self.others,
            self.num_envs,
            self.worlds,
            self.goal_distance,
            self.autoreset,
            seed,
            self.threads,
            self.server,
        )


def thread_count(threads: int | None) -> int | None:
    """The greatest number of threads; `None` for all cores."""
    return None if threads is None else whole("threads", threads)


def whole(name: str, value: int) -> int:
    """A count, 1 or more."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
        raise ValueError(f"{name} is {value!r}, but must be a whole number, 1 or more")
    return int(value)


def distances(value: Sequence[float]) -> tuple[float, float]:
    """A band of distances."""
    try:
        nearest, farthest = value
        return float(nearest), float(farthest)
    except (TypeError, ValueError):
        raise ValueError(f"goal_distance is {value!r}, but must be two distances in m, such as (5, 25)") from None


