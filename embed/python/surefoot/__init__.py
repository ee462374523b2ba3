"""Surefoot for Python: environments, plans and policies of NPCs that reach their goals.

    import gymnasium, surefoot
    envs = gymnasium.make_vec("surefoot/PointGoal-v0", num_envs=64)

`VectorEnv` and `PointGoalEnv` are environments of Gymnasium, `ParallelEnv` is one of PettingZoo, and `BufferEnv` writes
into your arrays.
"""

from __future__ import annotations

import pkgutil
from typing import TYPE_CHECKING, Any

import gymnasium

from ._native import VERSION, Arrival, Graph, Leg, Level, Plan, Policy, Server, body_names, connect, state_fields
from .buffers import BufferEnv
from .single import PointGoalEnv
from .vector import VectorEnv

if TYPE_CHECKING:
    from .parallel import ParallelEnv

# Stubs of the gRPC contracts, which users generate, are packages below this one: `surefoot.world.v1`.
__path__ = pkgutil.extend_path(__path__, __name__)
__version__ = VERSION
__all__ = [
    "Arrival",
    "BufferEnv",
    "Graph",
    "Leg",
    "Level",
    "ParallelEnv",
    "Plan",
    "PointGoalEnv",
    "Policy",
    "Server",
    "VectorEnv",
    "body_names",
    "connect",
    "state_fields",
]

gymnasium.register(
    id="surefoot/PointGoal-v0",
    entry_point="surefoot.single:PointGoalEnv",
    vector_entry_point="surefoot.vector:VectorEnv",
)


def __getattr__(name: str) -> Any:
    # PettingZoo is optional.
    if name == "ParallelEnv":
        from .parallel import ParallelEnv

        return ParallelEnv
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
