# SPDX-License-Identifier: Apache-2.0
"""Recording of sessions as rosbag2 bags (MCAP): without ROS, safe against kill -9, audited."""

from .audit import Counts
from .bag import BagWriter, Topic
from .definitions import Definition, Definitions
from .errors import (
    BagBusyError,
    BagError,
    BagExistsError,
    BagFolderError,
    BagReadError,
    BagWriteError,
    DefinitionError,
)
from .mcap_file import Message
from .metadata import Qos
from .session import Session, Status
from .storage import StorageSettings

__all__ = [
    "BagBusyError",
    "BagError",
    "BagExistsError",
    "BagFolderError",
    "BagReadError",
    "BagWriteError",
    "BagWriter",
    "Counts",
    "Definition",
    "DefinitionError",
    "Definitions",
    "Message",
    "Qos",
    "Session",
    "Status",
    "StorageSettings",
    "Topic",
]
