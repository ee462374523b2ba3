"""Finds places near an NPC that are hidden from a player, the quickest first: gRPC with generated stubs."""
import sys
import grpc
from surefoot.planner.v1 import planner_pb2 as wire, planner_pb2_grpc
from surefoot.world.v1 import map_pb2

planner = planner_pb2_grpc.PlannerServiceStub(grpc.insecure_channel((sys.argv[1:] or ["127.0.0.1:7601"])[0]))
spec = map_pb2.MapSpec(seed=42, size=map_pb2.MapSize(width=100, height=80, depth=100))
build = planner.StartBuild(wire.StartBuildRequest(map=spec, settings=wire.BuildSettings(vertices=100))).build
for progress in planner.WatchBuild(wire.WatchBuildRequest(build_id=build.build_id)):
    graph_id = progress.build.graph_id

npc, player = planner.GetGraph(wire.GetGraphRequest(graph_id=graph_id)).vertices[:2]
eyes = map_pb2.Vec3(x=player.x, y=player.y + 1.6, z=player.z)
ranked = planner.RankPlaces(wire.RankPlacesRequest(
    graph_id=graph_id,
    query=wire.PathQuery(start=npc),
    around=wire.Around(centre=npc, radius=40),
    hidden_from=[eyes],
    by=wire.RANK_BY_SECONDS,
    best=5,
))
print(f"{ranked.fitting} of {ranked.considered} places are hidden from the player")
for place in ranked.places:
    at = place.place
    print(f"({at.x:.1f}, {at.y:.1f}, {at.z:.1f}) takes {place.seconds:.1f} s, with a chance of {place.arrival_chance:.0%}")
