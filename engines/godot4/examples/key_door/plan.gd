extends RefCounted
## The floor plan: a room, a corridor one cell wide, and a crossing with three doors.
##
## The corridor matters: whoever has come through it with the key stands where anybody would stand,
## so that nothing but memory can tell which door is right.

## Rows of cells: a dot is floor, a digit is floor in front of the door with that number.
const ROWS: PackedStringArray = [
	"...   0 ",
	".......1",
	"...   2 ",
]
const NUM_DOORS := 3
## The room in which hero and key begin: the cells of all rows up to this column.
const ROOM_SIZE := Vector2i(3, 3)
## Largest column.
const LAST_COLUMN := 7
## Direction in which each door lies from the cell in front of it.
const DOOR_SIDES: Array[Vector2i] = [Vector2i.UP, Vector2i.RIGHT, Vector2i.DOWN]
## The moves there are.
const MOVES: Array[Vector2i] = [Vector2i.LEFT, Vector2i.RIGHT, Vector2i.UP, Vector2i.DOWN]

static var _moves_from: Dictionary[Vector2i, PackedByteArray] = _find_moves()


## Whether there is floor.
static func is_floor(cell: Vector2i) -> bool:
	if cell.y < 0 or cell.y >= ROWS.size() or cell.x < 0 or cell.x > LAST_COLUMN:
		return false
	return ROWS[cell.y][cell.x] != " "


## Returns for each move whether it leads from a cell to floor, 1 or 0.
static func moves_from(cell: Vector2i) -> PackedByteArray:
	return _moves_from[cell]


## Returns the number of the door that a cell lies in front of, -1 if none.
static func door_at(cell: Vector2i) -> int:
	var mark := ROWS[cell.y][cell.x]
	return mark.to_int() if mark.is_valid_int() else -1


## Returns all cells with floor.
static func cells() -> Array[Vector2i]:
	var found: Array[Vector2i] = []
	for y: int in ROWS.size():
		for x: int in LAST_COLUMN + 1:
			if is_floor(Vector2i(x, y)):
				found.append(Vector2i(x, y))
	return found


## Returns a cell of the room by number, row by row.
static func room_cell(i: int) -> Vector2i:
	return Vector2i(i % ROOM_SIZE.x, i / ROOM_SIZE.x)


static func _find_moves() -> Dictionary[Vector2i, PackedByteArray]:
	var found: Dictionary[Vector2i, PackedByteArray] = {}
	for cell: Vector2i in cells():
		var moves := PackedByteArray()
		for move: Vector2i in MOVES:
			moves.append(int(is_floor(cell + move)))
		found[cell] = moves
	return found
