extends SceneTree
## Calls what scripts can call, rightly and wrongly: results are what they should be, and mistakes are errors that say what to change. Prints each
## mistake before it is made; the check of this folder compares the errors that follow.
##
##     godot --headless --path PROJECT --script tests/calls.gd -- GRAPH LEVEL

var _failures := 0


func _initialize() -> void:
	var arguments := OS.get_cmdline_user_args()
	await process_frame
	_use_graph(arguments[0], arguments[1])
	_misuse_graphs(arguments[0])
	await _misuse_blocks(arguments[0], arguments[1])
	_use_agents()
	await _follow_a_target()
	await _watch_a_leap()
	_misuse_agents()
	_misuse_servers(arguments[1])
	print("%d failures" % _failures)
	quit(0 if _failures == 0 else 1)


func _expect(holds: bool, what: String) -> void:
	if not holds:
		_failures += 1
		print("FAILED: " + what)


func _graph_of(file: String) -> SurefootGraph:
	var graph := SurefootGraph.new()
	graph.file = file
	return graph


func _use_graph(file: String, level: String) -> void:
	var graph := _graph_of(file)
	_expect(graph.load(), "a graph is read")
	_expect(graph.align_to(level), "a level is read")
	_expect(graph.origin != Vector3.ZERO, "the example's level has its origin in its middle")
	var vertices := graph.get_vertices()
	var edges := graph.get_edges()
	_expect(vertices.size() > 10 and edges.size() > 10, "a graph has vertices and edges")
	_expect(vertices[edges[0]["to"]] == edges[0]["waypoint"], "edges name vertices")
	_close_an_edge(graph, vertices)
	# What a scene saves is what it loads.
	var path := "user://graph.tres"
	_expect(ResourceSaver.save(graph, path) == OK, "graphs are saved")
	var restored: SurefootGraph = load(path)
	_expect(restored.file == file and restored.origin == graph.origin, "graphs are restored")


func _close_an_edge(graph: SurefootGraph, vertices: PackedVector3Array) -> void:
	for goal in vertices:
		var path := graph.find_path(vertices[0], goal)
		for leg: Dictionary in path["legs"]:
			if path["found"] and leg["from"] >= 0 and leg["to"] >= 0:
				var from: int = leg["from"]
				var to: int = leg["to"]
				_expect(graph.set_edge_open(from, to, false), "an edge is closed")
				for other: Dictionary in graph.find_path(vertices[0], goal)["legs"]:
					_expect(other["from"] != from or other["to"] != to, "plans avoid a closed edge")
				_expect(graph.set_edge_open(from, to, true) and graph.set_edge_price(from, to, 2.0), "an edge is opened")
				return
	_expect(false, "a path has an edge")


func _misuse_graphs(file: String) -> void:
	print("MISTAKE no file is set")
	_expect(not SurefootGraph.new().load(), "no file")
	print("MISTAKE a missing file")
	_expect(not _graph_of("res://missing.json").load(), "a missing file")
	print("MISTAKE a file that is no graph")
	_expect(not _graph_of("res://project.godot").load(), "no graph")
	print("MISTAKE a missing level")
	_expect(not _graph_of(file).align_to("res://missing.glb"), "a missing level")
	print("MISTAKE an edge that does not exist")
	_expect(not _graph_of(file).set_edge_open(0, 100000, false), "no such edge")
	print("MISTAKE a negative vertex")
	_expect(not _graph_of(file).set_edge_open(-1, 0, false), "a negative vertex")
	print("MISTAKE a price of 0")
	_expect(not _graph_of(file).set_edge_price(0, 1, 0.0), "a price of 0")
	print("MISTAKE a goal that is not finite")
	_expect(_graph_of(file).find_path(Vector3.ZERO, Vector3(NAN, 0, 0)).is_empty(), "not finite")
	print("MISTAKE walking is excluded")
	_expect(_graph_of(file).find_path(Vector3.ZERO, Vector3.ONE, 1.0, 1).is_empty(), "walking is excluded")
	print("MISTAKE arguments of other types")
	var untyped: Variant = _graph_of(file)
	_expect(untyped.callv("find_path", ["here", "there"]) == null, "other types")


