# SPDX-License-Identifier: Apache-2.0
"""Live characterization: a bench that uses the running graph (`characterize`)."""
