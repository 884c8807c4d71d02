# SPDX-License-Identifier: Apache-2.0
"""Therapy without ROS and without a clock: protocols, trials, measures, adaptation, records.

All results are functions of the samples: the same samples give the same numbers in a session, in a
replay and in a test. A node passes samples to `session` and publishes the slot that it requests. No
number here claims a benefit.
"""
