"""The commands: they read arguments, call the API, print, and exit."""
