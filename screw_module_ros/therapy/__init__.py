# SPDX-License-Identifier: Apache-2.0
"""Therapy without ROS and without a clock: protocols, trials, measures, adaptation, records.

Everything is a function of the samples: the same samples give the same numbers, in a session, in a
replay and in a test. A node feeds `session` with samples and passes on the slot it wishes for.
No number here claims a benefit.
"""
