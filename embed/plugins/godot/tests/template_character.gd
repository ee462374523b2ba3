extends CharacterBody3D
## Godot's template of a CharacterBody3D, with the actions of an agent in the place of keys.

const SPEED := 5.0
const JUMP_VELOCITY := 4.5
const TURN_SPEED := TAU

var _action := {"forward": 0.0, "strafe": 0.0, "turn": 0.0, "jump": 0.0}
var _wants_jump := false

@onready var _agent: SurefootAgent3D = $Agent


func _ready() -> void:
	_agent.decided.connect(_begin_decision)


func _begin_decision() -> void:
	_action = _agent.get_action()
	_wants_jump = _action["jump"] > 0.0


func _physics_process(delta: float) -> void:
	rotate_y(_action["turn"] * TURN_SPEED * delta)
	if not is_on_floor():
		velocity += get_gravity() * delta
	if _wants_jump and is_on_floor():
		velocity.y = JUMP_VELOCITY
		_wants_jump = false
	var direction := transform.basis * Vector3(_action["strafe"], 0, -_action["forward"]).limit_length()
	if direction:
		velocity.x = direction.x * SPEED
		velocity.z = direction.z * SPEED
	else:
		velocity.x = move_toward(velocity.x, 0, SPEED)
		velocity.z = move_toward(velocity.z, 0, SPEED)
	move_and_slide()
