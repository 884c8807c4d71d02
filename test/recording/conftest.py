# SPDX-License-Identifier: Apache-2.0
"""Messages and definitions for the recording tests, without ROS.

Messages are encoded by rosbags, so that our reading of raw CDR is checked against another codec.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bag_counts import MS, START
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from screw_module_ros.recording.bag import Bag, Message, StorageSettings, Topic
from screw_module_ros.recording.definitions import Definitions

ROOT = Path(__file__).parents[2]

# What share/PACKAGE/msg of ROS 2 Jazzy holds, without the comments.
COMMON = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n",
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "unique_identifier_msgs/UUID": "uint8[16] uuid\n",
}


@pytest.fixture(scope="session")
def definitions(tmp_path_factory) -> Definitions:
    """Definitions of our messages from the source tree."""
    share = tmp_path_factory.mktemp("share")
    for name, text in COMMON.items():
        package, kind = name.split("/")
        path = share / package / "msg" / f"{kind}.msg"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    packages = {path.name: path for path in share.iterdir()}
    return Definitions({**packages, "screw_module_msgs": ROOT / "msg_defs"})


@pytest.fixture(scope="session")
def own_types() -> list[str]:
    """Every message type of screw_module_msgs."""
    files = (ROOT / "msg_defs" / "msg").glob("*.msg")
    return sorted(f"screw_module_msgs/msg/{path.stem}" for path in files)


class Codec:
    """Encodes messages of our types as CDR; what is not said is zero, empty or False."""

    def __init__(self, definitions: Definitions, types: list[str]):
        self.store = get_typestore(Stores.EMPTY)
        found = {}
        for name in types:
            found.update(get_types_from_msg(definitions.find(name).text, name))
        self.store.register(found)

    def hash(self, type_name: str) -> str:
        return self.store.hash_rihs01(type_name)

    def encode(self, type_name: str, values: dict) -> bytes:
        """`values` is nested as the message is."""
        return bytes(self.store.serialize_cdr(self._make(type_name, values), type_name))

    def _make(self, type_name: str, values: dict):
        fields = self.store.fielddefs[type_name][1]
        parts = {name: self._value(kind, values.get(name)) for name, kind in fields}
        return self.store.types[type_name](**parts)

    def _value(self, kind, value):
        node, detail = kind
        if node.name == "NAME":
            return self._make(detail, value or {})
        if node.name == "BASE":
            zeros = {"string": "", "bool": False, "float64": 0.0}
            return zeros.get(detail[0], 0) if value is None else value
        base, size = detail[0][1][0], detail[1]
        if base == "string":
            return value or []
        return np.array(value if value is not None else [0] * size, dtype=base)


@pytest.fixture(scope="session")
def codec(definitions, own_types) -> Codec:
    return Codec(definitions, own_types)


ENCODER = "screw_module_msgs/msg/EncoderSample"
_INFINITE = {"sec": 9223372036, "nsec": 854775807}
QOS = {
    "history": "unknown", "depth": 0, "reliability": "best_effort", "durability": "volatile",
    "deadline": _INFINITE, "lifespan": _INFINITE, "liveliness": "automatic",
    "liveliness_lease_duration": _INFINITE, "avoid_ros_namespace_conventions": False,
}  # fmt: skip


@pytest.fixture
def topic(definitions, codec):
    """Return a maker of topics of our types, as the recorder would find them."""

    def make(name: str, kind: str, *qos: dict) -> Topic:
        full = f"screw_module_msgs/msg/{kind}"
        return Topic(name, full, definitions.find(full), codec.hash(full), qos)

    return make


@pytest.fixture
def encoder_topic(topic) -> Topic:
    return topic("/screw/encoder", "EncoderSample", QOS)


@pytest.fixture
def samples(codec):
    """Return a maker of encoder messages for a channel, one for each sequence number."""

    def make(channel: int, sequences, start: int = START) -> list[Message]:
        return [
            Message(
                channel,
                start + number * MS,
                start + number * MS - 50_000,
                place,
                codec.encode(
                    ENCODER,
                    {"sequence": number, "count": 3 * number, "position": number * 1e-6},
                ),
            )
            for place, number in enumerate(sequences, 1)
        ]

    return make


@pytest.fixture
def record(tmp_path, encoder_topic, samples):
    """Return a maker of closed bags of encoder samples, flushed every 500."""

    def make(sequences, topic: Topic = encoder_topic, notes: dict | None = None, **storage) -> Path:
        writer = Bag(tmp_path / "bag", StorageSettings(**storage))
        messages = samples(writer.add_topic(topic), sequences)
        for note in (notes or {}).items():
            writer.note(*note)
        for start in range(0, len(messages), 500):
            writer.write(messages[start : start + 500])
            writer.flush()
        writer.close()
        return writer.folder

    return make


@pytest.fixture
def bag(record):
    """A closed bag of 5000 encoder samples in several chunks; returns its folder."""
    return record(
        range(5000), notes={"configuration": {"sim.yaml": "sha256:0"}}, chunk_size=20_000
    )
