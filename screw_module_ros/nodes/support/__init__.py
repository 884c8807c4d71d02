# SPDX-License-Identifier: Apache-2.0
"""Base of every node: parameters, lifecycle, diagnostics, the hot loop, topics, locks.

A hot loop is the loop in the main thread of a node's process (see `threads`); a hot topic is one
whose subscription that loop serves instead of rclpy's executor (see `inbox`). Where one thread runs
the loops of all nodes, topics between them pass by calls (`local_topics`).
"""
