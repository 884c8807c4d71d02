# SPDX-License-Identifier: Apache-2.0
"""How fast it runs: rates, latencies and processor time of the graph, apart and composed."""
