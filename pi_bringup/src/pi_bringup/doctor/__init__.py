"""Checks of the vehicle's computer. Each is a function that takes where to look (root: a folder in place of /) and
returns results; none of them writes anything, or waits longer than its limit."""
