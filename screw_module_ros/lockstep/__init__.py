# SPDX-License-Identifier: Apache-2.0
"""Simulated time in lock step: it advances when every thread has finished its work.

The processes of a simulated robot share a page of memory (`page`). Each thread that uses the clock
is a member (`member`): it is busy, or it waits until a time that it states. What is in transit on
a bus, on a topic or to a service is counted at the ends of its channel (`end`). The simulated rig
runs the conductor (`conductor`): time advances when no member is busy and nothing is in transit to
a member that waits for it. `clock` is the clock that each process takes the time from.

Where the whole robot is one process, one thread runs its loops and moves the time (`rounds`): they
are no members.
"""
