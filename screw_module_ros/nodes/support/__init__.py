# SPDX-License-Identifier: Apache-2.0
"""What every node shares: parameters, lifecycle, diagnostics, the hot loop, QoS, one-copy locks."""
