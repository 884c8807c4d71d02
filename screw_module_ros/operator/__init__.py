# SPDX-License-Identifier: Apache-2.0
"""The public Python client of a running robot: the operator's actions as methods."""
