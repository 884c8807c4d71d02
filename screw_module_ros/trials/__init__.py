# SPDX-License-Identifier: Apache-2.0
"""Trials of the whole graph: demo, benchmark, soak, faults. A robot runs without them."""
