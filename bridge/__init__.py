"""Bytes in, events out, and back: transport, codecs and the hub library of driver authors."""
