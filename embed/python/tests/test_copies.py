"""Copies and pickles."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import surefoot


def test_graphs_survive_pickles_with_their_levels(level: surefoot.Level) -> None:
    graph = surefoot.Graph.build(level, vertices=30)
    other = pickle.loads(pickle.dumps(graph))
    ends = graph.vertices[0], graph.vertices[20]
    np.testing.assert_array_equal(other.vertices, graph.vertices)
    np.testing.assert_array_equal(other.plan(*ends).waypoints, graph.plan(*ends).waypoints)
    assert other.plan(*ends).seconds == graph.plan(*ends).seconds
    assert other.png() == graph.png()


def test_levels_and_graphs_never_change_so_copies_are_themselves(level: surefoot.Level) -> None:
    for each in (level, surefoot.Graph.build(level, vertices=10)):
        assert copy.copy(each) is each and copy.deepcopy(each) is each


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda level: surefoot.VectorEnv(2, level), "make others with the same arguments and seed"),
        (surefoot.PointGoalEnv, "make others with the same arguments and seed"),
        (lambda level: surefoot.BufferEnv(2, level), "make others with the same arguments and seed"),
        (lambda level: surefoot.ParallelEnv(2, level), "make others with the same arguments and seed"),
        (lambda _: surefoot.Policy.load(), "load the policy again"),
    ],
    ids=["vector", "single", "buffer", "parallel", "policy"],
)
def test_what_cannot_be_copied_says_what_to_do(
    make: Callable[[surefoot.Level], Any], match: str, level: surefoot.Level
) -> None:
    made = make(level)
    for duplicate in (copy.deepcopy, pickle.dumps):
        with pytest.raises(TypeError, match=match):
            duplicate(made)
