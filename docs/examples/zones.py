"""Closes a part of a map to NPCs without a key, sends two NPCs into it, and prints how they end."""
import sys
import grpc
from surefoot.world.v1 import world_pb2 as wire, world_pb2_grpc, zone_pb2 as zones


def main(channel):
    worlds = world_pb2_grpc.WorldServiceStub(channel)
    size = dict(width=60, height=60, depth=60)
    world_id = worlds.CreateWorld(wire.CreateWorldRequest(map=dict(seed=7, size=size))).world.world_id
    start, goal = worlds.SampleGround(wire.SampleGroundRequest(world_id=world_id, count=2)).points

    vault = zones.Zone(
        name="vault",
        cylinder=zones.ZoneCylinder(bottom=dict(x=goal.x, y=goal.y - 1, z=goal.z), radius=2, height=4),
        only_with_tag="key",
    )
    mud = zones.Zone(name="mud", box=zones.ZoneBox(low=dict(x=20, y=0, z=20), high=dict(x=40, y=60, z=40)), price=0.5)
    worlds.SetZones(zones.SetZonesRequest(world_id=world_id, put=[vault, mud]))

    events = worlds.WatchEvents(wire.WatchEventsRequest(world_id=world_id))
    next(events)  # The stream has begun.
    spawns = [wire.Spawn(position=start, goal=goal, tags=tags) for tags in (["key"], [])]
    with_key, without = worlds.BatchSpawnNpcs(wire.BatchSpawnNpcsRequest(world_id=world_id, spawns=spawns)).results
    outcomes = {}
    for message in events:
        for event in message.events:
            if event.WhichOneof("event") == "attempt_ended":
                outcomes[event.npc_id] = wire.Outcome.Name(event.attempt_ended.outcome)
        if len(outcomes) == 2:
            break
    print(f"with the key: {outcomes[with_key.npc_id]}, without: {outcomes[without.npc_id]}")
    worlds.DropWorld(wire.DropWorldRequest(world_id=world_id))


with grpc.insecure_channel((sys.argv[1:] or ["127.0.0.1:7600"])[0]) as channel:
    main(channel)
