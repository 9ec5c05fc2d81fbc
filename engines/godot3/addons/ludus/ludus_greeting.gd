class_name LudusGreeting
extends Reference
## The first frames on one connection: both sides prove that they know the token, and neither tells
## it (PROTOCOL.md §3).
##
## It reads without waiting, so that many who connect are greeted at the same time, and one who says
## nothing keeps nobody out.

## It waits for the challenge of the trainer; the trainer knows the token, and has been sent our
## proof; it does not, or broke the rules; it has refused us, or closed the connection.
enum State { WAITING, PROVEN, REFUSED, ENDED }

const NONCE_BYTES := 32
const LABEL := "ludus 2 %s"
## How much of a stranger's text is printed, characters.
const MAX_SHOWN := 200
const DIGITS := "0123456789abcdef"

## Connection that is greeted.
var stream: StreamPeerTCP
var state: int = State.WAITING
## Code and text of what went wrong, and a hint; empty texts if nothing did.
var code: String = ""
var error: String = ""
var hint: String = ""
## Whether the [code]ERROR[/code] that has refused us proves that it is the trainer's.
var is_refusal_proven: bool = false
## Time at which it has taken too long, milliseconds since the start.
var deadline_ms: int = 0

var _token: String
var _nonce: PoolByteArray = Crypto.new().generate_random_bytes(NONCE_BYTES)
var _received := PoolByteArray()


## Sends [param hello] over [param connection], and waits for the answer for
## [param timeout_ms] milliseconds.
func _init(connection: StreamPeerTCP, hello: Dictionary, token: String, timeout_ms: int) -> void:
	stream = connection
	_token = token
	deadline_ms = OS.get_ticks_msec() + timeout_ms
	if token.empty():
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
		var _is_sent := stream.put_data(LudusWire.json_frame(LudusWire.Type.ERROR, report))
	stream.disconnect_from_host()


## Reads what has come, and answers it.
func advance() -> void:
	if state != State.WAITING:
		return
	var num_bytes := stream.get_available_bytes()
	if num_bytes > 0:
		var piece: Array = stream.get_data(int(min(num_bytes, LudusWire.MAX_GREETING_BYTES)))
		_received.append_array(piece[1])
		_read_frame()
	elif stream.get_status() != StreamPeerTCP.STATUS_CONNECTED:
		state = State.ENDED
	elif OS.get_ticks_msec() > deadline_ms:
		_refuse("timeout", "the trainer sent no challenge in time")


## The proof of [param role] that it knows [param token], for the nonces of both sides.
static func proof(
	token: String, role: String, engine_nonce: PoolByteArray, trainer_nonce: PoolByteArray
) -> PoolByteArray:
	var message := (LABEL % role).to_utf8()
	message.append_array(engine_nonce)
	message.append_array(trainer_nonce)
	return Crypto.new().hmac_digest(HashingContext.HASH_SHA256, token.to_utf8(), message)


## Reads 64 hexadecimal digits; empty if it is something else.
static func read_hex(value) -> PoolByteArray:
	var bytes := PoolByteArray()
	var text: String = value if value is String else ""
	if text.length() != 2 * NONCE_BYTES:
		return bytes
	for i in NONCE_BYTES:
		var high: int = DIGITS.find(text.substr(2 * i, 1))
		var low: int = DIGITS.find(text.substr(2 * i + 1, 1))
		if high < 0 or low < 0:
			return PoolByteArray()
		bytes.append(16 * high + low)
	return bytes


## The beginning of a text that a stranger has sent, for a terminal: all but ASCII's printable
## characters are escaped.
static func printable(text: String) -> String:
	var shown := ""
	for letter in text.left(MAX_SHOWN):
		var number: int = ord(letter)
		shown += letter if number >= 0x20 and number < 0x7f else "\\u%04x" % number
	return shown


func _read_frame() -> void:
	if _received.size() < LudusWire.HEADER_BYTES:
		return
	var type: int = _received[4]
	var num_bytes := LudusWire.read_u32(_received, 0)
	var is_known: bool = type == LudusWire.Type.CHALLENGE or type == LudusWire.Type.ERROR
	var is_allowed: bool = is_known and LudusWire.read_u32(_received, 4) == type
	if not is_allowed or num_bytes > LudusWire.MAX_GREETING_BYTES:
		_refuse("sequence", "expected CHALLENGE, got a frame of type %d" % type)
		return
	if _received.size() < LudusWire.HEADER_BYTES + num_bytes:
		return
	var content = null
	if num_bytes > 0 and _received.size() == LudusWire.HEADER_BYTES + num_bytes:
		content = LudusWire.read_json(_received.subarray(LudusWire.HEADER_BYTES, -1))
	if content == null:
		_refuse("frame", "the answer to the greeting is malformed")
	elif type == LudusWire.Type.ERROR:
		state = State.ENDED
		error = str(content.get("message", "the trainer refused"))
		hint = str(content.get("hint", ""))
		var theirs := read_hex(content.get("proof"))
		is_refusal_proven = _is_trainers(theirs, read_hex(content.get("nonce")))
	else:
		_answer(content)


func _answer(challenge: Dictionary) -> void:
	var nonce := read_hex(challenge.get("nonce"))
	var theirs := read_hex(challenge.get("proof"))
	if nonce.empty() or theirs.empty():
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
func _is_trainers(theirs: PoolByteArray, nonce: PoolByteArray) -> bool:
	var expected := proof(_token, "trainer", _nonce, nonce)
	return Crypto.new().constant_time_compare(expected, theirs)


func _refuse(why: String, message: String) -> void:
	state = State.REFUSED
	code = why
	error = message
