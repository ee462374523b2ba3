"""Graphs, plans and policies."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import surefoot


@pytest.fixture(scope="module")
def graph(level: surefoot.Level) -> surefoot.Graph:
    return surefoot.Graph.build(level, vertices=60)


def test_a_plan_leads_from_start_to_goal(graph: surefoot.Graph, level: surefoot.Level) -> None:
    envs = surefoot.VectorEnv(20, level, goal_distance=(20, 80))
    envs.reset(seed=1)
    plans = [graph.plan(start, goal) for start, goal in zip(envs.positions(), envs.goals(), strict=True)]
    found = [plan for plan in plans if plan]
    assert len(found) > 15
    for plan in found:
        assert plan.no_path is None and plan.waypoints.shape == (len(plan.legs), 3)
        assert plan.legs[0].from_vertex is None and plan.legs[-1].to_vertex is None
        assert 0 < plan.chance <= 1 and plan.seconds > 0 and 0 <= plan.death_chance < 1
    on_foot = [graph.plan(*ends, without=["jump", "double_jump", "pad", "zip_line"]) for ends in zip(envs.positions(), envs.goals())]
    assert all(leg.ability == "walk" for plan in on_foot if plan for leg in plan.legs)


def test_many_places_have_the_plans_of_each_pair(graph: surefoot.Graph) -> None:
    here, places = graph.vertices[0], graph.vertices
    for is_start in (True, False):
        ranked = graph.rank(places, start=here) if is_start else graph.rank(places, goal=here)
        assert sorted(place.index for place in ranked) == list(range(len(graph)))
        for place in ranked:
            other = places[place.index]
            plan = graph.plan(here, other) if is_start else graph.plan(other, here)
            assert (bool(place), place.no_path) == (bool(plan), plan.no_path)
            if place:
                assert place.seconds == pytest.approx(plan.seconds, rel=1e-3)
                assert place.chance == pytest.approx(plan.chance, rel=1e-3)
        costs = [place.cost for place in ranked]
        assert costs == sorted(costs)
    quickest = graph.rank(places, start=here, by="seconds", best=3)
    assert len(quickest) == 3 and quickest[0].seconds <= quickest[2].seconds
    with pytest.raises(ValueError, match="start or goal"):
        graph.rank(places)
    with pytest.raises(ValueError, match="start or goal"):
        graph.rank(places, start=here, goal=here)


def test_more_is_reached_in_more_time(graph: surefoot.Graph) -> None:
    few, times = graph.reachable(graph.vertices[0], 3.0)
    many, _ = graph.reachable(graph.vertices[0], 60.0)
    assert set(few) <= set(many) and len(many) > len(few) and times.max() <= 3.0


def test_plans_keep_out_of_zones(graph: surefoot.Graph) -> None:
    start, goal = graph.vertices[0].tolist(), graph.vertices[20].tolist()
    free = graph.plan(start, goal)
    x, y, z = goal
    vault = {"name": "vault", "bottom": [x, y - 1, z], "radius": 1.5, "height": 3, "only_with_tag": "key"}
    assert graph.plan(start, goal, zones=[vault]).no_path == "goal_in_zone"
    np.testing.assert_array_equal(graph.plan(start, goal, zones=[vault], tags=["key"]).waypoints, free.waypoints)
    box = [[x - 1, y - 1, z - 1], [x + 1, y + 1, z + 1]]
    assert bool(graph.plan(start, goal, zones=[{"name": "mud", "box": box, "price": 2.5}])) == bool(free)
    with pytest.raises(ValueError, match="zone `mud`: a price is above 0"):
        graph.plan(start, goal, zones=[{"name": "mud", "box": box, "price": 0}])
    with pytest.raises(ValueError, match="give either box"):
        graph.plan(start, goal, zones=[{"name": "mud"}])


def test_graphs_survive_files(graph: surefoot.Graph, level: surefoot.Level, tmp_path: Path) -> None:
    graph.save(tmp_path / "graph.json")
    other = surefoot.Graph.load(tmp_path / "graph.json")
    np.testing.assert_array_equal(other.vertices, graph.vertices)
    assert other.edge_count == graph.edge_count and len(other) == len(graph)
    assert other._repr_png_() is None
    drawn = surefoot.Graph.load(tmp_path / "graph.json", level)._repr_png_()
    assert drawn is not None and drawn.startswith(b"\x89PNG")
    with pytest.raises(ValueError, match="has no level"):
        other.png()


def test_queries_are_asked_in_the_coordinates_of_the_level(tmp_path: Path) -> None:
    # In centimetres, with z up.
    corners = [(-27500, 7000), (-23500, 7000), (-23500, 11000), (-27500, 11000)]
    vertices = "".join(f"v {x} {y} -1200\n" for x, y in corners)
    (tmp_path / "floor.obj").write_text(f"o floor\n{vertices}f 1 2 3 4\n")
    level = surefoot.Level.load(tmp_path / "floor.obj", scale=0.01, up="z")
    assert (level.scale, level.up) == (0.01, "z")
    red, blue = (-26500.0, 8000.0, -1200.0), (-24500.0, 10000.0, -1200.0)
    np.testing.assert_allclose(level.to_map(red), np.add([-265, -12, -80], level.origin), atol=1e-4)
    np.testing.assert_allclose(level.to_level(level.to_map(red)), red, atol=0.01)
    both = np.array([level.to_map(red), level.to_map(blue)], np.float32)
    np.testing.assert_allclose(level.to_level(both), [red, blue], atol=0.01)

    graph = surefoot.Graph.build(level, vertices=30)
    plan = graph.plan(red, blue, coordinates="level")
    assert plan and plan.waypoints.dtype == np.float64
    np.testing.assert_allclose(plan.waypoints[-1], blue, atol=0.01)
    on_map = graph.plan(*both)
    assert on_map.waypoints.dtype == np.float32
    np.testing.assert_allclose(plan.waypoints, level.to_level(on_map.waypoints), atol=0.01)
    graph.save(tmp_path / "graph.json")
    assert json.loads((tmp_path / "graph.json").read_text())["graph"]["origin"] == list(level.origin)
    again = surefoot.Graph.load(tmp_path / "graph.json").plan(red, blue, coordinates="level")
    np.testing.assert_array_equal(again.waypoints, plan.waypoints)
    with pytest.raises(ValueError, match="up is `x`"):
        surefoot.Level.load(tmp_path / "floor.obj", up="x")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="coordinates is world"):
        graph.plan(red, blue, coordinates="world")  # type: ignore[arg-type]


def test_a_generated_map_is_its_own_level(graph: surefoot.Graph, level: surefoot.Level) -> None:
    start, goal = graph.vertices[0], graph.vertices[1]
    assert level.origin == (0, 0, 0) and level.to_map((1, 2, 3)) == (1, 2, 3)
    plans = [graph.plan(start, goal, coordinates=name) for name in ("map", "level")]  # type: ignore[arg-type]
    np.testing.assert_array_equal(plans[0].waypoints, plans[1].waypoints)


def test_networkx_finds_what_the_planner_finds(graph: surefoot.Graph) -> None:
    networkx = pytest.importorskip("networkx")
    directed = graph.to_networkx()
    assert directed.number_of_nodes() == len(graph) and directed.number_of_edges() == graph.edge_count
    reachable = graph.reachable_from(0)
    assert set(np.flatnonzero(reachable)) == networkx.descendants(directed, 0) | {0}
    about = graph.reach()
    assert about["vertices"] == len(graph)
    assert len(about["islands"]) == networkx.number_strongly_connected_components(directed)


def test_the_same_arguments_give_the_same_graph(level: surefoot.Level) -> None:
    one, other = (surefoot.Graph.build(level, vertices=20, seed=3, threads=threads) for threads in (1, 2))
    np.testing.assert_array_equal(one.vertices, other.vertices)
    assert one.edge_count == other.edge_count


def test_a_build_ends_when_its_progress_raises(level: surefoot.Level) -> None:
    def stop(done: int, total: int) -> None:
        raise KeyError("enough")

    with pytest.raises(KeyError, match="enough"):
        surefoot.Graph.build(level, vertices=300, progress=stop)


@pytest.mark.parametrize("wrong", [{"vertices": 1}, {"threads": 0}, {"body": "giraffe"}])
def test_wrong_settings_of_a_build_are_refused(wrong: dict[str, object], level: surefoot.Level) -> None:
    with pytest.raises(ValueError):
        surefoot.Graph.build(level, **wrong)  # type: ignore[arg-type]


def test_wrong_queries_are_refused(graph: surefoot.Graph) -> None:
    with pytest.raises(ValueError, match="start is"):
        graph.plan((0, float("nan"), 0), (1, 1, 1))
    with pytest.raises(ValueError, match="no ability fly"):
        graph.plan((0, 0, 0), (1, 1, 1), without=["fly"])
    with pytest.raises(ValueError, match="no ability fly"):
        graph.plan((0, 0, 0), (1, 1, 1), prices={"fly": 3})
    with pytest.raises(ValueError, match="the price of jump is -1"):
        graph.plan((0, 0, 0), (1, 1, 1), prices={"jump": -1})
    with pytest.raises(ValueError, match="caution is 2"):
        graph.plan((0, 0, 0), (1, 1, 1), caution=2.0)
    with pytest.raises(ValueError, match="no vertex 60000"):
        graph.reachable_from(60000)


def reached(policy: surefoot.Policy, level: surefoot.Level, count: int = 60) -> float:
    envs = surefoot.VectorEnv(count, level, goal_distance=(5, 20), autoreset_mode=AutoresetMode.SAME_STEP)
    observations, _ = envs.reset(seed=1)
    reset = np.ones(count, np.bool_)
    outcomes: list[str] = []
    for _ in range(120):
        observations, _, terminated, truncated, infos = envs.step(policy.act(observations, reset=reset))
        reset = terminated | truncated
        if infos:
            outcomes += list(infos["final_info"]["outcome"][reset])
    return outcomes.count("reached") / len(outcomes)


@pytest.mark.parametrize("name", ["general-reactive", "general-lstm"])
def test_shipped_policies_reach_near_goals(name: str, level: surefoot.Level) -> None:
    policy = surefoot.Policy.load(name)
    assert policy.name == name
    assert reached(policy, level) > 0.9


def test_recurrent_policies_remember_until_they_are_reset(level: surefoot.Level) -> None:
    policy = surefoot.Policy.load("general-lstm")
    assert policy.is_recurrent and policy.memory.shape == (0, 128)
    observations = surefoot.VectorEnv(3, level).reset(seed=1)[0]
    first = policy.act(observations, noise=0.0)
    memory = policy.memory
    second = policy.act(observations, noise=0.0)
    assert memory.shape == (3, 128) and not np.array_equal(first, second)
    policy.memory = memory
    np.testing.assert_array_equal(policy.act(observations, noise=0.0), second)
    again = policy.act(observations, reset=np.array([True, False, False]), noise=0.0)
    np.testing.assert_array_equal(again[0], first[0])
    assert not np.array_equal(again[1], first[1])
    policy.reset()
    np.testing.assert_array_equal(policy.act(observations, noise=0.0), first)


def test_wrong_observations_are_refused(level: surefoot.Level) -> None:
    policy = surefoot.Policy.load()
    with pytest.raises(ValueError, match=r"observations has the shape \[369\]"):
        policy.act(np.zeros(369, np.float32))
    with pytest.raises(ValueError, match=r"observations\[1, 2\] is NaN"):
        observations = np.zeros((2, 369), np.float32)
        observations[1, 2] = np.nan
        policy.act(observations)
    with pytest.raises(ValueError, match="noise is 2"):
        policy.act(np.zeros((1, 369), np.float32), noise=2.0)
    with_others = surefoot.VectorEnv(2, level, others=True).reset(seed=1)[0]
    np.testing.assert_array_equal(
        policy.act(with_others, noise=0.0), policy.act(np.ascontiguousarray(with_others[:, :369]), noise=0.0)
    )
