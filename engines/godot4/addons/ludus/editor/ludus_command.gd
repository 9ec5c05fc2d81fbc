@tool
extends RefCounted
## One [code]ludus[/code] command that the editor has started: its lines as they come, its end.
##
## Nothing here waits: [method poll] takes what there is. The process ends with the editor, as its
## standard input ends then.

## A line that it wrote.
signal line_written(text: String)
## It has ended.
signal ended(exit_code: int)

## What the process runs instead of [code]ludus[/code], so that it can be told to stop.
const MODULE := "ludus.cli.child"
const STOP := "stop\n"
const PART_BYTES := 65536
## How long a process may take to save what it has learnt, before it is killed.
const PATIENCE_MS := 20000

## What is run, such as [code]train[/code]; empty while nothing runs.
var name: String = ""
## When it was started, milliseconds.
var started_ms: int = 0
## Whether it was told to stop.
var is_stopping: bool = false

var _pid: int = 0
var _pipes: Array[FileAccess] = []
## The beginnings of lines, whose ends are still to come, of each pipe.
var _rests: Array[PackedByteArray] = []
var _stopped_ms: int = 0


## Starts a command. Returns whether that could be.
func start(python: String, arguments: PackedStringArray) -> bool:
	var all := PackedStringArray(["-P", "-m", MODULE]) + arguments
	var process := OS.execute_with_pipe(python, all, false)
	if process.is_empty():
		return false
	_pid = process["pid"]
	_pipes = [process["stdio"], process["stderr"]]
	_rests = [PackedByteArray(), PackedByteArray()]
	name = arguments[0]
	started_ms = Time.get_ticks_msec()
	is_stopping = false
	return true


## Whether it runs.
func is_running() -> bool:
	return _pid > 0


## Takes what has been written, and notices the end. Call it in every frame.
func poll() -> void:
	if _pid <= 0:
		return
	var has_ended := not OS.is_process_running(_pid)
	for i: int in _pipes.size():
		_read(i)
	if has_ended:
		_end()
	elif is_stopping and Time.get_ticks_msec() - _stopped_ms > PATIENCE_MS:
		kill()


## Tells it to stop, and to save what it has learnt. A second time kills it.
func stop() -> void:
	if is_stopping:
		kill()
	elif _pid > 0 and OS.is_process_running(_pid):
		is_stopping = true
		_stopped_ms = Time.get_ticks_msec()
		_pipes[0].store_string(STOP)
		_pipes[0].flush()


## Ends it at once. The games that it has started notice that, and quit.
func kill() -> void:
	if _pid > 0:
		OS.kill(_pid)


func _read(i: int) -> void:
	var bytes := _rests[i]
	while true:
		var part := _pipes[i].get_buffer(PART_BYTES)
		if part.is_empty():
			break
		bytes.append_array(part)
	var end := bytes.find(10)
	var begin := 0
	while end >= 0:
		line_written.emit(bytes.slice(begin, end).get_string_from_utf8().trim_suffix("\r"))
		begin = end + 1
		end = bytes.find(10, begin)
	_rests[i] = bytes.slice(begin)


func _end() -> void:
	var exit_code := OS.get_process_exit_code(_pid)
	for rest: PackedByteArray in _rests:
		if not rest.is_empty():
			line_written.emit(rest.get_string_from_utf8())
	_pid = 0
	_pipes.clear()
	name = ""
	ended.emit(exit_code)
