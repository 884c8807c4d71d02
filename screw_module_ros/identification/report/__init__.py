# SPDX-License-Identifier: Apache-2.0
"""`reproduce`: every experiment in process, and a page with our figures beside the thesis's."""
