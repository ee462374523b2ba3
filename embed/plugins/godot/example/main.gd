extends Node3D
## One character that goes from goal to goal: by plan, if there is a graph of the level, and else straight at them.

const GRAPH := "res://graph.json"
const LEVEL := "res://level.glb"
const GOALS: Array[Vector3] = [
	Vector3(-16, 3, -14), Vector3(10, 4, -10), Vector3(14, 3.8, 14), Vector3(0, 0, 28), Vector3(-12, 0, 27), Vector3(-4, 0, 10)
]

var _goal_idx := 0

@onready var _agent: SurefootAgent3D = $Character/Agent


func _ready() -> void:
	if FileAccess.file_exists(GRAPH) and FileAccess.file_exists(LEVEL):
		var graph := SurefootGraph.new()
		graph.file = GRAPH
		graph.align_to(LEVEL)
		_agent.graph = graph
	_agent.reached.connect(_go_on.bind("reached"))
	_agent.failed.connect(func(reason: String) -> void: _go_on(reason))
	_agent.plan_changed.connect(func() -> void: print("a plan of %d legs" % _agent.get_plan().size()))
	_agent.set_goal(GOALS[0])


func _physics_process(_delta: float) -> void:
	if $Character.position.y < -10.0:
		$Character.position = Vector3(-4, 0.1, 10)
		$Character.velocity = Vector3.ZERO
		_agent.respawned()


func _go_on(end: String) -> void:
	print("%s: %s" % [GOALS[_goal_idx], end])
	_goal_idx = (_goal_idx + 1) % GOALS.size()
	_agent.set_goal(GOALS[_goal_idx])
