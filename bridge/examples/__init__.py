"""Hubs for devices that speak something else, to copy from."""
