# SPDX-License-Identifier: Apache-2.0
"""Errors of bags, as one tree.

BagError
├── BagFolderError      the folder cannot be made or written to
│   └── BagExistsError  a bag of that name exists: the recorder never overwrites
├── BagWriteError       writing failed while recording (disk full, quota); earlier data are kept
├── BagBusyError        another process is recording into that bag
├── BagReadError        not a bag, or an unfinished one: the message says what to do
└── DefinitionError     the definition of a message type is not installed

Every message names the path or the type, and the way out.
"""


class BagError(Exception):
    """Base class of the errors of bags."""


class BagFolderError(BagError):
    """The folder for the bag cannot be used, for instance no permission to write."""


class BagExistsError(BagFolderError):
    """The bag's folder exists already, for instance a second `start` with a fixed name."""


class BagWriteError(BagError):
    """Writing failed, for instance on a full disk; the bag is complete up to that time."""


class BagBusyError(BagError):
    """Another process is recording the bag, so it must not be repaired."""


class BagReadError(BagError):
    """The path holds no bag that can be read, for instance a file cut off by a power failure."""


class DefinitionError(BagError):
    """A message type whose .msg file is not installed, for instance a package not sourced."""
