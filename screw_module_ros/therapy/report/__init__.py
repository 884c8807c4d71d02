# SPDX-License-Identifier: Apache-2.0
"""A patient's sessions on one page, as HTML and as PDF; it describes and claims no benefit."""
