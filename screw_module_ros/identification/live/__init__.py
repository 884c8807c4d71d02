# SPDX-License-Identifier: Apache-2.0
"""The live half of the characterization: a bench made of the running graph (`characterize`)."""
