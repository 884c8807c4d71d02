# SPDX-License-Identifier: Apache-2.0
"""A report of a patient's sessions as HTML and PDF; it describes and claims no benefit."""
