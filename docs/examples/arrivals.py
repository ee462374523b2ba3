"""Imports a level, sends 64 NPCs across it and counts arrivals: gRPC with generated stubs."""
import collections, sys, uuid
import grpc
from surefoot.world.v1 import maps_pb2, maps_pb2_grpc, world_pb2, world_pb2_grpc

COUNT = 64


def main(channel, level):
    maps, worlds = maps_pb2_grpc.MapServiceStub(channel), world_pb2_grpc.WorldServiceStub(channel)

    kind = maps_pb2.MAP_FORMAT_OBJ if level.endswith(".obj") else maps_pb2.MAP_FORMAT_GLTF
    imported = maps.ImportMap(maps_pb2.ImportMapRequest(name=level, format=kind, file=open(level, "rb").read()))
    request = world_pb2.CreateWorldRequest(map_hash=imported.map.map_hash, request_id=str(uuid.uuid4()))
    world_id = worlds.CreateWorld(request).world.world_id
    points = worlds.SampleGround(world_pb2.SampleGroundRequest(world_id=world_id, count=2 * COUNT)).points

    events = worlds.WatchEvents(world_pb2.WatchEventsRequest(world_id=world_id))
    next(events)  # The stream has begun: no event is missed from here on.
    spawns = [world_pb2.Spawn(position=start, goal=goal) for start, goal in zip(points[:COUNT], points[COUNT:])]
    results = worlds.BatchSpawnNpcs(world_pb2.BatchSpawnNpcsRequest(world_id=world_id, spawns=spawns)).results
    waiting = {result.npc_id for result in results if result.WhichOneof("result") == "npc_id"}

    outcomes = collections.Counter()
    for message in events:
        for event in message.events:
            if event.WhichOneof("event") == "attempt_ended" and event.npc_id in waiting:
                waiting.remove(event.npc_id)
                outcomes[world_pb2.Outcome.Name(event.attempt_ended.outcome)] += 1
        if not waiting:
            break
    arrived = outcomes["OUTCOME_REACHED"] + outcomes["OUTCOME_REACHED_NEAR"]
    print(f"{arrived} of {COUNT} arrived: {dict(outcomes)}")
    worlds.DropWorld(world_pb2.DropWorldRequest(world_id=world_id))


if len(sys.argv) != 3:
    sys.exit(f"usage: {sys.argv[0]} ADDRESS LEVEL, such as 127.0.0.1:7600 level.glb")
address, level = sys.argv[1:]
with grpc.insecure_channel(address) as channel:
    main(channel, level)
