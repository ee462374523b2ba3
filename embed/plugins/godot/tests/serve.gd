extends SceneTree
## Serves a level as a world, with a scene's characters:
##
##     godot --headless --path PROJECT --script tests/serve.gd -- LEVEL.glb CHARACTER.tscn ADDRESS [SCENE]
##
## SCENE holds the level; without it, its colliders are made from LEVEL.glb.


func _initialize() -> void:
	var arguments := OS.get_cmdline_user_args()
	var level: Node = load(arguments[3]).instantiate() if arguments.size() > 3 else load("res://tests/exported_level.gd").build(arguments[0])
	root.add_child(level)
	# Shapes made of solids can be collided with after a frame.
	await process_frame
	await process_frame
	var server := SurefootGameServer.new()
	server.level = arguments[0]
	server.character = load(arguments[1])
	server.address = arguments[2]
	root.add_child(server)
	if server.get_port() == 0:
		quit(1)
	else:
		print("serving %s on port %d" % [arguments[0], server.get_port()])