func _misuse_blocks(file: String, level: String) -> void:
	var crate := _ground()
	var graph := _graph_of(file)
	print("MISTAKE blocks without a level")
	_expect(not graph.set_blocks([crate]), "no level")
	graph.align_to(level)
	_expect(graph.set_blocks([crate]) and graph.set_blocks([]), "blocks are taken")
	print("MISTAKE a block that is no node")
	_expect(not graph.set_blocks([null]), "no node")
	print("MISTAKE a block outside the scene")
	var outside := Node3D.new()
	_expect(not graph.set_blocks([outside]), "outside the scene")
	print("MISTAKE a block without a shape")
	root.add_child(outside)
	_expect(not graph.set_blocks([outside]), "no shape")
	outside.free()
	# An agent that has decided has rehearsals.
	var character := _character()
	var agent: SurefootAgent3D = character.get_node("Agent")
	agent.graph = graph
	agent.set_goal(Vector3(0, 0, 8))
	await agent.decided
	await process_frame
	print("MISTAKE a block that reaches out of the map")
	_expect(not graph.set_blocks([crate]), "too large")
	var shape: CollisionShape3D = crate.get_child(0)
	shape.disabled = true
	_expect(graph.set_blocks([crate]), "disabled shapes are no blocks")
	shape.disabled = false
	shape.shape.size = Vector3(2, 2, 2)
	_expect(graph.set_blocks([crate]) and graph.set_blocks([shape]), "bodies and shapes are blocks")
	character.free()
	crate.free()


func _character(prepare := Callable()) -> CharacterBody3D:
	var character: CharacterBody3D = load("res://character.tscn").instantiate()
	if prepare.is_valid():
		prepare.call(character)
	root.add_child(character)
	return character


func _use_agents() -> void:
	var character := _character()
	var agent: SurefootAgent3D = character.get_node("Agent")
	_expect(not agent.is_navigating() and agent.get_plan().is_empty(), "an agent begins without a goal")
	_expect(agent.set_goal(Vector3(5, 0, 0)) and agent.is_navigating() and agent.get_goal() == Vector3(5, 0, 0), "it takes one")
	_expect(agent.set_goal(Vector3(6, 0, 1)) and agent.get_waypoint() == Vector3(6, 0, 1), "a near goal moves the one that it has")
	_expect(agent.set_goal(Vector3(-20, 0, 0)) and agent.get_goal() == Vector3(-20, 0, 0), "it takes one far away")
	agent.stop()
	_expect(not agent.is_navigating() and agent.get_action()["forward"] == 0.0, "it stops")
	# Leaving the scene and coming back begins anew.
	agent.set_goal(Vector3(5, 0, 0))
	root.remove_child(character)
	_expect(not agent.is_navigating(), "an agent outside the scene goes nowhere")
	root.add_child(character)
	_expect(agent.set_goal(Vector3(5, 0, 0)), "an agent that is back takes goals")
	character.free()


func _ground() -> StaticBody3D:
	var box := BoxShape3D.new()
	box.size = Vector3(60, 1, 60)
	var shape := CollisionShape3D.new()
	shape.shape = box
	shape.position = Vector3(0, -0.5, 0)
	var ground := StaticBody3D.new()
	ground.add_child(shape)
	root.add_child(ground)
	return ground


func _follow_a_target() -> void:
	var ground := _ground()
	var target := Marker3D.new()
	root.add_child(target)
	var character := _character()
	var agent: SurefootAgent3D = character.get_node("Agent")
	var ends: Array[String] = []
	agent.reached.connect(func() -> void: ends.append("reached" if character.is_on_floor() else "reached in the air"))
	agent.failed.connect(func(reason: String) -> void: ends.append(reason))
	target.position = Vector3(6, 0, 0)
	_expect(agent.follow(target) and agent.get_target() == target, "an agent follows a node")
	for tick in 900:
		target.position.x = minf(6.0 + 0.02 * tick, 12.0)
		await physics_frame
		if not ends.is_empty() and tick > 400:
			break
	print("a node that moves: %s" % [ends])
	_expect(not ends.is_empty() and ends.count("reached") == ends.size(), "it arrives on the ground, and follows again")
	target.free()
	for tick in 30:
		await physics_frame
	_expect(ends.back() == "target_lost" and agent.get_target() == null and not agent.is_navigating(), "a node that is gone")
	character.free()
	ground.free()


