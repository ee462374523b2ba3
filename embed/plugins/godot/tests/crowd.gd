extends SceneTree
## Lets a crowd go to goals by plan, as fast as the machine can, and counts who arrives. The check of this folder runs it:
##
##     godot --headless --fixed-fps 60 --path PROJECT --script tests/crowd.gd -- LEVEL COUNT AT_LEAST [free]
##
## LEVEL is a scene, or the .glb of a map that `surefoot map export` wrote, with a graph LEVEL.json beside its LEVEL.glb. The exit code is 0 if at
## least the share AT_LEAST of COUNT characters arrives. With `free`, they rehearse nothing.

const SECONDS := 120.0
## Zip lines and jetpacks, which the example's characters do not ride: what agents' `without` is from the start.
const WITHOUT := 16 + 64

var _graph: SurefootGraph
var _character_count := 0
var _decision_count := 0
var _jump_count := 0
var _turn := 0.0
var _began_at := 0
var _seconds := 0.0
var _ends := {}
var _floor_y := 0.0
var _characters: Array[CharacterBody3D] = []


func _initialize() -> void:
	var arguments := OS.get_cmdline_user_args()
	if arguments.size() < 3:
		return _give_up("crowd.gd takes a level, a count and a share")
	_character_count = arguments[1].to_int()
	var level_file := arguments[0].get_basename() + ".glb"
	_graph = SurefootGraph.new()
	_graph.file = arguments[0].get_basename() + ".json"
	if not _graph.align_to(level_file) or not _graph.load():
		return _give_up("the level has no graph")
	if arguments.size() > 3:
		_graph.level = ""
	var level: Node = load(arguments[0]).instantiate() if arguments[0].ends_with(".tscn") else load("res://tests/exported_level.gd").build(level_file)
	root.add_child(level)
	# Shapes made of solids can be collided with after a frame.
	await process_frame
	await process_frame
	_add_crowd()
	_began_at = Time.get_ticks_usec()


func _give_up(message: String) -> void:
	push_error(message)
	quit(1)


## Spawns characters at vertices of the graph, with goals at others that a path leads to.
func _add_crowd() -> void:
	var vertices := _graph.get_vertices()
	_floor_y = vertices[0].y
	for vertex in vertices:
		_floor_y = minf(_floor_y, vertex.y)
	var draw := RandomNumberGenerator.new()
	draw.seed = 7
	for tries in 100 * _character_count:
		var start := vertices[draw.randi_range(0, vertices.size() - 1)]
		var goal := vertices[draw.randi_range(0, vertices.size() - 1)]
		if start.distance_to(goal) > 8.0 and _graph.find_path(start, goal, 1.0, WITHOUT)["found"]:
			_add_character(start, goal)
		if _characters.size() == _character_count:
			return
	_give_up("there are too few goals")


func _add_character(start: Vector3, goal: Vector3) -> void:
	var character: CharacterBody3D = load("res://character.tscn").instantiate()
	var agent: SurefootAgent3D = character.get_node("Agent")
	agent.graph = _graph
	character.position = start + Vector3(0, 0.1, 0)
	root.add_child(character)
	agent.reached.connect(_end.bind(character, "reached"))
	agent.failed.connect(func(reason: String) -> void: _end(character, reason))
	agent.decided.connect(_note_decision.bind(agent))
	_characters.append(character)
	agent.set_goal(goal)


func _note_decision(agent: SurefootAgent3D) -> void:
	var action := agent.get_action()
	_decision_count += 1
	_jump_count += 1 if action["jump"] > 0.0 else 0
	_turn += absf(action["turn"])


func _end(character: CharacterBody3D, end: String) -> void:
	_ends[end] = _ends.get(end, 0) + 1
	_characters.erase(character)
	character.queue_free()


func _physics_process(delta: float) -> bool:
	_seconds += delta
	for character in _characters.duplicate():
		if character.position.y < _floor_y - 20.0:
			character.get_node("Agent").respawned()
	if _seconds >= SECONDS or (_characters.is_empty() and not _ends.is_empty()):
		_report()
	return false


func _report() -> void:
	var reached: int = _ends.get("reached", 0)
	print("%d of %d arrived; ends: %s; %d still on their way after %.0f s" % [reached, _character_count, _ends, _characters.size(), _seconds])
	var busy := (Time.get_ticks_usec() - _began_at) as float
	print("%d decisions, %.0f us of this machine for each with the ten ticks that follow" % [_decision_count, busy / _decision_count])
	print("jumps in %.0f %% of the decisions, turns by %.0f %% of what the body can" % [100.0 * _jump_count / _decision_count, 100.0 * _turn / _decision_count])
	quit(0 if reached >= _character_count * OS.get_cmdline_user_args()[2].to_float() else 1)
