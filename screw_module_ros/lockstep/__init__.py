# SPDX-License-Identifier: Apache-2.0
"""Simulated time in lock step: it moves on when everybody has finished with it.

The processes of a simulated robot share a page of memory (`page`). Each thread that works by the
clock is a member (`member`): it is busy, or it waits and names the time until which it is content.
Frames and messages that are under way are counted (`wires`). The simulated rig conducts
(`conductor`): time moves when nobody is busy and nothing is under way to somebody who waits for it.
"""
