# SPDX-License-Identifier: Apache-2.0
"""A force sensor of another package: made up, after amplifiers of CiA 404 (measuring devices)."""
