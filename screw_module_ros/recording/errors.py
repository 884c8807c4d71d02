# SPDX-License-Identifier: Apache-2.0
"""What can go wrong with a bag, as one tree.

BagError
├── BagFolderError      the folder cannot be made or written to
│   └── BagExistsError  there is a bag of that name: nothing is ever overwritten
├── BagWriteError       writing failed in mid-recording (disk full, quota); what was there is kept
├── BagBusyError        another process is recording into that bag right now
├── BagReadError        not a bag, or an unfinished one: the sentence says what to do
└── DefinitionError     no text of a message type's definition on this machine

Every message names the path or the type, and the way out.
"""


class BagError(Exception):
    """Anything wrong with a bag."""


class BagFolderError(BagError):
    """The folder for the bag cannot be used, for instance no permission to write."""


class BagExistsError(BagFolderError):
    """The bag's folder exists already, for instance a second `start` with a fixed name."""


class BagWriteError(BagError):
    """Writing failed, for instance a full disk; the bag on the disk is complete up to then."""


class BagBusyError(BagError):
    """The bag is being recorded by another process, so it must not be repaired."""


class BagReadError(BagError):
    """The path holds no bag that can be read, for instance a file cut off by a power failure."""


class DefinitionError(BagError):
    """A message type whose .msg file is not installed, for instance a package not sourced."""
