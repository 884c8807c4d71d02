# SPDX-License-Identifier: Apache-2.0
"""The fault catalogue: faults as rows that `make faults` carries out on running graphs."""
