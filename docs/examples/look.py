"""Lets an NPC at rest look at a player that walks around it: HTTP and JSON, nothing to install."""
import json, math, sys, time, urllib.request

address = (sys.argv[1:] or ["http://127.0.0.1:7600"])[0]


def call(method, message):
    request = urllib.request.Request(f"{address}/surefoot.world.v1.WorldService/{method}", json.dumps(message).encode())
    request.add_header("Content-Type", "application/json")
    return json.load(urllib.request.urlopen(request))


terrain = {"seed": 7, "size": {"width": 60, "depth": 60, "height": 60}}
world_id = call("CreateWorld", {"map": terrain})["world"]["worldId"]
spot = call("SampleGround", {"worldId": world_id, "count": 1})["points"][0]
npc_id = call("SpawnNpc", {"worldId": world_id, "position": spot})["npcId"]
player = {"worldId": world_id, "position": spot, "radius": 0.4, "height": 1.8, "contact": "PLAYER_CONTACT_GHOST"}
player_id = call("SpawnPlayer", player).get("playerId", 0)
call("LookAt", {"npcs": [{"npcId": npc_id, "target": {"playerId": player_id}}]})

for degrees in (0, 90, 180, 270):
    angle = math.radians(degrees)
    place = {**spot, "x": spot["x"] + math.sin(angle), "z": spot["z"] + math.cos(angle)}
    call("MovePlayers", {"worldId": world_id, "moves": [{"playerId": player_id, "position": place}]})
    time.sleep(2)
    yaw = call("GetNpc", {"npcId": npc_id})["npc"].get("yaw", 0)
    print(f"player at {degrees} degrees, NPC faces {math.degrees(yaw) % 360:.0f}")
call("LookAt", {"npcs": [{"npcId": npc_id}]})
call("DropWorld", {"worldId": world_id})
