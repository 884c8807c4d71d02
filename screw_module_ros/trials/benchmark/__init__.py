# SPDX-License-Identifier: Apache-2.0
"""Benchmark: rates, latencies and processor time of the graph, in separate and composed form."""
