# SPDX-License-Identifier: Apache-2.0
"""Thin ROS 2 nodes: topics, services and parameters for the layers below.

Each executable is a file of its name; `module` and `whole` are several nodes in one process.
`recording_*`, `therapy_messages`, `therapy_recording`, `bridge_gateway` and `wish_relay` are parts
of the recorder, the therapy session and the bridge.
"""
