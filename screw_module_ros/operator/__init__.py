# SPDX-License-Identifier: Apache-2.0
"""The public Python client of a running robot: what an operator at the bench does, as calls."""
