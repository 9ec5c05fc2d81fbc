class_name PolicyAgent
extends RefCounted
## Turns what the network of a policy puts out into actions: a Gaussian, squashed by tanh.

const LOWEST_LOG_STD := -20.0
const HIGHEST_LOG_STD := 2.0

var _nn: NeuralNetwork


func _init(nn: NeuralNetwork) -> void:
	_nn = nn


## Returns numbers from -1 to 1: the most probable ones if [param is_deterministic], otherwise drawn
## as in training.
func get_action(x: Array[float], is_deterministic: bool = false) -> Array[float]:
	var outputs := _nn.feed_forward(x)
	var size := outputs.size() / 2
	var action: Array[float] = []
	for i: int in size:
		var value := outputs[i]
		if not is_deterministic:
			var log_std := clampf(outputs[size + i], LOWEST_LOG_STD, HIGHEST_LOG_STD)
			value = randfn(value, exp(log_std))
		action.append(tanh(value))
	return action
