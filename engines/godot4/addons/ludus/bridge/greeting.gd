extends RefCounted
## The first frames on one connection: both sides prove that they know the token, and neither tells
## it (PROTOCOL.md §3).
##
## It reads without waiting, so that many who connect are greeted at the same time, and one who says
## nothing keeps nobody out.

enum State {
	WAITING,  ## For the challenge of the trainer.
	PROVEN,  ## The trainer knows the token, and has been sent our proof.
	REFUSED,  ## It does not, or broke the rules; see [member error].
	ENDED,  ## It has refused us, see [member error], or closed the connection.
}

const LudusArguments := preload("res://addons/ludus/bridge/arguments.gd")
## This script: a type without it is first the game's global class of that name.
const LudusGreeting := preload("res://addons/ludus/bridge/greeting.gd")
const LudusWire := preload("res://addons/ludus/bridge/wire.gd")

const NONCE_BYTES := 32
const LABEL := "ludus 2 %s"
## How much of a stranger's text is printed, characters.
const MAX_SHOWN := 200

## Connection that is greeted.
var stream: StreamPeer
var state: LudusGreeting.State = State.WAITING
## Code and text of what went wrong, and a hint; empty texts if nothing did.
var code: String = ""
var error: String = ""
var hint: String = ""
## Whether the [code]ERROR[/code] that has refused us proves that it is the trainer's.
var is_refusal_proven: bool = false
## Time at which it has taken too long, milliseconds since the start.
var deadline_ms: int = 0

var _token: String
var _nonce: PackedByteArray = Crypto.new().generate_random_bytes(NONCE_BYTES)
var _received := PackedByteArray()


## Sends [param hello] over [param connection], and waits for the answer for
## [param timeout_ms] milliseconds.
func _init(connection: StreamPeer, hello: Dictionary, token: String, timeout_ms: int) -> void:
	stream = connection
	_token = token
	deadline_ms = Time.get_ticks_msec() + timeout_ms
	if token.is_empty():
		hint = "is the trainer this user's? Its token is in %s" % LudusArguments.user_token_path()
		_refuse("token", "there is no token, so that a trainer cannot prove itself")
		return
	hello["nonce"] = _nonce.hex_encode()
	if stream.put_data(LudusWire.json_frame(LudusWire.Type.HELLO, hello)) != OK:
		state = State.ENDED


## Tells the other side why it was refused, if it was, and ends the connection.
func dismiss() -> void:
	if state == State.REFUSED:
		var report := {"code": code, "message": error, "hint": hint}
		stream.put_data(LudusWire.json_frame(LudusWire.Type.ERROR, report))
	if stream.has_method(&"disconnect_from_host"):
		stream.call(&"disconnect_from_host")


## Reads what has come, and answers it.
func advance() -> void:
	if state != State.WAITING:
		return
	stream.call(&"poll")
	var num_bytes := stream.get_available_bytes()
	if num_bytes > 0:
		_received += stream.get_data(mini(num_bytes, LudusWire.MAX_GREETING_BYTES))[1]
		_read_frame()
	elif stream.call(&"get_status") != StreamPeerTCP.STATUS_CONNECTED:
		state = State.ENDED
	elif Time.get_ticks_msec() > deadline_ms:
		_refuse("timeout", "the trainer sent no challenge in time")


## The proof of [param role] that it knows [param token], for the nonces of both sides.
static func proof(
	token: String, role: String, engine_nonce: PackedByteArray, trainer_nonce: PackedByteArray
) -> PackedByteArray:
	var message := (LABEL % role).to_utf8_buffer() + engine_nonce + trainer_nonce
	return Crypto.new().hmac_digest(HashingContext.HASH_SHA256, token.to_utf8_buffer(), message)


## The beginning of a text that a stranger has sent, for a terminal: all but ASCII's printable
## characters are escaped.
static func printable(text: String) -> String:
	var shown := ""
	for letter: String in text.left(MAX_SHOWN):
		var number := letter.unicode_at(0)
		shown += letter if number >= 0x20 and number < 0x7f else "\\u%04x" % number
	return shown


func _read_frame() -> void:
	if _received.size() < LudusWire.HEADER_BYTES:
		return
	var type := _received[4]
	var num_bytes := _received.decode_u32(0)
	var is_known := type == LudusWire.Type.CHALLENGE or type == LudusWire.Type.ERROR
	if not is_known or num_bytes > LudusWire.MAX_GREETING_BYTES or _received.decode_u32(4) != type:
		_refuse("sequence", "expected CHALLENGE, got a frame of type %d" % type)
		return
	if _received.size() < LudusWire.HEADER_BYTES + num_bytes:
		return
	var payload := _received.slice(LudusWire.HEADER_BYTES)
	var content: Variant = null
	if payload.size() == num_bytes:
		content = LudusWire.read_json(payload)
	if content == null:
		_refuse("frame", "the answer to the greeting is malformed")
	elif type == LudusWire.Type.ERROR:
		state = State.ENDED
		error = str(content.get("message", "the trainer refused"))
		hint = str(content.get("hint", ""))
		var theirs := _read_hex(content.get("proof"))
		is_refusal_proven = _is_trainers(theirs, _read_hex(content.get("nonce")))
	else:
		_answer(content)


func _answer(challenge: Dictionary) -> void:
	var nonce := _read_hex(challenge.get("nonce"))
	var theirs := _read_hex(challenge.get("proof"))
	if nonce.is_empty() or theirs.is_empty():
		_refuse("frame", "a CHALLENGE has a nonce and a proof of 64 hexadecimal digits each")
		return
	if not _is_trainers(theirs, nonce):
		hint = "give both sides the same token file (--ludus-token-file, --token-file)"
		_refuse("token", "the trainer's token is not ours")
		return
	var ours := {"proof": proof(_token, "engine", _nonce, nonce).hex_encode()}
	var is_sent := stream.put_data(LudusWire.json_frame(LudusWire.Type.PROOF, ours)) == OK
	state = State.PROVEN if is_sent else State.ENDED


## Whether a proof for [param nonce], too, is that of a trainer who knows the token.
func _is_trainers(theirs: PackedByteArray, nonce: PackedByteArray) -> bool:
	var expected := proof(_token, "trainer", _nonce, nonce)
	return Crypto.new().constant_time_compare(expected, theirs)


func _refuse(why: String, message: String) -> void:
	state = State.REFUSED
	code = why
	error = message


static func _read_hex(value: Variant) -> PackedByteArray:
	if value is not String or len(value) != 2 * NONCE_BYTES:
		return PackedByteArray()
	var text: String = value
	var is_hex := text.is_valid_hex_number() and text[0] not in "+-"
	return text.hex_decode() if is_hex else PackedByteArray()
