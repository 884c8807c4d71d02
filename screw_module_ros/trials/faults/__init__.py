# SPDX-License-Identifier: Apache-2.0
"""The fault catalogue: what can go wrong, as rows that are executed (`make faults`)."""
