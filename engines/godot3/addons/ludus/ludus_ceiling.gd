class_name LudusCeiling
extends Reference
## Plays with random actions inside the engine, to show how fast the game could be without a bridge.

var _game: LudusGame
var _id: int
var _num_steps: int
var _steps_left: int
var _ticks_left: int = 0
var _rng := RandomNumberGenerator.new()
var _began_us: int = 0
var _elapsed_us: int = 0


func _init(game: LudusGame, id: int, num_steps: int, seed_value: int) -> void:
	_game = game
	_id = id
	_num_steps = int(max(num_steps, 1))
	_steps_left = _num_steps
	_rng.seed = seed_value


## Plays one tick. Returns true when all steps are done.
func advance() -> bool:
	if _ticks_left > 1:
		_ticks_left -= 1
		_game.repeat_actions()
		return false
	if _began_us == 0:
		_began_us = OS.get_ticks_usec()
	elif _steps_left == 0:
		_elapsed_us = OS.get_ticks_usec() - _began_us
		return true
	_game.play_randomly(_rng)
	_steps_left -= 1
	_ticks_left = _game.ticks_per_step
	return false


## The answer to the call.
func result_frame() -> PoolByteArray:
	var value := {"elapsed_us": _elapsed_us, "num_steps": _num_steps}
	return LudusWire.json_frame(LudusWire.Type.RESULT, {"id": _id, "value": value})
