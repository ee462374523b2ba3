"""Imports a level, sends 64 NPCs across it and counts arrivals: HTTP and JSON, nothing to install."""
import base64, collections, json, sys, urllib.request

COUNT = 64
if len(sys.argv) != 3:
    sys.exit(f"usage: {sys.argv[0]} ADDRESS LEVEL, such as http://127.0.0.1:7600 level.glb")
address, level = sys.argv[1:]


def post(method, message):
    request = urllib.request.Request(f"{address}/surefoot.world.v1.{method}", json.dumps(message).encode())
    request.add_header("Content-Type", "application/json")
    return urllib.request.urlopen(request)


def call(method, message):
    return json.load(post(method, message))


file = base64.b64encode(open(level, "rb").read()).decode()
kind = "MAP_FORMAT_OBJ" if level.endswith(".obj") else "MAP_FORMAT_GLTF"
imported = call("MapService/ImportMap", {"name": level, "format": kind, "file": file})
world_id = call("WorldService/CreateWorld", {"mapHash": imported["map"]["mapHash"]})["world"]["worldId"]
points = call("WorldService/SampleGround", {"worldId": world_id, "count": 2 * COUNT})["points"]

events = post("WorldService/WatchEvents", {"worldId": world_id})
events.readline()  # The stream has begun: no event is missed from here on.
spawns = [{"position": start, "goal": goal} for start, goal in zip(points[:COUNT], points[COUNT:])]
results = call("WorldService/BatchSpawnNpcs", {"worldId": world_id, "spawns": spawns})["results"]
waiting = {result["npcId"] for result in results if "npcId" in result}

outcomes = collections.Counter()
for line in events:
    for event in json.loads(line).get("events", []):
        if "attemptEnded" in event and event["npcId"] in waiting:
            waiting.remove(event["npcId"])
            outcomes[event["attemptEnded"].get("outcome", "OUTCOME_UNSPECIFIED")] += 1
    if not waiting:
        break
arrived = outcomes["OUTCOME_REACHED"] + outcomes["OUTCOME_REACHED_NEAR"]
print(f"{arrived} of {COUNT} arrived: {dict(outcomes)}")
call("WorldService/DropWorld", {"worldId": world_id})
