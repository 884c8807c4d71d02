# SPDX-License-Identifier: Apache-2.0
"""Live characterization: a stand that uses the running graph (`characterize`)."""