func _watch_a_leap() -> void:
	var ground := _ground()
	var box := _ground()
	box.position = Vector3(34, 2.5, 0)
	var character := _character()
	var agent: SurefootAgent3D = character.get_node("Agent")
	var seen := {"pace": [], "phase": [], "ability": []}
	var widest := 0.0
	_expect(agent.get_locomotion()["pace"] == "idle", "a character begins at rest")
	agent.set_goal(Vector3(7, 2.5, 0))
	for tick in 900:
		await physics_frame
		var now := agent.get_locomotion()
		widest = maxf(widest, now["stride"])
		for key: String in seen:
			if seen[key].is_empty() or seen[key].back() != now[key]:
				seen[key].append(now[key])
		if not agent.is_navigating() and now["pace"] == "idle" and now["phase"] == "":
			break
	print("a leap: %s, stride %.1f m" % [seen, widest])
	_expect("run" in seen["pace"] and widest > 3.0 and seen["pace"].back() == "idle", "it runs, and stands")
	var begins: int = seen["phase"].find("flight")
	_expect(begins > 0 and seen["phase"][begins + 1] == "landing", "it leaps, and lands")
	_expect("jump" in seen["ability"] and seen["ability"].back() == "walk", "it jumps")
	character.velocity.y = 8.0
	agent.note_ability("pad")
	for tick in 5:
		await physics_frame
	_expect(agent.get_locomotion()["phase"] == "flight" and agent.get_locomotion()["ability"] == "pad", "a pad throws it")
	character.free()
	box.free()
	ground.free()


func _misuse_agents() -> void:
	print("MISTAKE a goal before the agent is in a scene")
	var outside := SurefootAgent3D.new()
	_expect(not outside.set_goal(Vector3.ONE), "not in a scene")
	print("MISTAKE a parent that is no character")
	root.add_child(outside)
	outside.free()
	print("MISTAKE a character without a capsule")
	_character(func(character: Node) -> void: character.get_node("Shape").free()).free()
	print("MISTAKE a policy that does not exist")
	_character(func(character: Node) -> void: character.get_node("Agent").policy = "general-genius").free()
	print("MISTAKE a policy's folder that does not exist")
	_character(func(character: Node) -> void: character.get_node("Agent").policy = "res://no/model").free()
	print("MISTAKE a body out of range")
	_character(func(character: Node) -> void: character.get_node("Agent").gravity = -1.0).free()
	print("MISTAKE another resource as graph")
	var character := _character()
	var agent: SurefootAgent3D = character.get_node("Agent")
	agent.set("graph", Gradient.new())
	_expect(agent.graph == null, "another resource")
	print("MISTAKE a graph that cannot be read")
	agent.graph = _graph_of("res://missing.json")
	_expect(not agent.set_goal(Vector3.ONE) and not agent.is_navigating(), "an unreadable graph")
	agent.graph = null
	print("MISTAKE a goal of an agent that is not finite")
	_expect(not agent.set_goal(Vector3(INF, 0, 0)) and not agent.is_navigating(), "not finite")
	print("MISTAKE a target that is no Node3D")
	_expect(not agent.follow(root) and agent.get_target() == null, "another target")
	print("MISTAKE a radius out of range")
	agent.goal_radius = -1.0
	_expect(agent.goal_radius == 1.0, "a negative radius")
	print("MISTAKE an ability that does not exist")
	agent.note_ability("fly")
	character.free()
	_leave_teleporter_open()


func _misuse_servers(level: String) -> void:
	print("MISTAKE a server without a character")
	_serve(null, level, "tcp://127.0.0.1:0")
	print("MISTAKE a server without a level")
	_serve(load("res://character.tscn"), "res://missing.glb", "tcp://127.0.0.1:0")
	print("MISTAKE an address that is none")
	_serve(load("res://character.tscn"), level, "127.0.0.1")


func _serve(character: PackedScene, level: String, address: String) -> void:
	var server := SurefootGameServer.new()
	server.character = character
	server.level = level
	server.address = address
	root.add_child(server)
	_expect(server.get_port() == 0, "it listens")
	server.free()


func _leave_teleporter_open() -> void:
	print("MISTAKE a teleporter that leads nowhere")
	var teleporter := Node3D.new()
	teleporter.add_to_group("surefoot_teleporter")
	root.add_child(teleporter)
	_character().free()
	teleporter.free()
