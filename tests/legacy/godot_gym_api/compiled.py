"""Protobuf messages as ``protoc`` would compile them, made from a description."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

FieldType = Any
_Field: Any = descriptor_pb2.FieldDescriptorProto
FLOAT, BOOL, SINT32, BYTES = (
    _Field.TYPE_FLOAT,
    _Field.TYPE_BOOL,
    _Field.TYPE_SINT32,
    _Field.TYPE_BYTES,
)


def compile_messages(
    agent: dict[str, tuple[FieldType, bool]], world: dict[str, tuple[FieldType, bool]]
) -> SimpleNamespace:
    """Return a module with ``Message``; fields are (type, is repeated) by name, numbered from 1."""
    file: Any = descriptor_pb2.FileDescriptorProto(name="message.proto", syntax="proto3")
    for name, fields in (("AgentData", agent), ("WorldData", world)):
        message = file.message_type.add(name=name)
        for number, (field, (kind, is_repeated)) in enumerate(fields.items(), 1):
            label = _Field.LABEL_REPEATED if is_repeated else _Field.LABEL_OPTIONAL
            message.field.add(name=field, number=number, type=kind, label=label)
    whole = file.message_type.add(name="Message")
    for number, (field, name) in enumerate(
        (("agent_data", "AgentData"), ("world_data", "WorldData")), 1
    ):
        whole.field.add(
            name=field,
            number=number,
            type=_Field.TYPE_MESSAGE,
            type_name=f".{name}",
            label=_Field.LABEL_OPTIONAL,
        )
    pool: Any = descriptor_pool.DescriptorPool()
    pool.Add(file)
    descriptor = pool.FindMessageTypeByName("Message")
    return SimpleNamespace(Message=message_factory.GetMessageClass(descriptor))


WALK = compile_messages(
    {"place": (FLOAT, False), "frames": (SINT32, True)}, {"is_far": (BOOL, False)}
)
"""The messages of the game in ``project``."""

APPLE_SEEKER = compile_messages(
    {"distances_to_obstacle": (FLOAT, True), "distances_to_target": (FLOAT, True)},
    {"apple_caught": (BOOL, False)},
)
"""The messages of godot_gym_api's example."""
