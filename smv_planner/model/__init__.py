"""What a scenario is and what it means. Pure: no files, no clock, no processes."""
