class_name AICommands
extends RefCounted
## Words of the messages of godot-ai, for games that name them.

var command: String = "command"
var get_action: String = "get_action"
var get_batch_actions: String = "get_batch_actions"
var submit_batch_replay: String = "submit_batch_replay"
var train: String = "train"
var init_agent: String = "init"
var load_agent: String = "load"
var write_policy: String = "write_policy"
